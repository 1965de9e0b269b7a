#include "rig.h"

#include <math.h>

/* Random number in (0, 1) from a 64-bit xorshift generator. */
static double uniform(rig_plate *plate)
{
    plate->random ^= plate->random << 13;
    plate->random ^= plate->random >> 7;
    plate->random ^= plate->random << 17;
    return ((double)(plate->random >> 11) + 0.5) * (1.0 / 9007199254740992.0);
}

/* Standard normal random number by the Box-Muller method. */
static double gauss(rig_plate *plate)
{
    const double radius = sqrt(-2.0 * log(uniform(plate)));
    return radius * cos(6.283185307179586 * uniform(plate));
}

static double sense(rig_single *rig)
{
    rig_plate *plate = &rig->plate;
    double level = plate->feedthrough * plate->line[1];
    for (uint32_t i = 0u; i < plate->count; i++) {
        level += plate->residue[i][0] * plate->state[i][0] - plate->residue[i][1] * plate->state[i][1];
    }
    level *= plate->sensitivity;
    if (plate->noise > 0.0) {
        level += plate->noise * gauss(plate);
    }
    switch (plate->sensor) {
    case RIG_DEAD:
        level = plate->noise > 0.0 ? plate->noise * gauss(plate) : 0.0;
        break;
    case RIG_STUCK:
        return rig->last_sensed;
    case RIG_REVERSED:
        level = -level;
        break;
    case RIG_CLIPPED:
        level = 2.0;
        break;
    case RIG_SOUND:
    default:
        break;
    }
    rig->last_sensed = level + plate->offset;
    return rig->last_sensed;
}

static double motion(const rig_plate *plate)
{
    return hypot(plate->state[0][0], plate->state[0][1]) * hypot(plate->residue[0][0], plate->residue[0][1]);
}

/* Turn the state of the first mode back, in proportion to its amplitude. */
static void soften(rig_plate *plate)
{
    const double angle = -plate->softening * motion(plate);
    const double re = plate->state[0][0];
    const double im = plate->state[0][1];
    plate->state[0][0] = re * cos(angle) - im * sin(angle);
    plate->state[0][1] = re * sin(angle) + im * cos(angle);
}

static void drive(rig_plate *plate, double level)
{
    const uint32_t last = plate->whole + 1u;
    for (uint32_t i = 0u; i < last; i++) {
        plate->line[i] = plate->line[i + 1u];
    }
    plate->line[last] = level;
    for (uint32_t i = 0u; i < plate->count; i++) {
        const double re = plate->state[i][0];
        const double im = plate->state[i][1];
        for (uint32_t part = 0u; part < 2u; part++) {
            const double turned = part == 0u ? plate->decay[i][0] * re - plate->decay[i][1] * im
                                             : plate->decay[i][0] * im + plate->decay[i][1] * re;
            plate->state[i][part] =
                turned + plate->fresh[i][part] * plate->line[1] + plate->stale[i][part] * plate->line[0];
        }
    }
    if (plate->softening != 0.0) {
        soften(plate);
    }
}

static uint32_t adc_code(double level)
{
    const double code = floor(level * 2048.0 + 2048.5);
    return code < 0.0 ? 0u : code > 4095.0 ? 4095u : (uint32_t)code;
}

static double amplify(const rig_plate *plate, double level)
{
    return plate->swing > 0.0 ? fmax(-plate->swing, fmin(level, plate->swing)) : level;
}

bool rig_tick(rig_single *rig)
{
    const uint32_t sample = adc_code(sense(rig));
    drive(&rig->plate, amplify(&rig->plate, ((double)rig->code - 2048.0) / 2047.0));
    rig->code = an_fast_tick(&rig->app.fast, sample);
    const bool ended = rig->app.fast.tick == 0u;
    if (ended) {
        an_single_slow(&rig->app);
        an_single_capture(&rig->app, &rig->capture);
    }
    if (++rig->looked >= (uint32_t)AN_WATCH_TICKS) {
        rig->looked = 0u;
        rig->app.fast.faults |= an_single_check(&rig->app);
    }
    an_application_poll(&rig->app.base, &an_single_build);
    return ended;
}

/* Amplitude of the drive at the last sample, relative to the table's limit. */
static double driven(const rig_single *rig)
{
    const an_complex drive = rig->app.fast.drive;
    const double limit = (double)AN_DAC_SWING * (double)rig->app.mode.drive_limit;
    return rig->app.fast.faults != 0u ? 0.0 : hypot((double)drive.re, (double)drive.im) / limit;
}

