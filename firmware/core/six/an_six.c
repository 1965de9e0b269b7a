#include "an_six.h"

#include "an_assert.h"
#include "an_bytes.h"
#include "an_complex.h"
#include "an_dds.h"
#include "an_sine.h"
#include "an_wire.h"

#define AN_HEADROOM 0.9f     /* of the drive limit, for the integrals */
#define AN_PROBE_LEVEL 0.01f /* of the drive limit, first level for each actuator */
#define AN_PROBE_MAX 0.5f   /* of the drive limit */
#define AN_PROBE_STEP 16.0f  /* largest ratio of two successive levels */
#define AN_PROBE_HALF 0.5f   /* of the largest level: from there, raising it is not worth a dwell */
#define AN_PROBE_LOW 0.05f   /* of the sensor's full scale: a smaller response is measured again at a higher level */
#define AN_SETTLE 6.0f       /* time constants of a mode near the carrier */
#define AN_GLANCE 1.5f       /* likewise, until the response shows whether the level suits */
#define AN_QUALITY_MOST 1000.0f /* of a plate that has settled by then */
#define AN_PROBE_AIM 0.15f   /* of full scale: intended response of the next actuator */
#define AN_VERIFY2 0.01f     /* squared: largest error of the superposition that T predicts */
#define AN_ERROR2_MAX 0.0475f /* squared, of T: leaves the loop 60 degrees of phase margin, firmware/client/matrix.py */
#define AN_COHERENCE_MIN 0.9f
#define AN_INCOHERENT 1e-12f
#define AN_PI_NUMBER 3.14159265f
#define AN_RINGING 8.0f    /* time constants for which an undriven plate may ring beyond the sensors' range */
#define AN_MISMATCH_TIME 8.0f /* time constants for which a sensor may differ from the model */
#define AN_CHECK_LEVEL 0.1f /* of the drive limit, and of full scale: largest drive and response of a check */
#define AN_CHECK_ERROR2 0.25f /* squared, of the expected response: largest error that agrees */
#define AN_FADED2 1e-4f     /* squared, of the drive limit: small enough to open the gates */
#define AN_SOFT 0.25f      /* time constants, for a pattern to fade in */
#define AN_NO_REFERENCE 1e-6f /* of full scale: far below noise; 0 would select half of the reachable one */
#define AN_PERIODS 2.0f /* least number of carrier periods in a window */

enum { BUILD_NUMBER = 6, WINDOW_MIN = 46, PROBE_AVERAGE = 8, GLANCE_AVERAGE = 2 };

static float period_s(const an_six *app)
{
    return (float)(app->window + AN_SIX_GAP) / app->base.sample_rate_hz;
}

static void choose_window(an_six *app)
{
    const uint32_t fitting = (uint32_t)(AN_PERIODS * app->base.sample_rate_hz / app->shape.frequency_hz + 0.5f);
    app->window = fitting > WINDOW_MIN ? fitting : (uint32_t)WINDOW_MIN;
}

static an_six_job *new_job(an_six *app, uint32_t kind)
{
    an_six_job *job = an_six_slow_vacant(&app->slow);
    if (job == NULL) {
        return NULL;
    }
    an_clear(job, sizeof *job);
    if (!an_demod_plan(&job->demod, app->step, app->window, 1.0f / (float)AN_SIX_ADC_MIDDLE)) {
        return NULL;
    }
    job->kind = kind;
    job->step = app->step;
    job->window = app->window;
    job->channels = app->channels;
    job->drive_limit = app->shape.drive_limit;
    return job;
}

static uint32_t windows_of(const an_six *app, float time_constants)
{
    return (uint32_t)(time_constants * app->shape.tau_s / period_s(app)) + 10u;
}

/* After a fault the drives stop at once, so that slow modes whose excitations cancelled may ring beyond the amplitude
 * held before. */
static bool post_rest(an_application *base, bool clear)
{
    an_six *app = (an_six *)base;
    an_six_job *job = new_job(app, AN_JOB_REST);
    app->slow.reference = 0.0f;
    if (job == NULL) {
        return false;
    }
    job->clear = clear ? 1u : 0u;
    if (app->slow.jobs[app->slow.hand.active & 1u].kind != AN_JOB_REST) {
        app->slow.ringing = windows_of(app, AN_RINGING);
    }
    an_handover_post(&app->slow.hand);
    return true;
}

