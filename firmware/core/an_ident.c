#include "an_ident.h"

#include "an_complex.h"
#include "an_dds.h"
#include "an_sine.h"

#define AN_PI_NUMBER 3.14159265f
#define AN_START_LEVEL 0.01f    /* of full scale */
#define AN_LEAST_LEVEL 1e-4f
#define AN_FIRST_SPAN 0.01f     /* of the frequency, to either side */
#define AN_WIDEST_SPAN 0.04f
#define AN_AIM 0.4f             /* of the amplitude limit, at the peak of the fine sweep */
#define AN_COARSE_SETTLE 4.0f   /* time constants */
#define AN_FINE_SETTLE 6.0f
#define AN_SURVEY_SETTLE 3.0f
#define AN_SURVEY_SPAN_HZ 1500.0f
#define AN_SURVEY_LEVEL 0.25f /* of the fine sweep's: a neighbour may be stronger */
#define AN_MISFIT_MAX 0.03f
#define AN_TWO_PI 6.2831853f

enum { COARSE_AVERAGE = 4, FINE_AVERAGE = 8, SURVEY_AVERAGE = 4, SPREAD_POINTS_MAX = 255, ROUNDS_MAX = 5 };

/* Full width of |U| at -3 dB, Hz. */
static float bandwidth_hz(const an_mode *mode)
{
    return 1.0f / (AN_PI_NUMBER * mode->tau_s);
}

/* So many points, half a bandwidth apart, that no resonance of that width slips through. */
static void spread(an_ident *ident, float span_hz)
{
    const float spacing = 0.5f * bandwidth_hz(&ident->mode);
    const float half_points = span_hz / spacing + 1.0f;
    const float most = 0.5f * (float)(SPREAD_POINTS_MAX - 1);
    ident->points = 2u * (uint32_t)(half_points < most ? half_points : most) + 1u;
    ident->span_hz = spacing * 0.5f * (float)(ident->points - 1u);
    ident->index = 0u;
}

static void begin_coarse(an_ident *ident, float span_hz)
{
    ident->stage = AN_IDENT_COARSE;
    spread(ident, span_hz);
    ident->best = 0u;
    ident->best_size = 0.0f;
}

static void begin_fine(an_ident *ident)
{
    ident->stage = AN_IDENT_FINE;
    ident->points = AN_RESONANCE_POINTS;
    ident->span_hz = bandwidth_hz(&ident->mode);
    ident->index = 0u;
}

static void begin_survey(an_ident *ident)
{
    const float most = 0.1f * ident->mode.frequency_hz;
    ident->stage = AN_IDENT_SURVEY;
    ident->level *= AN_SURVEY_LEVEL;
    ident->neighbour = 0.0f;
    spread(ident, AN_SURVEY_SPAN_HZ < most ? AN_SURVEY_SPAN_HZ : most);
}

void an_ident_init(an_ident *ident, const an_mode *guess, bool senses_displacement, float sample_rate_hz)
{
    ident->mode = *guess;
    ident->sample_rate_hz = sample_rate_hz;
    ident->quarter_turns = senses_displacement ? 1u : 0u;
    ident->rounds = 0u;
    ident->misfit = 0.0f;
    ident->neighbour = 0.0f;
    ident->centre = an_dds_step(guess->frequency_hz, sample_rate_hz);
    ident->level = AN_START_LEVEL < guess->drive_limit ? AN_START_LEVEL : guess->drive_limit;
    begin_coarse(ident, AN_FIRST_SPAN * guess->frequency_hz);
}

static float offset_hz(const an_ident *ident, uint32_t index)
{
    return ident->span_hz * (2.0f * (float)index / (float)(ident->points - 1u) - 1.0f);
}

static uint32_t step_of(const an_ident *ident, uint32_t index)
{
    return an_dds_shifted(ident->centre, offset_hz(ident, index), ident->sample_rate_hz);
}

void an_ident_probe(const an_ident *ident, an_probe *probe)
{
    static const float settle[] = {AN_COARSE_SETTLE, AN_FINE_SETTLE, AN_SURVEY_SETTLE};
    static const uint8_t average[] = {COARSE_AVERAGE, FINE_AVERAGE, SURVEY_AVERAGE};
    const uint32_t stage = ident->stage <= AN_IDENT_SURVEY ? ident->stage : AN_IDENT_SURVEY;
    probe->step = step_of(ident, ident->index);
    probe->level = ident->level;
    probe->settle_s = settle[stage] * ident->mode.tau_s;
    probe->average = average[stage];
}

/* A peak inside the sweep sets the level and the centre of the fine one; at its edge the sweep is widened. */
static void end_coarse(an_ident *ident)
{
    const bool inside = ident->best > 0u && ident->best + 1u < ident->points;
    const bool widest = 2.0f * ident->span_hz > AN_WIDEST_SPAN * 1.05f * ident->mode.frequency_hz;
    if (!(ident->best_size > 0.0f) || (!inside && widest)) {
        ident->stage = AN_IDENT_FAILED;
    } else if (inside) {
        const float wanted = AN_AIM * ident->mode.amplitude_limit * ident->level / ident->best_size;
        ident->centre = step_of(ident, ident->best);
        ident->level = wanted < ident->mode.drive_limit ? wanted : ident->mode.drive_limit;
        begin_fine(ident);
    } else {
        begin_coarse(ident, 2.0f * ident->span_hz);
    }
}

