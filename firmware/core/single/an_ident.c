#include "an_ident.h"

#include "an_bytes.h"
#include "an_complex.h"
#include "an_dds.h"
#include "an_fast.h"
#include "an_sine.h"

#define AN_PI_NUMBER 3.14159265f
#define AN_START_LEVEL 0.01f    /* of full scale */
#define AN_MIN_LEVEL 1e-4f
#define AN_COARSE_MAX 0.16f    /* of the drive limit, while only noise is seen */
#define AN_LEVEL_STEP 4.0f     /* ratio of two successive drive levels */
#define AN_MIN_SPAN 0.01f      /* of the frequency, to either side: shortest coarse sweep */
#define AN_MAX_SPAN 0.04f      /* likewise: longest */
#define AN_MIN_SPACINGS 4.0f   /* shortest coarse sweep in half bandwidths */
#define AN_NOISE_RATIO 6.0f    /* smallest peak over rms noise; noise alone exceeds it at one point in 4e15 */
#define AN_MIN_PEAK 0.002f     /* of full scale, four codes: quantisation dominates smaller responses */
#define AN_MEDIAN_RATIO 1.6f   /* smallest peak over median; a resonance swept over four half bandwidths has 2.2 */
#define AN_SKIRT 0.7f          /* of the peak, at half a bandwidth from it */
#define AN_FINE_RESPONSE 0.4f  /* of the amplitude limit: intended peak of the fine sweep */
#define AN_COARSE_RESPONSE_MAX 0.5f /* of the amplitude limit */
#define AN_RATIO_MIN 0.4f      /* response after a change of level, over the response that linearity predicts */
#define AN_RATIO_MAX 3.0f
#define AN_TAU_RATIO 8.0f      /* largest ratio of fitted and assumed time constants, either way */
#define AN_COARSE_SETTLE 4.0f   /* time constants */
#define AN_FINE_SETTLE 6.0f
#define AN_SURVEY_SETTLE 3.0f
#define AN_SURVEY_SPAN_HZ 1500.0f
#define AN_SURVEY_LEVEL 0.25f /* of the fine sweep's level: a neighbouring mode may respond more strongly */
#define AN_MISFIT_MAX 0.03f
#define AN_MISFIT_LINEAR 0.006f /* a larger misfit is worth one more sweep at a lower level */
#define AN_GAIN_LINEAR 0.9f /* of the coarse sweep's gain: a smaller one is measured again at a lower level */
#define AN_REPEAT_LEVEL 0.25f /* of the level before */
#define AN_REPEAT_MIN 0.01f   /* of full scale: smallest peak of a repeated sweep */
#define AN_SURVEY_NOISE 6.0f  /* times the variance: the largest of 255 responses to noise alone */
#define AN_CHECK_SETTLE 6.0f
#define AN_CHECK_RESPONSE 0.02f  /* of full scale: intended response to a check */
#define AN_CHECK_LIMIT 0.25f     /* of the amplitude limit: largest intended response */
#define AN_CHECK_RATIO2 16.0f    /* squared: largest ratio of response and expected response, either way */
#define AN_TWO_PI 6.2831853f

enum { COARSE_AVERAGE = 4, FINE_AVERAGE = 8, SURVEY_AVERAGE = 4, CHECK_AVERAGE = 8, SURVEY_POINTS_MAX = 255, ROUNDS_MAX = 5 };
enum { FIRST_BIN = 2 * (127 - 24) }; /* exponent and leading mantissa bit of the float 2^-24 */

/* Full width of the resonance curve |U| at -3 dB, in Hz. */
static float bandwidth_hz(const an_mode *mode)
{
    return 1.0f / (AN_PI_NUMBER * mode->tau_s);
}

/* Sweep outwards from the guess, alternating between both sides, to a bandwidth beyond AN_MAX_SPAN. A spacing of half a
 * bandwidth cannot miss a resonance of that width. */
