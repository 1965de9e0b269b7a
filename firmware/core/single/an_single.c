#include "an_single.h"

#include <stdatomic.h>

#include "an_assert.h"
#include "an_bytes.h"
#include "an_complex.h"
#include "an_dds.h"
#include "an_wire.h"
#include "an_sine.h"

#define AN_RESPONSE_S 0.53e-3f   /* closed-loop time constant: 95 % in 1.6 ms, plus the age of a measurement */
#define AN_LEAVING_S 0.2e-3f     /* likewise, when leaving the drive limit */
#define AN_NO_BOUND 1e9f
#define AN_NO_REFERENCE 1e-6f /* of full scale: far below noise */
#define AN_USEFUL 0.2f           /* of G Vmax: highest level that is still approached at full speed */
#define AN_REFERENCE_MAX 0.9f    /* of the amplitude limit */
#define AN_RETUNE_HZ 0.5f        /* smaller shifts of the resonance do not need new gains */
#define AN_RETUNE_SHARE 0.03f    /* nor do smaller relative changes of tau */

#define AN_CHIRP_MAX_S 10.0f
#define AN_WORD 32767.0f /* of a recorded response, at full scale */

enum { BUILD_NUMBER = 1 };

static const uint32_t all_measured = AN_GAIN_IDENTIFIED | AN_TAU_IDENTIFIED | AN_FREQUENCY_IDENTIFIED;

static float period_s(const an_single *app)
{
    return (float)AN_PERIOD / app->base.sample_rate_hz;
}

static an_job *new_job(an_single *app, uint32_t kind, uint32_t step)
{
    an_job *job = an_slow_vacant(&app->slow);
    if (job == NULL || !an_demod_plan(&job->demod, step, AN_WINDOW, 1.0f / (float)AN_ADC_MIDDLE)) {
        return NULL;
    }
    job->kind = kind;
    job->clear = 0u;
    job->chirp.steps = 0u;
    job->step = step;
    job->amplitude_limit2 = app->mode.amplitude_limit * app->mode.amplitude_limit;
    return job;
}

static bool post_rest(an_application *base, bool clear)
{
    an_single *app = (an_single *)base;
    an_job *job = new_job(app, AN_JOB_REST, app->centre);
    app->slow.reference = 0.0f;
    if (job == NULL) {
        return false;
    }
    job->clear = clear ? 1u : 0u;
    an_handover_post(&app->slow.hand);
    return true;
}

static bool post_dwell(an_single *app)
{
    an_probe probe;
    an_ident_probe(&app->ident, &probe);
    an_job *job = new_job(app, AN_JOB_DWELL, probe.step);
    if (job == NULL) {
        return false;
    }
    AN_ASSERT(probe.level > 0.0f && probe.level <= app->mode.drive_limit);
    job->drive = an_scale(an_turn(probe.step), probe.level);
    job->settle = (uint32_t)(probe.settle_s / period_s(app)) + 2u;
    job->average = probe.average;
    an_handover_post(&app->slow.hand);
    return true;
}

static float lowest_useful(const an_single *app)
{
    const float reach = AN_USEFUL * an_abs(app->mode.gain) * app->mode.drive_limit;
    const float half = 0.5f * app->mode.amplitude_limit;
    return reach < half ? reach : half;
}

float an_single_frequency(const an_single *app)
{
    return an_dds_frequency(app->centre, app->base.sample_rate_hz) + an_track_shift_hz(&app->track);
}

bool an_single_is_limited(const an_single *app)
{
    return app->base.supervisor.state == AN_STATE_RUN && app->track.limited != 0u;
}

static an_pi_spec spec_of(const an_single *app)
{
    const an_pi_spec spec = {
        .period_s = period_s(app),
        .ahead_s = ((float)AN_WINDOW * 0.5f + (float)AN_GAP) / app->base.sample_rate_hz,
        .response_s = AN_RESPONSE_S,
        .leaving_s = AN_LEAVING_S,
        .proportional_max = app->neighbour > 0.0f ? AN_NEIGHBOUR_LOOP / app->neighbour : AN_NO_BOUND,
        .noise2 = app->slow.quiet,
        .free_gain = an_abs(app->mode.gain),
    };
    return spec;
}