static void answer_coarse(an_ident *ident, an_complex measured)
{
    const float size = an_abs(measured);
    if (size > 0.5f * ident->mode.amplitude_limit) {
        ident->level *= 0.25f;
        begin_coarse(ident, ident->span_hz);
        ident->stage = ident->level > AN_LEAST_LEVEL ? AN_IDENT_COARSE : AN_IDENT_FAILED;
        return;
    }
    if (size > ident->best_size) {
        ident->best_size = size;
        ident->best = ident->index;
    }
    ident->index++;
    if (ident->index == ident->points) {
        end_coarse(ident);
    }
}

/* exp(j w late) at a point of the sweep. */
static an_complex lead_of(const an_ident *ident, uint32_t index, float late_s)
{
    const float turns = (an_dds_frequency(ident->centre, ident->sample_rate_hz) + offset_hz(ident, index)) * late_s;
    const float rest = turns - (float)(int32_t)turns;
    return an_turn((uint32_t)(int32_t)(rest * 2147483648.0f) << 1);
}

/* Takes so much delay out of every response. */
static void advance(an_ident *ident, float late_s)
{
    for (uint32_t i = 0u; i < ident->points; i++) {
        ident->response[i] = an_mul(ident->response[i], lead_of(ident, i, late_s));
    }
}

/* A real mode's gain is real for velocity, 90 degrees behind for displacement, of either sign: what is left of its
 * phase, to a quarter of a turn, is delay the guess did not know. */
static float unknown_delay(const an_ident *ident, an_complex gain, float frequency_hz)
{
    const uint32_t excess = an_phase_of(gain) + ident->quarter_turns * 0x40000000u;
    const float half_turns = (float)(int32_t)(excess << 1) / AN_PHASE_TURN;
    const float delay_s = -0.5f * half_turns / frequency_hz;
    return ident->mode.delay_s + delay_s >= 0.0f ? delay_s : delay_s + 0.5f / frequency_hz;
}

static bool fit_without_delay(an_ident *ident, an_resonance *fit)
{
    const float centre_hz = an_dds_frequency(ident->centre, ident->sample_rate_hz);
    advance(ident, ident->mode.delay_s);
    for (uint32_t i = 0u; i < 2u; i++) {
        if (!an_resonance_fit(fit, ident->response, ident->points, ident->span_hz)) {
            return false;
        }
        const float late_s = unknown_delay(ident, fit->gain, centre_hz + fit->offset_hz);
        ident->mode.delay_s += late_s;
        advance(ident, late_s);
    }
    return an_resonance_fit(fit, ident->response, ident->points, ident->span_hz);
}

/* The pole turns at the damped frequency; the table and the peak of |U| speak of the undamped one. */
static float undamped_offset(const an_ident *ident, const an_resonance *fit)
{
    const float rate_hz = 1.0f / (2.0f * AN_PI_NUMBER * fit->tau_s);
    return fit->offset_hz + 0.5f * rate_hz * rate_hz / an_dds_frequency(ident->centre, ident->sample_rate_hz);
}

static void end_fine(an_ident *ident)
{
    an_resonance fit;
    const float planned_tau_s = ident->mode.tau_s;
    const float planned_width_hz = bandwidth_hz(&ident->mode);
    ident->rounds++;
    if (!fit_without_delay(ident, &fit) || !(fit.misfit < AN_MISFIT_MAX) || ident->rounds > ROUNDS_MAX) {
        ident->stage = AN_IDENT_FAILED;
        return;
    }
    const float away = fit.offset_hz < 0.0f ? -fit.offset_hz : fit.offset_hz;
    const float longer = fit.tau_s / planned_tau_s;
    ident->centre = an_dds_shifted(ident->centre, undamped_offset(ident, &fit), ident->sample_rate_hz);
    ident->mode.frequency_hz = an_dds_frequency(ident->centre, ident->sample_rate_hz);
    ident->mode.tau_s = fit.tau_s;
    ident->mode.gain = fit.gain;
    ident->misfit = fit.misfit;
    if (away < 0.4f * planned_width_hz && longer > 0.8f && longer < 1.25f) {
        begin_survey(ident);
    } else {
        begin_fine(ident);
    }
}

static void answer_fine(an_ident *ident, an_complex measured)
{
    ident->response[ident->index] = an_scale(measured, 1.0f / ident->level);
    ident->index++;
    if (ident->index == ident->points) {
        end_fine(ident);
    }
}

static void answer_survey(an_ident *ident, an_complex measured)
{
    const an_complex response = an_scale(measured, 1.0f / ident->level);
    const float slope = AN_TWO_PI * offset_hz(ident, ident->index) * ident->mode.tau_s;
    const an_complex own = an_div(ident->mode.gain, an_cplx(1.0f, slope));
    const an_complex late = an_conj(lead_of(ident, ident->index, ident->mode.delay_s));
    const float beside = an_abs(an_sub(response, an_mul(own, late)));
    ident->neighbour = beside > ident->neighbour ? beside : ident->neighbour;
    ident->index++;
    if (ident->index == ident->points) {
        ident->stage = AN_IDENT_DONE;
    }
}

void an_ident_answer(an_ident *ident, an_complex measured)
{
    if (!an_is_finite(an_abs2(measured))) {
        ident->stage = AN_IDENT_FAILED;
    } else if (ident->stage == AN_IDENT_COARSE) {
        answer_coarse(ident, measured);
    } else if (ident->stage == AN_IDENT_FINE) {
        answer_fine(ident, measured);
    } else if (ident->stage == AN_IDENT_SURVEY) {
        answer_survey(ident, measured);
    }
}