static void begin_coarse(an_ident *ident, float level)
{
    ident->stage = AN_IDENT_COARSE;
    ident->level = level;
    ident->spacing_hz = 0.5f * bandwidth_hz(&ident->mode);
    ident->points = 2u * ((uint32_t)(AN_MAX_SPAN * ident->mode.frequency_hz / ident->spacing_hz) + 3u) + 1u;
    ident->index = 0u;
    ident->best = 0u;
    ident->best_size = 0.0f;
    ident->noise2 = 0.0f;
    an_clear(ident->sizes, sizeof ident->sizes);
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
    const float span_hz = AN_SURVEY_SPAN_HZ < most ? AN_SURVEY_SPAN_HZ : most;
    const float spacing_hz = 0.5f * bandwidth_hz(&ident->mode);
    const float half_points = span_hz / spacing_hz + 1.0f;
    const float points_max = 0.5f * (float)(SURVEY_POINTS_MAX - 1);
    ident->stage = AN_IDENT_SURVEY;
    ident->level *= ident->repeats == 0u ? AN_SURVEY_LEVEL : 1.0f; /* otherwise the resonance would shift again */
    ident->neighbour = 0.0f;
    ident->noise2 = 0.0f;
    ident->points = 2u * (uint32_t)(half_points < points_max ? half_points : points_max) + 1u;
    ident->span_hz = spacing_hz * 0.5f * (float)(ident->points - 1u);
    ident->index = 0u;
}

void an_ident_init(an_ident *ident, const an_mode *guess, bool senses_displacement, float sample_rate_hz)
{
    ident->mode = *guess;
    ident->sample_rate_hz = sample_rate_hz;
    ident->quarter_turns = senses_displacement ? 1u : 0u;
    ident->rounds = 0u;
    ident->repeats = 0u;
    ident->motion = 0.0f;
    ident->misfit = 0.0f;
    ident->neighbour = 0.0f;
    ident->centre = an_dds_step(guess->frequency_hz, sample_rate_hz);
    ident->guess_tau_s = guess->tau_s;
    ident->elapsed_s = 0.0f;
    ident->lowered = false;
    const float most = AN_COARSE_MAX * guess->drive_limit;
    begin_coarse(ident, AN_START_LEVEL < most ? AN_START_LEVEL : most);
}

void an_ident_check(an_ident *ident, const an_mode *known, uint32_t centre, float sample_rate_hz)
{
    const float most = AN_COARSE_MAX * known->drive_limit;
    const float bound = AN_CHECK_LIMIT * known->amplitude_limit;
    const float aimed = (AN_CHECK_RESPONSE < bound ? AN_CHECK_RESPONSE : bound) / an_abs(known->gain);
    ident->mode = *known;
    ident->sample_rate_hz = sample_rate_hz;
    ident->centre = centre;
    ident->elapsed_s = 0.0f;
    ident->level = aimed < most ? aimed : most;
    ident->points = 3u; /* of which only the middle one is measured */
    ident->index = 1u;
    ident->span_hz = 0.0f;
    ident->stage = AN_IDENT_CHECK;
}

/* Offset of a point from the centre: 0, 1, -1, 2, -2 ... spacings in the coarse sweep, end to end in the other
 * sweeps. */
static float offset_hz(const an_ident *ident, uint32_t index)
{
    if (ident->stage == AN_IDENT_COARSE) {
        const float away_hz = ident->spacing_hz * (float)((index + 1u) / 2u);
        return index % 2u == 1u ? away_hz : -away_hz;
    }
    return ident->span_hz * (2.0f * (float)index / (float)(ident->points - 1u) - 1.0f);
}

static uint32_t step_of(const an_ident *ident, uint32_t index)
{
    return an_dds_shifted(ident->centre, offset_hz(ident, index), ident->sample_rate_hz);
}

void an_ident_probe(const an_ident *ident, an_probe *probe)
{
    static const float settle[] = {AN_COARSE_SETTLE, AN_FINE_SETTLE, AN_FINE_SETTLE, AN_SURVEY_SETTLE,
                                   AN_CHECK_SETTLE};
    static const uint8_t average[] = {COARSE_AVERAGE, FINE_AVERAGE, FINE_AVERAGE, SURVEY_AVERAGE, CHECK_AVERAGE};
    const uint32_t stage = ident->stage <= AN_IDENT_CHECK ? (uint32_t)ident->stage : (uint32_t)AN_IDENT_CHECK;
    probe->step = ident->stage == AN_IDENT_RAISE ? ident->centre : step_of(ident, ident->index);
    probe->level = ident->level;
    probe->settle_s = settle[stage] * ident->mode.tau_s;
    probe->average = average[stage];
}