/* Post a job with the loop gains for the mode as tracked now; a closed loop continues with them. */
static bool post_track(an_single *app)
{
    const float away_hz = an_track_shift_hz(&app->track) + app->detuning_hz;
    const uint32_t step = an_dds_shifted(app->centre, away_hz, app->base.sample_rate_hz);
    an_job *job = new_job(app, AN_JOB_TRACK, step);
    if (job == NULL) {
        return false;
    }
    const an_pi_spec spec = spec_of(app);
    an_track_mode(&app->track, &app->mode, &app->now);
    an_pi_plan(&job->gains, &app->now, step, app->detuning_hz, &spec);
    app->eased = app->base.eased;
    job->gains.drive_limit *= app->eased ? AN_EASED : 1.0f;
    an_watch_prepare(&job->watch, &app->mode, job->gains.lead, step, app->base.sample_rate_hz);
    an_handover_post(&app->slow.hand);
    return true;
}

static bool begin_track(an_single *app)
{
    const an_pi_spec spec = spec_of(app);
    an_track_begin(&app->track, &app->mode, &spec, app->detuning_hz, app->slow.quiet);
    app->slow.noted = 0u; /* the slow step rests */
    an_single_set_reference(app, app->target_reference > 0.0f ? app->target_reference : lowest_useful(app));
    return post_track(app);
}

static void fail(an_single *app, an_fault fault)
{
    an_application_fail(&app->base, &an_single_build, fault);
}

static float strongest_neighbour(const an_table *table)
{
    float strongest = 0.0f;
    for (uint32_t i = 0u; i < table->mode_count; i++) {
        an_mode mode;
        an_table_mode(table, i, &mode);
        if (i != table->target && an_abs(mode.gain) > strongest) {
            strongest = an_abs(mode.gain);
        }
    }
    return strongest;
}

static an_table_result accepts(const an_table *table, float sample_rate_hz)
{
    an_mode mode;
    if (table->mode_count == 0u || table->sample_rate_hz != sample_rate_hz) {
        return AN_TABLE_OTHER_BUILD;
    }
    an_table_mode(table, table->target, &mode);
    return mode.frequency_hz < (float)AN_SINGLE_FREQUENCY_MIN_HZ ? AN_TABLE_RANGE : AN_TABLE_OK;
}

void an_single_boot(an_single *app, const uint8_t *table, uint32_t length, float sample_rate_hz, uint32_t faults)
{
    app->probing = 0u;
    app->centre = an_dds_step(0.125f * sample_rate_hz, sample_rate_hz);
    app->mode.amplitude_limit = 1.0f;
    app->mode.metres = 0.0f;
    app->neighbour = 0.0f;
    app->ident.motion = 0.0f;
    app->ident.misfit = 0.0f;
    an_track_forget(&app->track);
    const bool accepted = an_table_open(&app->table, table, length) == AN_TABLE_OK &&
                          accepts(&app->table, sample_rate_hz) == AN_TABLE_OK;
    if (accepted) {
        app->mode_flags = an_table_mode(&app->table, app->table.target, &app->mode);
        app->centre = an_dds_step(app->mode.frequency_hz, sample_rate_hz);
        app->neighbour = strongest_neighbour(&app->table);
    }
    app->acting = app->centre;
    const bool ready = an_slow_init(&app->slow, &app->fast, app->centre) && accepted;
    an_application_boot(&app->base, sample_rate_hz, ready ? faults : faults | AN_FAULT_TABLE);
}

an_view an_single_view(const an_single *app)
{
    const bool runs = app->base.supervisor.state == AN_STATE_RUN;
    const an_view view = {
        .measured = app->slow.measured.tone,
        .drive = runs ? app->slow.pi.drive : an_cplx(0.0f, 0.0f),
        .reference = runs ? app->slow.pi.reference : 0.0f,
        .offset = app->slow.measured.offset,
    };
    return view;
}

static void begin_run(an_single *app)
{
    if (begin_track(app)) {
        an_supervisor_enter(&app->base.supervisor, AN_STATE_RUN);
    } else {
        fail(app, AN_FAULT_IDENTIFY);
    }
}

static void begin_identify(an_application *base)
{
    an_single *app = (an_single *)base;
    const bool displacement = (app->table.flags & AN_SENSES_DISPLACEMENT) != 0u;
    an_ident_init(&app->ident, &app->mode, displacement, app->base.sample_rate_hz);
    app->probing = 0u;
}

/* The first drive with values from a table, or from before a reset, is a check. */
static void begin_check(an_single *app)
{
    an_ident_check(&app->ident, &app->mode, app->centre, app->base.sample_rate_hz);
    app->probing = 0u;
}