/* Longest time constant of a mode near the carrier. A drive that grows softly leaves the lower ones, which decay more
 * slowly, almost at rest. */
static float near_s(const an_six *app)
{
    const float most_s = AN_QUALITY_MOST / (AN_PI_NUMBER * app->shape.frequency_hz);
    return app->shape.tau_s < most_s ? app->shape.tau_s : most_s;
}

static uint32_t settle_of(const an_six *app, float time_constants)
{
    return (uint32_t)(time_constants * near_s(app) / period_s(app)) + 2u;
}

/* Share of its way that a first-order filter covers per period: an implicit Euler step of the time constant tau. */
static float share_of(const an_six *app, float tau_s)
{
    const float x = period_s(app) / tau_s;
    return x / (1.0f + x);
}

float an_six_integral(const an_six *app)
{
    return AN_SIX_INTEGRAL * share_of(app, app->shape.tau_s);
}

static float dwell_s(const an_six *app)
{
    return (float)(settle_of(app, AN_SETTLE) + PROBE_AVERAGE) * period_s(app);
}

float an_six_least_s(const an_six *app)
{
    return (float)(app->channels + 1u) * dwell_s(app);
}

/* Drives of a check: with T exact, all sensors show app->probe_level. */
static void read_check(const an_six *app, an_complex *drives)
{
    for (uint32_t i = 0u; i < app->channels; i++) {
        for (uint32_t j = 0u; j < app->channels; j++) {
            drives[i] = an_add(drives[i], an_scale(app->shaping.inverse[i * AN_SIX + j], app->probe_level));
        }
        drives[i] = an_mul(drives[i], an_turn(app->step));
    }
}

static bool post_dwell(an_six *app)
{
    an_six_job *job = new_job(app, AN_JOB_DWELL);
    if (job == NULL) {
        return false;
    }
    if (app->checking) {
        read_check(app, job->drive);
    } else {
        AN_ASSERT(app->probe < app->channels && app->probe_level <= app->shape.drive_limit);
        job->drive[app->probe] = an_scale(an_turn(app->step), app->probe_level);
    }
    const uint32_t settle = settle_of(app, app->glancing ? AN_GLANCE : AN_SETTLE);
    const uint32_t seen = app->glanced ? settle_of(app, AN_GLANCE) + (uint32_t)GLANCE_AVERAGE : 0u;
    job->settle = settle > seen ? settle - seen : 0u;
    job->soft = share_of(app, AN_SOFT * near_s(app));
    job->average = app->glancing ? (uint32_t)GLANCE_AVERAGE : (uint32_t)PROBE_AVERAGE;
    app->probed_s += (float)(job->settle + job->average) * period_s(app);
    an_handover_post(&app->slow.hand);
    return true;
}

static void fail(an_six *app, an_fault fault)
{
    an_application_fail(&app->base, &an_six_build, fault);
}

/* Targets are relative to the largest, which is 1. A pilot in quadrature changes the largest motion least. */
static void read_targets(const an_six *app, an_complex *targets)
{
    an_clear(targets, AN_SIX * sizeof *targets);
    for (uint32_t i = 0u; i < app->channels; i++) {
        targets[i] = an_table_target(&app->table, app->base.slot, app->pattern, i);
        if (an_abs2(targets[i]) < AN_SIX_PILOT * AN_SIX_PILOT) {
            targets[i] = an_cplx(0.0f, AN_SIX_PILOT);
        }
    }
}

/* Largest reference for which the drives stay within the limit, with some headroom. */
static float reach_of(const an_six *app)
{
    an_complex targets[AN_SIX];
    read_targets(app, targets);
    const float reach = AN_HEADROOM * app->shape.drive_limit / (an_shaping_effort(&app->shaping, targets) + 1e-6f);
    return reach < AN_HEADROOM ? reach : AN_HEADROOM;
}