/* Count a response in the histogram of half octaves: the exponent and the leading mantissa bit give the bin. */
static void count_size(an_ident *ident, float size)
{
    const union {
        float value;
        uint32_t bits;
    } number = {size};
    const uint32_t octave = number.bits >> 22;
    const uint32_t bin = octave > (uint32_t)FIRST_BIN ? octave - (uint32_t)FIRST_BIN : 0u;
    ident->sizes[bin < AN_IDENT_BINS ? bin : AN_IDENT_BINS - 1u]++;
}

/* Lower end of the histogram bin that contains the median. */
static float median_size(const an_ident *ident)
{
    uint32_t bin = 0u;
    uint32_t below = ident->sizes[0];
    while (2u * below < ident->index && bin + 1u < AN_IDENT_BINS) {
        bin++;
        below += ident->sizes[bin];
    }
    union {
        uint32_t bits;
        float value;
    } number;
    number.bits = (bin + (uint32_t)FIRST_BIN) << 22;
    return number.value;
}

static float larger(float a, float b)
{
    return a > b ? a : b;
}

static bool is_above_noise(const an_ident *ident)
{
    return ident->best_size > AN_MIN_PEAK &&
           ident->best_size * ident->best_size * (float)ident->index > AN_NOISE_RATIO * AN_NOISE_RATIO * ident->noise2;
}

/* Called when a pair of points is complete. Both outermost responses must be well below the peak; otherwise it might be
 * the skirt of a resonance farther out. */
static bool has_found_peak(const an_ident *ident)
{
    const float outside = larger(ident->last_size[0], ident->last_size[1]);
    const float spacings = (float)(ident->index / 2u);
    const float least = AN_MIN_SPAN * ident->mode.frequency_hz / ident->spacing_hz;
    const bool wide = spacings >= least && spacings >= AN_MIN_SPACINGS;
    const bool passed = outside < AN_SKIRT * ident->best_size;
    return wide && passed && is_above_noise(ident) && ident->best_size > AN_MEDIAN_RATIO * median_size(ident);
}

static float aim(const an_ident *ident)
{
    const float aimed = AN_FINE_RESPONSE * ident->mode.amplitude_limit * ident->level / ident->best_size;
    return aimed < ident->mode.drive_limit ? aimed : ident->mode.drive_limit;
}

/* Take one step towards the drive level of the fine sweep. */
static void raise_level(an_ident *ident)
{
    const float aimed = aim(ident);
    if (aimed <= ident->level) {
        ident->level = aimed;
        begin_fine(ident);
        return;
    }
    const float raised = AN_LEVEL_STEP * ident->level;
    ident->best_size *= (raised < aimed ? raised : aimed) / ident->level; /* predicted by linearity */
    ident->level = raised < aimed ? raised : aimed;
    ident->stage = AN_IDENT_RAISE;
}

static void end_coarse(an_ident *ident)
{
    const float most = AN_COARSE_MAX * ident->mode.drive_limit;
    const float raised = AN_LEVEL_STEP * ident->level;
    if (is_above_noise(ident) || ident->lowered || ident->level >= most) {
        ident->stage = AN_IDENT_FAILED;
    } else {
        begin_coarse(ident, raised < most ? raised : most);
    }
}

static void answer_coarse(an_ident *ident, an_complex measured, float noise2)
{
    const float size = an_abs(measured);
    if (size > AN_COARSE_RESPONSE_MAX * ident->mode.amplitude_limit) {
        ident->lowered = true;
        begin_coarse(ident, 0.25f * ident->level);
        ident->stage = ident->level > AN_MIN_LEVEL ? AN_IDENT_COARSE : AN_IDENT_FAILED;
        return;
    }
    if (size > ident->best_size) {
        ident->best_size = size;
        ident->best = ident->index;
    }
    ident->noise2 += noise2;
    count_size(ident, size);
    ident->last_size[ident->index % 2u] = size;
    ident->index++;
    if (ident->index % 2u == 1u && has_found_peak(ident)) {
        ident->coarse_gain = ident->best_size / ident->level;
        ident->centre = step_of(ident, ident->best);
        raise_level(ident);
    } else if (ident->index >= ident->points) {
        end_coarse(ident);
    }
}