bool an_single_may_start(float reference, float detuning_hz)
{
    return an_application_may_refer(reference) && __builtin_fabsf(detuning_hz) <= AN_DETUNING_MAX_HZ;
}

/* True if gain and frequency have been measured; computed values are only a guess for a real plate. */
static bool was_measured(const an_single *app)
{
    const uint32_t measured = AN_GAIN_IDENTIFIED | AN_FREQUENCY_IDENTIFIED;
    return (app->mode_flags & measured) == measured;
}

bool an_single_start(an_single *app, float reference, float detuning_hz)
{
    if (!an_single_may_start(reference, detuning_hz) || !an_application_is_ready(&app->base, &an_single_build)) {
        return false;
    }
    app->target_reference = reference;
    app->detuning_hz = detuning_hz;
    if (was_measured(app) && app->base.confirmed) {
        an_supervisor_begin(&app->base.supervisor, AN_STATE_RUN);
        begin_run(app);
        return true;
    }
    an_supervisor_begin(&app->base.supervisor, AN_STATE_IDENTIFY);
    if (was_measured(app)) {
        begin_check(app);
    } else {
        begin_identify(&app->base);
    }
    return true;
}

void an_single_set_reference(an_single *app, float reference)
{
    const float most = AN_REFERENCE_MAX * app->mode.amplitude_limit;
    if (reference >= 0.0f) {
        app->slow.reference = reference < most ? reference : most;
    }
}

static void end_identify(an_single *app)
{
    app->mode = app->ident.mode;
    app->centre = app->ident.centre;
    an_track_forget(&app->track);
    app->neighbour = app->ident.neighbour;
    app->mode_flags |= all_measured;
    if (!an_application_is_measured(&app->base, &an_single_build)) {
        begin_run(app);
    }
}

static void identify(an_application *base)
{
    an_single *app = (an_single *)base;
    if (app->probing != 0u) {
        if (!an_dwell_finished(&app->slow.dwell)) {
            return;
        }
        const float share = 1.0f / (float)app->slow.jobs[app->slow.hand.active & 1u].average;
        const an_complex mean = an_scale(app->slow.total, share);
        /* variance of the mean of n windows due to noise: (mean of |U|^2 - |mean of U|^2) / (n - 1), share = 1 / n */
        const float spread = share * app->slow.energy - an_abs2(mean);
        an_ident_answer(&app->ident, mean, spread > 0.0f ? spread * share / (1.0f - share) : 0.0f);
    }
    if (app->ident.stage == AN_IDENT_DIFFERS) {
        begin_identify(base);
    }
    if (app->ident.stage == AN_IDENT_FAILED) {
        fail(app, AN_FAULT_IDENTIFY);
    } else if (app->ident.stage == AN_IDENT_DONE) {
        end_identify(app);
    } else if (app->ident.stage == AN_IDENT_AGREES) {
        base->confirmed = true;
        begin_run(app);
    } else if (post_dwell(app)) {
        app->probing = 1u;
    } else {
        fail(app, AN_FAULT_IDENTIFY);
    }
}

void an_single_slow(an_single *app)
{
    an_slow_step(&app->slow, &app->fast);
    app->slow.envelope = an_texture_step(&app->base.texture);
}

static bool is_worth_new_gains(const an_single *app)
{
    an_mode now;
    an_track_mode(&app->track, &app->mode, &now);
    const float shifted = now.frequency_hz - app->now.frequency_hz;
    const float damped = now.tau_s - app->now.tau_s;
    return __builtin_fabsf(shifted) > AN_RETUNE_HZ || __builtin_fabsf(damped) > AN_RETUNE_SHARE * app->now.tau_s;
}

/* Track the plate from the last windows: update the loop gains, or report a lost plate. */
static void follow(an_application *base)
{
    an_single *app = (an_single *)base;
    const volatile uint32_t *noted = &app->slow.noted;
    const uint32_t written = *noted;
    atomic_signal_fence(memory_order_acquire);
    const float target = app->slow.reference * app->slow.envelope; /* a constant envelope does not disturb it */
    if (target != app->followed_reference) {
        app->followed_reference = target;
        an_track_disturb(&app->track);
    }
    const an_track_result found = an_track_read(&app->track, app->slow.notes, written);
    if (found == AN_TRACK_LOST) {
        fail(app, AN_FAULT_MISMATCH);
    } else if (app->eased != app->base.eased || (found == AN_TRACK_FOLLOWS && is_worth_new_gains(app))) {
        post_track(app);
    }
}