static bool post_track(an_six *app)
{
    an_six_job *job = new_job(app, AN_JOB_TRACK);
    if (job == NULL) {
        return false;
    }
    const an_complex ahead = an_turn(app->step);
    for (uint32_t i = 0u; i < AN_SIX * AN_SIX; i++) {
        job->inverse[i] = an_mul(app->shaping.inverse[i], ahead);
    }
    read_targets(app, job->target);
    app->eased = app->base.eased;
    job->drive_limit *= app->eased ? AN_EASED : 1.0f;
    job->soft = share_of(app, AN_SOFT * app->shape.tau_s);
    job->integral = an_six_integral(app);
    job->patience = (uint32_t)AN_SIX_DOUBT * windows_of(app, AN_MISMATCH_TIME);
    an_handover_post(&app->slow.hand);
    return true;
}

/* Hold the pattern at the reference requested last, clipped to the reachable one, or at half the reachable one if the
 * start gave no reference. */
static void begin_run(an_six *app)
{
    app->reachable = reach_of(app);
    an_six_set_reference(app, app->half_reach ? 0.5f * app->reachable : app->target_reference);
    app->half_reach = false;
    if (post_track(app)) {
        an_supervisor_enter(&app->base.supervisor, AN_STATE_RUN);
    } else {
        fail(app, AN_FAULT_SHAPING);
    }
}

static void begin_identify(an_application *base)
{
    an_six *app = (an_six *)base;
    app->probing = 0u;
    app->probed_s = 0.0f;
    app->checking = false;
    app->verifying = false;
    app->glancing = true;
    app->glanced = false;
    app->probe = 0u;
    app->probe_level = AN_PROBE_LEVEL * app->shape.drive_limit;
    app->motion = 0.0f;
    app->misfit = 0.0f;
}

static void drive_all(an_six *app)
{
    an_complex targets[AN_SIX];
    an_clear(targets, sizeof targets);
    for (uint32_t i = 0u; i < app->channels; i++) {
        targets[i] = an_cplx(1.0f, 0.0f);
    }
    app->checking = true;
    app->glancing = false;
    const float reached = app->shape.drive_limit / (an_shaping_effort(&app->shaping, targets) + 1e-6f);
    app->probe_level = AN_CHECK_LEVEL * (reached < 1.0f ? reached : 1.0f);
}

/* The first drive with values from a table, or from before a reset, is a check. */
static void begin_check(an_six *app)
{
    begin_identify(&app->base);
    drive_all(app);
}

static void read_matrix(an_six *app)
{
    an_complex column[AN_SIX];
    for (uint32_t j = 0u; j < app->channels; j++) {
        for (uint32_t i = 0u; i < app->channels; i++) {
            column[i] = an_table_matrix(&app->table, app->base.slot, i, j);
        }
        an_shaping_set(&app->shaping, j, column, 1.0f);
    }
    app->identified = an_shaping_invert(&app->shaping) ? 1u : 0u;
}

static void read_shape(an_six *app, uint32_t index)
{
    an_table_shape(&app->table, index, &app->shape);
    app->base.slot = index;
    app->channels = app->table.sensor_count;
    app->step = an_dds_step(app->shape.frequency_hz, app->base.sample_rate_hz);
    app->identified = 0u;
    app->base.confirmed = false;
    app->reachable = 0.0f;
    app->motion = 0.0f;
    app->misfit = 0.0f;
    an_clear(app->coherence, sizeof app->coherence);
    an_shaping_init(&app->shaping, app->channels);
    choose_window(app);
    if ((app->shape.flags & AN_MATRIX_IDENTIFIED) != 0u) {
        read_matrix(app);
    }
}

static an_table_result accepts(const an_table *table, float sample_rate_hz)
{
    if (table->shape_count == 0u || table->sample_rate_hz != sample_rate_hz) {
        return AN_TABLE_OTHER_BUILD;
    }
    for (uint32_t i = 0u; i < table->shape_count; i++) {
        an_shape_head shape;
        an_table_shape(table, i, &shape);
        if (shape.frequency_hz < (float)AN_SIX_FREQUENCY_MIN_HZ) {
            return AN_TABLE_RANGE;
        }
    }
    return AN_TABLE_OK;
}

