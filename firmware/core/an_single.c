#include "an_single.h"

#include "an_complex.h"
#include "an_dds.h"
#include "an_faults.h"
#include "an_sine.h"

#define AN_RESPONSE_S 0.53e-3f   /* the loop's time constant: 95 % in 1.6 ms, plus the age of a measurement */
#define AN_NEIGHBOUR_LOOP 0.5f   /* loop gain that a mode beside the wanted one may have, whatever its phase */
#define AN_NO_BOUND 1e9f
#define AN_USEFUL 0.2f             /* of G Vmax: the largest level that still rises at full speed */
#define AN_REFERENCE_MAX 0.9f      /* of the amplitude limit */
#define AN_PATIENCE 3.0f           /* time constants */
#define AN_SILENCE_S 0.5f
#define AN_DETUNING_MAX_HZ 500.0f

static const uint32_t lasting = AN_FAULT_TABLE | AN_FAULT_CLOCK;

static float period_s(const an_single *app)
{
    return (float)AN_PERIOD / app->sample_rate_hz;
}

static an_job *new_job(an_single *app, uint32_t kind, uint32_t step)
{
    an_job *job = an_slow_vacant(&app->slow);
    if (job == NULL || !an_demod_plan(&job->demod, step, AN_WINDOW, 1.0f / (float)AN_ADC_MIDDLE)) {
        return NULL;
    }
    job->kind = kind;
    job->clear = 0u;
    job->step = step;
    job->amplitude_limit2 = app->mode.amplitude_limit * app->mode.amplitude_limit;
    return job;
}

static bool post_rest(an_single *app, uint32_t clear)
{
    an_job *job = new_job(app, AN_JOB_REST, app->centre);
    if (job == NULL) {
        return false;
    }
    job->clear = clear;
    an_slow_post(&app->slow);
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
    job->drive = an_scale(an_turn(probe.step), probe.level);
    job->settle = (uint32_t)(probe.settle_s / period_s(app)) + 2u;
    job->average = probe.average;
    an_slow_post(&app->slow);
    return true;
}

static float lowest_useful(const an_single *app)
{
    const float reach = AN_USEFUL * an_abs(app->mode.gain) * app->mode.drive_limit;
    const float half = 0.5f * app->mode.amplitude_limit;
    return reach < half ? reach : half;
}

static bool post_track(an_single *app)
{
    const uint32_t step = an_dds_shifted(app->centre, app->detuning_hz, app->sample_rate_hz);
    an_job *job = new_job(app, AN_JOB_TRACK, step);
    if (job == NULL) {
        return false;
    }
    const float detuning_hz = an_dds_detuning(step, app->centre, app->sample_rate_hz);
    const an_pi_wish wish = {
        .period_s = period_s(app),
        .ahead_s = ((float)AN_WINDOW * 0.5f + (float)AN_GAP) / app->sample_rate_hz,
        .response_s = AN_RESPONSE_S,
        .proportional_max = app->neighbour > 0.0f ? AN_NEIGHBOUR_LOOP / app->neighbour : AN_NO_BOUND,
    };
    an_pi_plan(&job->gains, &app->mode, step, detuning_hz, &wish);
    job->patience = (uint32_t)(AN_PATIENCE * app->mode.tau_s / period_s(app)) + 10u;
    an_single_refer(app, app->wanted_reference > 0.0f ? app->wanted_reference : lowest_useful(app));
    an_slow_post(&app->slow);
    return true;
}

static void fail(an_single *app, uint32_t fault)
{
    app->faults |= fault;
    app->state = AN_STATE_FAULT;
    app->slow.reference = 0.0f;
    post_rest(app, 0u);
}

static float strongest_neighbour(const an_table *table)
{
    float strongest = 0.0f;
    for (uint32_t i = 0u; i < table->mode_count; i++) {
        an_mode mode;
        an_table_mode(table, i, &mode);
        if (i != table->wanted && an_abs(mode.gain) > strongest) {
            strongest = an_abs(mode.gain);
        }
    }
    return strongest;
}

void an_single_boot(an_single *app, const uint8_t *table, uint32_t length, float sample_rate_hz, uint32_t faults)
{
    app->state = AN_STATE_IDLE;
    app->faults = faults;
    app->sample_rate_hz = sample_rate_hz;
    app->probing = 0u;
    app->stopping = false;
    app->host_drives = false;
    app->worst_cycles = 0u;
    an_texture_init(&app->texture);
    app->centre = an_dds_step(0.125f * sample_rate_hz, sample_rate_hz);
    app->mode.amplitude_limit = 1.0f;
    app->neighbour = 0.0f;
    const bool accepted = an_table_open(&app->table, table, length) == AN_TABLE_OK && app->table.mode_count > 0u &&
                          app->table.sample_rate_hz == sample_rate_hz;
    if (accepted) {
        app->mode_flags = an_table_mode(&app->table, app->table.wanted, &app->mode);
        app->centre = an_dds_step(app->mode.frequency_hz, sample_rate_hz);
        app->neighbour = strongest_neighbour(&app->table);
    } else {
        app->faults |= AN_FAULT_TABLE;
    }
    if (!an_slow_init(&app->slow, &app->fast, app->centre)) {
        app->faults |= AN_FAULT_TABLE;
    }
    if (app->faults != 0u) {
        app->state = AN_STATE_FAULT;
    }
}