static void answer_raise(an_ident *ident, an_complex measured)
{
    const float size = an_abs(measured);
    const float ratio = size / ident->best_size;
    if (!(ratio > AN_RATIO_MIN && ratio < AN_RATIO_MAX)) {
        ident->stage = AN_IDENT_FAILED;
        return;
    }
    ident->best_size = size;
    raise_level(ident);
}

/* exp(j w late_s) at a point of the sweep. */
static an_complex lead_of(const an_ident *ident, uint32_t index, float late_s)
{
    const float turns = (an_dds_frequency(ident->centre, ident->sample_rate_hz) + offset_hz(ident, index)) * late_s;
    const float rest = turns - (float)(int32_t)turns;
    return an_turn((uint32_t)(int32_t)(rest * 2147483648.0f) << 1);
}

/* Remove a delay from all responses. */
static void advance(an_ident *ident, float late_s)
{
    for (uint32_t i = 0u; i < ident->points; i++) {
        ident->response[i] = an_mul(ident->response[i], lead_of(ident, i, late_s));
    }
}

/* Delay beyond the one assumed so far. The gain of a real mode is real for a velocity sensor and lags by 90 degrees for
 * a displacement sensor, with either sign. Any remaining phase, modulo half a turn, is therefore due to delay. */
static float unknown_delay(const an_ident *ident, an_complex gain, float frequency_hz)
{
    const uint32_t excess = an_phase_of(gain) + ident->quarter_turns * 0x40000000u;
    const float half_turns = (float)(int32_t)(excess << 1) / AN_PHASE_TURN;
    const float delay_s = -0.5f * half_turns / frequency_hz;
    return ident->mode.delay_s + delay_s >= 0.0f ? delay_s : delay_s + 0.5f / frequency_hz;
}

/* Fit the resonance with the known delay removed; correct the delay twice by the phase of the fitted gain. */
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

/* The pole lies at the damped frequency w0 - 1 / (2 w0 tau^2); the mode table refers to the undamped one. */
static float undamped_offset(const an_ident *ident, const an_resonance *fit)
{
    const float rate_hz = 1.0f / (2.0f * AN_PI_NUMBER * fit->tau_s);
    return fit->offset_hz + 0.5f * rate_hz * rate_hz / an_dds_frequency(ident->centre, ident->sample_rate_hz);
}

static float largest_response(const an_ident *ident)
{
    float largest = 0.0f;
    for (uint32_t i = 0u; i < ident->points; i++) {
        largest = larger(largest, an_abs(ident->response[i]));
    }
    return largest * ident->level;
}

/* Sweep again at a lower level, unless the response would come too close to noise. */
static bool repeat_fine(an_ident *ident)
{
    if (ident->repeats >= AN_IDENT_REPEATS || !(AN_REPEAT_LEVEL * ident->motion > AN_REPEAT_MIN)) {
        return false;
    }
    ident->repeats++;
    ident->rounds = 0u;
    ident->level *= AN_REPEAT_LEVEL;
    begin_fine(ident);
    return true;
}

static bool is_nonlinear(const an_ident *ident)
{
    const bool bent = ident->misfit > AN_MISFIT_LINEAR && ident->repeats == 0u;
    return bent || an_abs(ident->mode.gain) < AN_GAIN_LINEAR * ident->coarse_gain;
}