static void extend(rig_extent *most, double drive, double moved)
{
    most->drive = fmax(most->drive, drive);
    most->motion = fmax(most->motion, moved);
}

static void report(const rig_single *rig, rig_window *window)
{
    const an_view view = an_single_view(&rig->app);
    const rig_plate *plate = &rig->plate;
    window->measured[0] = (double)view.measured.re;
    window->measured[1] = (double)view.measured.im;
    window->drive[0] = (double)view.drive.re;
    window->drive[1] = (double)view.drive.im;
    window->reference = (double)view.reference;
    window->motion = motion(plate);
    window->state = (uint32_t)rig->app.base.supervisor.state;
    window->limited = rig->app.slow.pi.limited;
}

uint32_t rig_run(rig_single *rig, uint32_t ticks, rig_window *windows, uint32_t room)
{
    uint32_t count = 0u;
    for (uint32_t i = 0u; i < ticks; i++) {
        if (rig_tick(rig) && count < room) {
            report(rig, &windows[count++]);
        }
    }
    return count;
}

static bool is_in_fault(const rig_single *rig)
{
    return rig->app.base.supervisor.state == AN_STATE_FAULT;
}

/* True if the output is at rest and stays there until cleared. The main loop may enter the fault state a window
 * later. */
static bool is_safe(const rig_single *rig)
{
    return rig->code == (uint32_t)AN_DAC_MIDDLE && (is_in_fault(rig) || rig->app.fast.faults != 0u);
}

static void break_it(rig_single *rig, rig_injection kind, uint32_t detail)
{
    if (kind == RIG_SENSOR) {
        rig->plate.sensor = (rig_sensor)detail;
    } else if (kind == RIG_TRIP) {
        rig->app.fast.faults |= detail;
    } else {
        ((uint8_t *)&rig->app)[detail / 8u] ^= (uint8_t)(1u << detail % 8u);
    }
}

/* True if the amplitude is within 5 % of the reference, and the output at rest a millisecond after a stop. */
static bool is_held(rig_single *rig, float reference)
{
    const an_complex measured = rig->app.slow.measured.tone;
    const double off = hypot((double)measured.re, (double)measured.im) / (double)reference - 1.0;
    const bool near = fabs(off) < 0.05 && rig->app.base.supervisor.state == AN_STATE_RUN;
    an_application_stop(&rig->app.base);
    rig_run(rig, 250u, NULL, 0u);
    return near && rig->app.base.supervisor.state == AN_STATE_IDLE && rig->code == (uint32_t)AN_DAC_MIDDLE;
}

static void follow(rig_single *rig, const rig_trial *trial, float reference, rig_outcome *outcome)
{
    rig_extent most = {0.0, 0.0};
    uint32_t since = 0u;
    for (uint32_t i = 0u; i - since < trial->latched && since <= trial->most; i++) {
        since = is_safe(rig) ? since : i + 1u;
        rig_tick(rig);
        extend(&most, driven(rig), motion(&rig->plate));
    }
    extend(&outcome->broken, most.drive, most.motion);
    const bool bounded = most.drive <= 1.0 + 1e-6 && most.motion <= trial->further * outcome->sound.motion;
    if (bounded && since <= trial->most && is_in_fault(rig)) {
        outcome->latched++;
        outcome->soon += since <= (uint32_t)RIG_SOON;
        outcome->longest = since > outcome->longest ? since : outcome->longest;
    } else if (bounded && trial->kind == RIG_FLIP && is_held(rig, reference)) {
        outcome->held++;
    } else {
        outcome->unsafe++;
    }
}

static rig_extent sound_run(rig_single rig, uint32_t ticks)
{
    rig_extent most = {0.0, 0.0};
    for (uint32_t i = 0u; i < ticks; i++) {
        rig_tick(&rig);
        extend(&most, driven(&rig), motion(&rig.plate));
    }
    return most;
}

rig_outcome rig_inject(rig_single *rig, const rig_trial *trial)
{
    rig_outcome outcome = {.sound = sound_run(*rig, trial->ticks)};
    for (uint32_t i = 0u; i < trial->ticks; i++) {
        if (i % trial->stride == 0u) {
            rig_single copy = *rig;
            break_it(&copy, trial->kind, trial->details[(i * 2654435761u >> 8) % trial->count]);
            follow(&copy, trial, rig->app.slow.reference, &outcome);
        }
        rig_tick(rig);
    }
    return outcome;
}