void an_six_boot(an_six *app, const uint8_t *table, uint32_t length, float sample_rate_hz, uint32_t faults)
{
    const uint32_t chosen = app->base.chosen;
    const uint32_t measured = app->base.measured;
    an_clear(app, sizeof *app);
    app->base.chosen = chosen;
    app->base.measured = measured;
    app->base.sample_rate_hz = sample_rate_hz;
    app->step = an_dds_step(0.1f * sample_rate_hz, sample_rate_hz);
    app->window = WINDOW_MIN;
    const bool accepted = an_table_open(&app->table, table, length) == AN_TABLE_OK &&
                          accepts(&app->table, sample_rate_hz) == AN_TABLE_OK;
    if (accepted) {
        read_shape(app, 0u);
    }
    an_six_slow_init(&app->slow, &app->fast, app->step, app->window);
    an_application_boot(&app->base, sample_rate_hz, accepted ? faults : faults | AN_FAULT_TABLE);
}

bool an_six_choose(an_six *app, uint32_t shape)
{
    if (shape >= app->table.shape_count || !an_application_is_ready(&app->base, &an_six_build)) {
        return false;
    }
    read_shape(app, shape);
    app->base.chosen++;
    return post_rest(&app->base, false);
}

bool an_six_start(an_six *app, uint32_t pattern, float reference)
{
    if (pattern >= app->shape.pattern_count || !an_application_may_refer(reference) ||
        !an_application_is_ready(&app->base, &an_six_build)) {
        return false;
    }
    app->pattern = pattern;
    app->target_reference = reference;
    app->half_reach = reference == 0.0f;
    if (app->identified != 0u && app->base.confirmed) {
        an_supervisor_begin(&app->base.supervisor, AN_STATE_RUN);
        begin_run(app);
        return true;
    }
    an_supervisor_begin(&app->base.supervisor, AN_STATE_IDENTIFY);
    if (app->identified != 0u) {
        begin_check(app);
    } else {
        begin_identify(&app->base);
    }
    return true;
}

bool an_six_change(an_six *app, uint32_t pattern)
{
    if (app->base.supervisor.state != AN_STATE_RUN || pattern >= app->shape.pattern_count ||
        an_six_slow_vacant(&app->slow) == NULL) {
        return false;
    }
    app->pattern = pattern;
    begin_run(app);
    return true;
}

void an_six_set_reference(an_six *app, float reference)
{
    if (reference >= 0.0f) {
        app->target_reference = reference;
        const float reached = reference < app->reachable ? reference : app->reachable;
        app->slow.reference = app->base.eased ? AN_EASED * reached : reached;
    }
}

static float largest_response(const an_six *app, uint32_t average)
{
    float largest = 0.0f;
    for (uint32_t i = 0u; i < app->channels; i++) {
        const float size = an_abs(app->slow.total[i]) / (float)average;
        largest = size > largest ? size : largest;
    }
    return largest;
}

/* Before it is used, T must predict what all actuators together do. */
static void end_columns(an_six *app)
{
    app->identified = 0u;
    if (an_shaping_invert(&app->shaping)) {
        app->verifying = true;
        drive_all(app);
    } else {
        fail(app, AN_FAULT_SHAPING);
    }
}

/* Whether noise and misfit leave the loop its margins: mean square of the elements of T^-1 dT, with the variances dT^2 of
 * means over PROBE_AVERAGE windows. */
static bool is_fit(const an_six *app)
{
    float power = 0.0f;
    float heard = 0.0f;
    float error2 = app->misfit * app->misfit;
    for (uint32_t i = 0u; i < app->channels; i++) {
        float weight = 0.0f;
        for (uint32_t j = 0u; j < app->channels; j++) {
            weight += an_abs2(app->shaping.inverse[j * AN_SIX + i]) / (float)(PROBE_AVERAGE - 1);
        }
        for (uint32_t j = 0u; j < app->channels; j++) {
            const float own = an_abs2(app->shaping.matrix[i * AN_SIX + j]);
            const float all = own / (app->coherence[i * AN_SIX + j] + AN_INCOHERENT);
            power += own;
            heard += all;
            error2 += weight * (all - own);
        }
    }
    return power >= AN_COHERENCE_MIN * heard && error2 <= AN_ERROR2_MAX;
}

/* What may not be held is kept to be read, but measured again by the next start. */
static void end_identify(an_six *app)
{
    app->checking = false;
    if (!(app->misfit * app->misfit < AN_VERIFY2)) {
        fail(app, AN_FAULT_IDENTIFY);
        return;
    }
    if (!is_fit(app)) {
        if (!an_application_ends_measurement(&app->base, &an_six_build)) {
            fail(app, AN_FAULT_IDENTIFY);
        }
        return;
    }
    app->identified = 1u;
    if (!an_application_is_measured(&app->base, &an_six_build)) {
        begin_run(app);
    }
}

