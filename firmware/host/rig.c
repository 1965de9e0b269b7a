#include "rig.h"

#include <math.h>

enum { LOOK = 12 }; /* ticks between two looks of the board's guard, 50 us */

static double uniform(rig_plate *plate)
{
    plate->random ^= plate->random << 13;
    plate->random ^= plate->random >> 7;
    plate->random ^= plate->random << 17;
    return ((double)(plate->random >> 11) + 0.5) * (1.0 / 9007199254740992.0);
}

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
}

static uint32_t adc_code(double level)
{
    const double code = floor(level * 2048.0 + 2048.5);
    return code < 0.0 ? 0u : code > 4095.0 ? 4095u : (uint32_t)code;
}

bool rig_tick(rig_single *rig)
{
    const uint32_t sample = adc_code(sense(rig));
    drive(&rig->plate, ((double)rig->code - 2048.0) / 2047.0);
    rig->code = an_fast_tick(&rig->app.fast, sample);
    const bool ended = rig->app.fast.tick == 0u;
    if (ended) {
        an_single_slow(&rig->app);
    }
    if (++rig->looked >= LOOK) {
        rig->looked = 0u;
        rig->app.fast.faults |= an_single_check(&rig->app);
    }
    an_single_poll(&rig->app);
    return ended;
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
    window->motion = hypot(plate->state[0][0], plate->state[0][1]) * hypot(plate->residue[0][0], plate->residue[0][1]);
    window->state = (uint32_t)rig->app.supervisor.state;
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

uint32_t rig_ticks_to_safety(rig_single *rig, uint32_t most)
{
    for (uint32_t i = 0u; i <= most; i++) {
        if (rig->app.supervisor.state == AN_STATE_FAULT && rig->code == (uint32_t)AN_DAC_MIDDLE) {
            return i;
        }
        rig_tick(rig);
    }
    return most + 1u;
}

static bool stays_safe(rig_single *rig, uint32_t ticks)
{
    for (uint32_t i = 0u; i < ticks; i++) {
        rig_tick(rig);
        if (rig->app.supervisor.state != AN_STATE_FAULT || rig->code != (uint32_t)AN_DAC_MIDDLE) {
            return false;
        }
    }
    return true;
}

uint32_t rig_inject(rig_single *rig, rig_injection kind, uint32_t detail, uint32_t ticks, uint32_t stride, uint32_t most,
                    uint32_t latched)
{
    uint32_t worst = 0u;
    for (uint32_t i = 0u; i < ticks && worst <= most; i++) {
        if (i % stride == 0u) {
            rig_single copy = *rig;
            if (kind == RIG_SENSOR) {
                copy.plate.sensor = (rig_sensor)detail;
            } else {
                copy.app.fast.faults |= detail;
            }
            const uint32_t taken = rig_ticks_to_safety(&copy, most);
            worst = taken > worst ? taken : worst;
            worst = taken <= most && !stays_safe(&copy, latched) ? most + 1u : worst;
        }
        rig_tick(rig);
    }
    return worst;
}