an_view an_single_view(const an_single *app)
{
    an_view view = {.measured = app->slow.measured.tone, .offset = app->slow.measured.offset};
    if (app->state == AN_STATE_RUN) {
        view.drive = app->slow.pi.drive;
        view.reference = app->slow.pi.reference;
    }
    return view;
}

static void begin_run(an_single *app)
{
    if (post_track(app)) {
        app->state = AN_STATE_RUN;
    } else {
        fail(app, AN_FAULT_IDENTIFY);
    }
}

static void begin_identify(an_single *app)
{
    const bool displacement = (app->table.flags & AN_SENSES_DISPLACEMENT) != 0u;
    an_ident_init(&app->ident, &app->mode, displacement, app->sample_rate_hz);
    app->probing = 0u;
    app->state = AN_STATE_IDENTIFY;
}

bool an_single_may_start(float reference, float detuning_hz)
{
    return reference >= 0.0f && reference <= 1.0f && __builtin_fabsf(detuning_hz) <= AN_DETUNING_MAX_HZ;
}

/* A gain or a frequency that was only computed is a guess: no plate is quite the one that was computed. */
static bool was_measured(const an_single *app)
{
    const uint32_t measured = AN_GAIN_IDENTIFIED | AN_FREQUENCY_IDENTIFIED;
    return (app->mode_flags & measured) == measured;
}

bool an_single_start(an_single *app, float reference, float detuning_hz)
{
    if (app->state != AN_STATE_IDLE || !an_single_may_start(reference, detuning_hz) ||
        an_slow_vacant(&app->slow) == NULL) {
        return false;
    }
    app->host_drives = false;
    app->wanted_reference = reference;
    app->detuning_hz = detuning_hz;
    if (was_measured(app)) {
        begin_run(app);
    } else {
        begin_identify(app);
    }
    return true;
}

void an_single_refer(an_single *app, float reference)
{
    const float most = AN_REFERENCE_MAX * app->mode.amplitude_limit;
    if (reference >= 0.0f) {
        app->slow.reference = reference < most ? reference : most;
    }
}

void an_single_stop(an_single *app)
{
    app->stopping = app->state == AN_STATE_IDENTIFY || app->state == AN_STATE_RUN;
}

void an_single_trip(an_single *app, uint32_t fault)
{
    app->slow.outside |= fault;
}

bool an_single_clear(an_single *app)
{
    if (app->state != AN_STATE_FAULT || (app->faults & lasting) != 0u || an_slow_vacant(&app->slow) == NULL) {
        return false;
    }
    app->slow.outside = 0u; /* before the job that clears the rest */
    post_rest(app, 1u);
    app->faults = 0u;
    app->state = AN_STATE_IDLE;
    return true;
}

static void end_identify(an_single *app)
{
    app->mode = app->ident.mode;
    app->centre = app->ident.centre;
    app->neighbour = app->ident.neighbour;
    app->mode_flags |= AN_GAIN_IDENTIFIED | AN_TAU_IDENTIFIED | AN_FREQUENCY_IDENTIFIED;
    begin_run(app);
}

static void identify(an_single *app)
{
    if (app->probing != 0u) {
        if (app->slow.finished == 0u) {
            return;
        }
        const float count = (float)app->slow.jobs[app->slow.active].average;
        an_ident_answer(&app->ident, an_scale(app->slow.total, 1.0f / count));
    }
    if (app->ident.stage == AN_IDENT_FAILED) {
        fail(app, AN_FAULT_IDENTIFY);
    } else if (app->ident.stage == AN_IDENT_DONE) {
        end_identify(app);
    } else {
        app->probing = post_dwell(app) ? 1u : 0u;
    }
}

void an_single_slow(an_single *app)
{
    an_slow_step(&app->slow, &app->fast);
    app->slow.envelope = an_texture_step(&app->texture);
}

static bool host_is_silent(const an_single *app)
{
    const float silent_s = (float)(app->fast.window.count - app->host_heard) * period_s(app);
    return app->host_drives && silent_s > AN_SILENCE_S;
}

/* Nothing is decided while a job waits to be taken over: the slow step acts on faults by itself, and does so first. */
void an_single_poll(an_single *app)
{
    if (an_slow_vacant(&app->slow) == NULL) {
        return;
    }
    const uint32_t found = app->fast.faults | app->slow.trips;
    if (app->state != AN_STATE_FAULT && found != 0u) {
        fail(app, found);
    } else if ((app->state == AN_STATE_RUN || app->state == AN_STATE_IDENTIFY) && host_is_silent(app)) {
        fail(app, AN_FAULT_HOST_SILENT);
    } else if (app->stopping) {
        post_rest(app, 0u);
        app->state = AN_STATE_IDLE;
    } else if (app->state == AN_STATE_IDENTIFY) {
        identify(app);
    }
    app->stopping = false;
}