/* Raise the level if the response is too small; false if it may stay. */
static bool raise_level(an_six *app, float response)
{
    const float most = AN_PROBE_MAX * app->shape.drive_limit;
    if (response >= AN_PROBE_LOW || app->probe_level > AN_PROBE_HALF * most) {
        return false;
    }
    const float ratio = AN_PROBE_STEP * response > AN_PROBE_AIM ? AN_PROBE_AIM / response : AN_PROBE_STEP;
    const float raised = ratio * app->probe_level;
    app->probe_level = raised < most ? raised : most;
    return true;
}

/* Magnitude-squared coherence of drive and sensor, from the windows of a dwell. */
static void note_coherence(an_six *app)
{
    for (uint32_t i = 0u; i < app->channels; i++) {
        const float energy = (float)PROBE_AVERAGE * app->slow.energy[i];
        const float own = energy > 0.0f ? an_abs2(app->slow.total[i]) / energy : 0.0f;
        app->coherence[i * AN_SIX + app->probe] = own;
    }
}

/* Take a column of T from the dwell of one actuator, or raise the level for another one. A glance after a part of the dwell
 * shows early that the level is too low. */
static void take_column(an_six *app)
{
    const float response = largest_response(app, app->glancing ? (uint32_t)GLANCE_AVERAGE : (uint32_t)PROBE_AVERAGE);
    const bool raised = raise_level(app, response);
    app->glanced = app->glancing && !raised;
    app->glancing = raised;
    if (raised || app->glanced) {
        return;
    }
    app->glancing = true;
    note_coherence(app);
    const float scale = 1.0f / (app->probe_level * (float)PROBE_AVERAGE);
    an_shaping_set(&app->shaping, app->probe, app->slow.total, scale);
    app->motion = response > app->motion ? response : app->motion;
    app->probe++;
    app->probe_level *= response > AN_PROBE_AIM ? AN_PROBE_AIM / response : 1.0f;
}

/* Largest error of a sensor, squared; NaN counts as large. */
static float error2_of(const an_six *app)
{
    float largest2 = 0.0f;
    for (uint32_t i = 0u; i < app->channels; i++) {
        const an_complex shown = an_scale(app->slow.total[i], 1.0f / ((float)PROBE_AVERAGE * app->probe_level));
        const float error2 = an_abs2(an_sub(shown, an_cplx(1.0f, 0.0f)));
        largest2 = error2 <= largest2 ? largest2 : error2;
    }
    return largest2;
}

/* Drive with the known values if they agree with the plate; otherwise measure them again. After a mismatch, it is the
 * sensors that may have failed, or a hand that stays. */
static void end_check(an_six *app)
{
    const float error2 = error2_of(app);
    if (app->verifying) {
        app->misfit = __builtin_sqrtf(error2);
        end_identify(app);
    } else if (error2 < AN_CHECK_ERROR2) {
        app->base.confirmed = true;
        app->checking = false;
        begin_run(app);
    } else if (app->base.retry.used > 0u) {
        fail(app, AN_FAULT_MISMATCH);
    } else {
        begin_identify(&app->base);
    }
}

static void identify(an_application *base)
{
    an_six *app = (an_six *)base;
    if (app->probe >= app->channels && !app->checking) {
        fail(app, AN_FAULT_MEMORY);
        return;
    }
    if (app->probing != 0u) {
        if (!an_dwell_finished(&app->slow.dwell)) {
            return;
        }
        if (app->checking) {
            end_check(app);
        } else {
            take_column(app);
        }
    }
    if (base->supervisor.state != AN_STATE_IDENTIFY) {
        return;
    }
    if (app->probe == app->channels) {
        end_columns(app);
    }
    if (base->supervisor.state != AN_STATE_IDENTIFY) {
        return;
    }
    if (app->probed_s + dwell_s(app) > AN_IDENTIFY_MAX_S || !post_dwell(app)) {
        fail(app, AN_FAULT_IDENTIFY);
    } else {
        app->probing = 1u;
    }
}

void an_six_window_end(an_six *app)
{
    if (an_supervisor_drives(&app->base.supervisor)) {
        app->slow.ringing = 0u;
    }
    an_six_slow_step(&app->slow, &app->fast);
    app->slow.envelope = an_texture_step(&app->base.texture);
}