/* Check for a sensor failure while the loop is closed: a signal that no plate can produce. Clipping is a separate
 * fault. */
static bool sensor_failed(an_single *app)
{
    const an_job *job = &app->slow.jobs[app->slow.hand.active & 1u];
    const uint32_t clipped = app->fast.clipped + app->fast.window.clipped;
    if (job->kind != AN_JOB_TRACK || !job->watch.decides || app->slow.hand.trips != 0u || clipped != 0u) {
        an_watch_forget(&app->watch);
        return false;
    }
    return an_watch_look(&app->watch, &job->watch, &app->fast, app->slow.quiet);
}

/* Check that drive and phase step in a window are those commanded by the slow step for the active job, and that they
 * continue through the following gap. After a fault the tick is at rest and ignores late commands. */
static bool acts_as_commanded(an_single *app)
{
    const an_fast *fast = &app->fast;
    if (fast->faults != 0u) {
        app->acting = fast->step;
        return true;
    }
    if (fast->tick >= AN_GAP) {
        app->acting = app->slow.jobs[app->slow.hand.active & 1u].step;
        return fast->step == app->acting && fast->drive.re == fast->command.drive.re &&
               fast->drive.im == fast->command.drive.im;
    }
    return fast->step == app->acting;
}

uint32_t an_single_check(an_single *app)
{
    uint32_t found = app->fast.clipped > AN_CLIPPED_MAX ? (uint32_t)AN_FAULT_SENSOR_CLIPPED : 0u;
    if (!an_handover_is_sound(&app->slow.hand) || !acts_as_commanded(app)) {
        found |= AN_FAULT_MEMORY;
    }
    if (app->fast.tick > AN_PERIOD) {
        app->fast.tick = 0u;
        found |= AN_FAULT_MEMORY;
    }
    return sensor_failed(app) ? found | AN_FAULT_MISMATCH : found;
}

static an_moment moment(const an_application *base)
{
    const an_single *app = (const an_single *)base;
    const float most = app->mode.drive_limit;
    const an_moment now = {
        .vacant = an_handover_vacant(&app->slow.hand),
        .job = app->slow.jobs[app->slow.hand.active & 1u].kind,
        .faults = app->fast.faults | app->slow.hand.trips,
        .limited = an_single_is_limited(app),
        .hard = base->supervisor.state == AN_STATE_RUN && an_abs2(app->slow.pi.drive) > AN_HARD2 * most * most,
        .window = app->fast.window.count,
        .window_hz = 1.0f / period_s(app),
    };
    return now;
}

static const an_table *table_of(const an_application *base)
{
    return &((const an_single *)base)->table;
}

static uint32_t entries(const an_table *table)
{
    return table->mode_count;
}

static void trip(an_application *base, uint32_t faults)
{
    an_handover_trip(&((an_single *)base)->fast.faults, faults);
}

static bool restart(an_application *base)
{
    an_single *app = (an_single *)base;
    return an_single_start(app, app->target_reference, app->detuning_hz);
}

/* A retry returns to this reference; 0 would select the lowest useful level. */
static void set_reference(an_application *base, float reference)
{
    an_single *app = (an_single *)base;
    app->target_reference = reference > 0.0f ? reference : AN_NO_REFERENCE;
    an_single_set_reference(app, reference);
}

/* Measured values, as saved. */
typedef struct {
    uint32_t centre; /* more exact than the frequency */
    an_measured_request values;
} a_measurement;

static uint8_t *put_values(const an_application *base, uint8_t *at)
{
    const an_single *app = (const an_single *)base;
    const an_ident *ident = &app->ident;
    const a_measurement kept = {
        .centre = app->centre,
        .values = {.frequency_hz = app->mode.frequency_hz,
                   .tau_s = app->mode.tau_s,
                   .gain = app->mode.gain,
                   .delay_s = app->mode.delay_s,
                   .neighbour = app->neighbour,
                   .motion = ident->motion,
                   .misfit = ident->misfit},
    };
    return an_put_object(at, &kept, sizeof kept);
}