static void end_fine(an_ident *ident)
{
    an_resonance fit;
    const float planned_tau_s = ident->mode.tau_s;
    const float planned_delay_s = ident->mode.delay_s;
    const float planned_width_hz = bandwidth_hz(&ident->mode);
    ident->motion = largest_response(ident);
    ident->rounds++;
    if (!fit_without_delay(ident, &fit) || !(fit.misfit < AN_MISFIT_MAX) || ident->rounds > ROUNDS_MAX ||
        !(fit.tau_s < AN_TAU_RATIO * ident->guess_tau_s && AN_TAU_RATIO * fit.tau_s > ident->guess_tau_s)) {
        ident->mode.delay_s = planned_delay_s;
        if (!repeat_fine(ident)) {
            ident->stage = AN_IDENT_FAILED;
        }
        return;
    }
    const float away = fit.offset_hz < 0.0f ? -fit.offset_hz : fit.offset_hz;
    const float longer = fit.tau_s / planned_tau_s;
    ident->centre = an_dds_shifted(ident->centre, undamped_offset(ident, &fit), ident->sample_rate_hz);
    ident->mode.frequency_hz = an_dds_frequency(ident->centre, ident->sample_rate_hz);
    ident->mode.tau_s = fit.tau_s;
    ident->mode.gain = fit.gain;
    ident->misfit = fit.misfit;
    if (!(away < 0.4f * planned_width_hz && longer > 0.8f && longer < 1.25f)) {
        begin_fine(ident);
    } else if (!(is_nonlinear(ident) && repeat_fine(ident))) {
        begin_survey(ident);
    }
}

static void answer_fine(an_ident *ident, an_complex measured)
{
    if (ident->index >= (uint32_t)AN_RESONANCE_POINTS) {
        ident->stage = AN_IDENT_FAILED;
        return;
    }
    ident->response[ident->index] = an_scale(measured, 1.0f / ident->level);
    ident->index++;
    if (ident->index >= ident->points) {
        end_fine(ident);
    }
}

/* Take the part of a response that neither the target mode nor noise explains. */
static void answer_survey(an_ident *ident, an_complex measured, float noise2)
{
    const an_complex response = an_scale(measured, 1.0f / ident->level);
    const float slope = AN_TWO_PI * offset_hz(ident, ident->index) * ident->mode.tau_s;
    const an_complex own = an_div(ident->mode.gain, an_cplx(1.0f, slope));
    const an_complex late = an_conj(lead_of(ident, ident->index, ident->mode.delay_s));
    ident->noise2 += noise2;
    ident->index++;
    const float noise = AN_SURVEY_NOISE * ident->noise2 / ((float)ident->index * ident->level * ident->level);
    const float residual2 = an_abs2(an_sub(response, an_mul(own, late))) - noise;
    ident->neighbour = larger(ident->neighbour, residual2 > 0.0f ? __builtin_sqrtf(residual2) : 0.0f);
    if (ident->index >= ident->points) {
        ident->stage = AN_IDENT_DONE;
    }
}

/* On resonance the response is G level; a shift by x half bandwidths divides it by 1 + j x. */
static void answer_check(an_ident *ident, an_complex measured)
{
    const an_complex found = an_mul(measured, lead_of(ident, ident->index, ident->mode.delay_s));
    const an_complex expected = an_scale(ident->mode.gain, ident->level);
    const float found2 = an_abs2(found);
    const float expected2 = an_abs2(expected);
    const bool alike = AN_CHECK_RATIO2 * found2 > expected2 && found2 < AN_CHECK_RATIO2 * expected2;
    ident->stage = alike && an_mul(found, an_conj(expected)).re > 0.0f ? AN_IDENT_AGREES : AN_IDENT_DIFFERS;
}

void an_ident_answer(an_ident *ident, an_complex measured, float noise2)
{
    an_probe probe;
    an_ident_probe(ident, &probe);
    ident->elapsed_s += probe.settle_s + (float)(probe.average * AN_PERIOD) / ident->sample_rate_hz;
    if (!an_is_finite(an_abs2(measured)) || ident->elapsed_s > AN_IDENTIFY_MAX_S) {
        ident->stage = AN_IDENT_FAILED;
    } else if (ident->stage == AN_IDENT_COARSE) {
        answer_coarse(ident, measured, noise2);
    } else if (ident->stage == AN_IDENT_RAISE) {
        answer_raise(ident, measured);
    } else if (ident->stage == AN_IDENT_FINE) {
        answer_fine(ident, measured);
    } else if (ident->stage == AN_IDENT_SURVEY) {
        answer_survey(ident, measured, noise2);
    } else if (ident->stage == AN_IDENT_CHECK) {
        answer_check(ident, measured);
    }
}