static uint32_t check_ticks(an_six *app)
{
    const uint32_t most = AN_SIX_GAP + (uint32_t)(AN_PERIODS * app->base.sample_rate_hz) / AN_SIX_FREQUENCY_MIN_HZ + 1u;
    if (app->fast.tick <= app->fast.end && app->fast.end <= most) {
        return 0u;
    }
    app->fast.end = most;
    app->fast.tick = 0u;
    return AN_FAULT_MEMORY;
}

/* Replace an index beyond its array by the last valid one. */
static uint32_t check_index(uint32_t *index, uint32_t most)
{
    if (*index <= most) {
        return 0u;
    }
    *index = most;
    return AN_FAULT_MEMORY;
}

static uint32_t check_indices(an_six *app)
{
    an_six_fast *fast = &app->fast;
    return check_index(&fast->acting, AN_SIX_REST_BANK) | check_index(&fast->growing, AN_SIX_GAP_BANK) |
           check_index(&fast->command.bank, 1u) | check_index(&fast->window.bank, 1u) |
           check_index(&app->channels, AN_SIX) | check_index(&app->slow.jobs[0].channels, AN_SIX) |
           check_index(&app->slow.jobs[1].channels, AN_SIX);
}

/* Check that the samples of a window are added up in the bank of that window. */
static uint32_t check_growing(an_six_fast *fast)
{
    const uint32_t bank = fast->tick < AN_SIX_GAP ? (uint32_t)AN_SIX_GAP_BANK : fast->window.bank ^ 1u;
    const bool follows = fast->growing == bank;
    fast->growing = bank;
    return follows ? 0u : (uint32_t)AN_FAULT_MEMORY;
}

/* Check that drive, phase step and window are those commanded by the slow step for the active job, and that the
 * mismatch counter is plausible. After a fault the tick is at rest and ignores late commands. */
static uint32_t check_job(const an_six *app)
{
    const an_six_fast *fast = &app->fast;
    const an_six_job *job = &app->slow.jobs[app->slow.hand.active & 1u];
    const bool acts = fast->faults != 0u || fast->tick < AN_SIX_GAP || (fast->step == job->step && fast->end == AN_SIX_GAP + job->window &&
                                                  fast->acting == fast->command.bank);
    const bool rests = fast->faults != 0u || job->kind != AN_JOB_TRACK;
    const bool counts = rests || app->slow.mismatched <= job->patience + (uint32_t)AN_SIX_DOUBTS_MAX;
    const bool limits = rests || (app->slow.limit > 0.0f && app->slow.limit <= 1.0f);
    return acts && counts && limits && an_handover_is_sound(&app->slow.hand) ? 0u : (uint32_t)AN_FAULT_MEMORY;
}

static uint32_t check_sensors(const an_six *app)
{
    const bool rings_on = app->slow.ringing != 0u && !an_supervisor_drives(&app->base.supervisor);
    const uint32_t clipped = app->fast.clipped + app->fast.window.clipped;
    return clipped > AN_SIX_CLIPPED_MAX && !rings_on ? (uint32_t)AN_FAULT_SENSOR_CLIPPED : 0u;
}

uint32_t an_six_check(an_six *app)
{
    return check_ticks(app) | check_indices(app) | check_growing(&app->fast) | check_job(app) | check_sensors(app);
}

/* True while the closed loop drives the plate: once a fault has opened the gates it does not. */
static bool is_tracking(const an_six *app)
{
    const an_handover *hand = &app->slow.hand;
    return app->base.supervisor.state == AN_STATE_RUN && app->slow.jobs[hand->active & 1u].kind == AN_JOB_TRACK &&
           hand->trips == 0u;
}

/* Check that since the last sample the phase accumulator advanced by one step, and the tick by one or to a new period. */
static uint32_t check_advance(an_six *app)
{
    const bool turned = app->fast.phase - app->fast.step == app->phase;
    const uint32_t next = app->tick + 1u;
    const bool follows = turned && (app->fast.tick == next || (app->fast.tick == 0u && next == app->fast.end));
    app->phase = app->fast.phase;
    app->tick = app->fast.tick;
    return follows ? 0u : (uint32_t)AN_FAULT_MEMORY;
}