static void set_values(an_single *app, const an_measured_request *values)
{
    app->centre = an_dds_step(values->frequency_hz, app->base.sample_rate_hz);
    app->mode.frequency_hz = values->frequency_hz;
    app->mode.tau_s = values->tau_s;
    app->mode.gain = values->gain;
    app->mode.delay_s = values->delay_s;
    app->neighbour = values->neighbour;
    app->ident.motion = values->motion;
    app->ident.misfit = values->misfit;
    app->mode_flags |= all_measured;
}

static bool take_values(an_application *base, const uint8_t *bytes, uint32_t length)
{
    an_single *app = (an_single *)base;
    a_measurement kept;
    if (length != sizeof kept) {
        return false;
    }
    an_get_object(&kept, bytes, sizeof kept);
    set_values(app, &kept.values);
    app->centre = kept.centre;
    return true;
}

/* Check the bounds of a number; false for a NaN. */
static bool within(float value, float low, float high)
{
    return value >= low && value <= high;
}

static bool may_play(const an_single *app, float frequency_hz)
{
    return within(frequency_hz, (float)AN_SINGLE_FREQUENCY_MIN_HZ, AN_FREQUENCY_HIGH * app->base.sample_rate_hz);
}

bool an_single_may_adopt(const an_single *app, const an_measured_request *values)
{
    return may_play(app, values->frequency_hz) && within(values->tau_s, AN_TAU_LOW_S, AN_TAU_HIGH_S) &&
           within(an_abs(values->gain), AN_GAIN_LOW, AN_GAIN_HIGH) && within(values->delay_s, 0.0f, AN_DELAY_HIGH_S) &&
           within(values->neighbour, 0.0f, AN_GAIN_HIGH) && within(values->motion, 0.0f, 1.0f) &&
           within(values->misfit, 0.0f, 1.0f);
}

bool an_single_adopt(an_single *app, const an_measured_request *values)
{
    if (!an_application_is_ready(&app->base, &an_single_build)) {
        return false;
    }
    set_values(app, values);
    an_track_forget(&app->track);
    app->base.measured++;
    app->base.confirmed = false;
    return true;
}

bool an_single_may_chirp(const an_single *app, const an_chirp_request *plan)
{
    const float windows = (float)(plan->settle + (uint32_t)AN_CHIRP_ROWS) * (float)plan->every;
    return may_play(app, plan->frequency_hz) && within(plan->level, 0.0f, 1.0f) && plan->steps > 0u &&
           plan->steps <= (uint32_t)AN_CHIRP_ROWS && plan->every > 0u && plan->settle > 0u &&
           plan->settle <= (uint32_t)AN_CHIRP_ROWS && windows * period_s(app) <= AN_CHIRP_MAX_S;
}

bool an_single_chirp(an_single *app, const an_chirp_request *plan)
{
    const uint32_t step = an_dds_step(plan->frequency_hz, app->base.sample_rate_hz);
    if (!an_application_is_ready(&app->base, &an_single_build)) {
        return false;
    }
    an_job *job = new_job(app, AN_JOB_DWELL, step);
    if (job == NULL) {
        return false;
    }
    job->drive = an_scale(an_turn(step), plan->level * app->mode.drive_limit);
    job->chirp = *plan;
    an_supervisor_begin(&app->base.supervisor, AN_STATE_IDENTIFY);
    app->base.supervisor.measure_only = true;
    app->probing = 1u; /* a dwell that does not finish */
    an_handover_post(&app->slow.hand);
    return true;
}

static uint16_t word_of(float part)
{
    return (uint16_t)(int16_t)(int32_t)(AN_WORD * (part > 1.0f ? 1.0f : part > -1.0f ? part : -1.0f));
}

void an_single_capture(const an_single *app, an_capture *capture)
{
    const an_complex measured = app->slow.measured.tone;
    const uint16_t re = word_of(measured.re);
    const uint16_t im = word_of(measured.im);
    an_capture_take_response(capture, app->slow.chirp.begun, &re, &im);
}

const an_build an_single_build = {
    .number = BUILD_NUMBER,
    .moment = moment,
    .table = table_of,
    .entries = entries,
    .accepts = accepts,
    .post_rest = post_rest,
    .trip = trip,
    .begin_identify = begin_identify,
    .identify = identify,
    .follow = follow,
    .restart = restart,
    .set_reference = set_reference,
    .put_status = an_single_put_status,
    .put_values = put_values,
    .take_values = take_values,
    .handle_request = an_single_handle_request,
};