/* Clipping is a separate fault, so clipped samples are not judged here. */
uint32_t an_six_look(an_six *app, const uint16_t *adc)
{
    const uint32_t clipped = app->fast.clipped + app->fast.window.clipped;
    const uint32_t found = check_advance(app);
    if (!is_tracking(app) || clipped != 0u) {
        an_six_watch_forget(&app->watch);
        return found;
    }
    const bool failed = an_six_watch_look(&app->watch, &app->slow, &app->fast, adc, app->channels);
    return failed ? found | AN_FAULT_MISMATCH : found;
}

/* The integrals follow the plate by themselves. An eased drive gets half the reference, so that the model still holds. */
static void follow(an_application *base)
{
    an_six *app = (an_six *)base;
    if (app->eased != base->eased && post_track(app)) {
        an_six_set_reference(app, app->target_reference);
    }
}

static bool drives_above(const an_six *app, float share2)
{
    const float limit2 = app->shape.drive_limit * app->shape.drive_limit;
    for (uint32_t i = 0u; i < app->channels; i++) {
        if (an_abs2(app->slow.drive[i]) > share2 * limit2) {
            return true;
        }
    }
    return false;
}

static an_moment moment(const an_application *base)
{
    const an_six *app = (const an_six *)base;
    const an_moment now = {
        .vacant = an_handover_vacant(&app->slow.hand),
        .job = app->slow.jobs[app->slow.hand.active & 1u].kind,
        .faults = app->fast.faults | app->slow.hand.trips,
        .limited = base->supervisor.state == AN_STATE_RUN && app->slow.limited != 0u,
        .hard = base->supervisor.state == AN_STATE_RUN && drives_above(app, AN_HARD2),
        .window = app->fast.window.count,
        .window_hz = 1.0f / period_s(app),
    };
    return now;
}

static const an_table *table_of(const an_application *base)
{
    return &((const an_six *)base)->table;
}

static uint32_t entries(const an_table *table)
{
    return table->shape_count;
}

static void trip(an_application *base, uint32_t faults)
{
    an_handover_trip(&((an_six *)base)->fast.faults, faults);
}

/* A stop fades the pattern out as softly as it faded in, so that no slow mode is set free. */
static bool fades(an_application *base)
{
    an_six *app = (an_six *)base;
    app->slow.fading = 1u;
    return drives_above(app, AN_FADED2);
}

/* A retry checks the plate at a low level first. */
static bool restart(an_application *base)
{
    an_six *app = (an_six *)base;
    base->confirmed = false;
    const float target = app->target_reference > 0.0f ? app->target_reference : AN_NO_REFERENCE;
    return an_six_start(app, app->pattern, app->half_reach ? 0.0f : target);
}

static void set_reference(an_application *base, float reference)
{
    an_six_set_reference((an_six *)base, reference);
}

static uint8_t *put_values(const an_application *base, uint8_t *at)
{
    const an_six *app = (const an_six *)base;
    return an_put_object(at, app->shaping.matrix, sizeof app->shaping.matrix);
}

static bool take_values(an_application *base, const uint8_t *values, uint32_t length)
{
    an_six *app = (an_six *)base;
    if (length != sizeof app->shaping.matrix) {
        return false;
    }
    an_get_object(app->shaping.matrix, values, sizeof app->shaping.matrix);
    app->identified = an_shaping_invert(&app->shaping) ? 1u : 0u;
    return app->identified != 0u;
}

const an_build an_six_build = {
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
    .fades = fades,
    .restart = restart,
    .set_reference = set_reference,
    .put_status = an_six_put_status,
    .put_values = put_values,
    .take_values = take_values,
    .handle_request = an_six_handle_request,
};

an_record an_six_record(const an_six *app)
{
    const an_six_job *job = &app->slow.jobs[app->slow.hand.active & 1u];
    uint32_t best = 0u;
    for (uint32_t i = 1u; i < app->channels; i++) {
        if (an_abs2(job->target[i]) > an_abs2(job->target[best])) {
            best = i;
        }
    }
    const an_record record = {
        .window = app->fast.window.count,
        .measured = app->slow.measured[best],
        .drive = app->slow.drive[best],
        .reference = app->slow.reference * app->slow.envelope,
    };
    return record;
}
