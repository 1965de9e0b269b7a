#include "an_ident.h"

#include "an_clear.h"
#include "an_complex.h"
#include "an_dds.h"
#include "an_fast.h"
#include "an_sine.h"

#define AN_PI_NUMBER 3.14159265f
#define AN_START_LEVEL 0.01f    /* of full scale */
#define AN_MIN_LEVEL 1e-4f
#define AN_COARSE_MAX 0.16f    /* of the drive limit, while nothing but noise answers */
#define AN_LOUDER 4.0f
#define AN_FIRST_SPAN 0.01f     /* of the frequency, to either side: the least that is looked at */
#define AN_WIDEST_SPAN 0.04f
#define AN_FIRST_SPACINGS 4.0f  /* the same in half bandwidths */
#define AN_OVER_NOISE 6.0f      /* noise of this many rms comes once in 4e15 points */
#define AN_CODES 0.002f         /* four of the converter's codes: what is smaller is its steps */
#define AN_OVER_MEDIAN 1.6f     /* no flat response has it, every resonance seen over four half bandwidths has 2.2 */
#define AN_PASSED 0.7f          /* of the peak: half a bandwidth off */
#define AN_AIM 0.4f             /* of the amplitude limit, at the peak of the fine sweep */
#define AN_TOO_MUCH 0.5f        /* of the amplitude limit */
#define AN_RATIO_MIN 0.4f     /* of a response raised to what it was, both by their drives */
#define AN_RATIO_MAX 3.0f
#define AN_TAU_RATIO 8.0f       /* found over guessed, or the other way round */
#define AN_COARSE_SETTLE 4.0f   /* time constants */
#define AN_FINE_SETTLE 6.0f
#define AN_SURVEY_SETTLE 3.0f
#define AN_SURVEY_SPAN_HZ 1500.0f
#define AN_SURVEY_LEVEL 0.25f /* of the fine sweep's: a neighbour may be stronger */
#define AN_MISFIT_MAX 0.03f
#define AN_TWO_PI 6.2831853f

enum { COARSE_AVERAGE = 4, FINE_AVERAGE = 8, SURVEY_AVERAGE = 4, SURVEY_POINTS_MAX = 255, ROUNDS_MAX = 5 };
enum { FIRST_BIN = 2 * (127 - 24) }; /* a float's exponent and first bit: 2^-24 */

/* Full width of |U| at -3 dB, Hz. */
static float bandwidth_hz(const an_mode *mode)
{
    return 1.0f / (AN_PI_NUMBER * mode->tau_s);
}

/* Points half a bandwidth apart: no resonance of that width slips through. From the guess outward, on both sides in turn,
 * to a bandwidth beyond the widest span. */
static void begin_coarse(an_ident *ident, float level)
{
    ident->stage = AN_IDENT_COARSE;
    ident->level = level;
    ident->spacing_hz = 0.5f * bandwidth_hz(&ident->mode);
    ident->points = 2u * ((uint32_t)(AN_WIDEST_SPAN * ident->mode.frequency_hz / ident->spacing_hz) + 3u) + 1u;
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
    ident->level *= AN_SURVEY_LEVEL;
    ident->neighbour = 0.0f;
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
    ident->misfit = 0.0f;
    ident->neighbour = 0.0f;
    ident->centre = an_dds_step(guess->frequency_hz, sample_rate_hz);
    ident->guess_tau_s = guess->tau_s;
    ident->elapsed_s = 0.0f;
    ident->lowered = false;
    const float most = AN_COARSE_MAX * guess->drive_limit;
    begin_coarse(ident, AN_START_LEVEL < most ? AN_START_LEVEL : most);
}

/* 0, 1, -1, 2, -2 ... spacings in the coarse sweep, evenly from end to end in the others. */
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
    static const float settle[] = {AN_COARSE_SETTLE, AN_FINE_SETTLE, AN_FINE_SETTLE, AN_SURVEY_SETTLE};
    static const uint8_t average[] = {COARSE_AVERAGE, FINE_AVERAGE, FINE_AVERAGE, SURVEY_AVERAGE};
    const uint32_t stage = ident->stage <= AN_IDENT_SURVEY ? (uint32_t)ident->stage : (uint32_t)AN_IDENT_SURVEY;
    probe->step = ident->stage == AN_IDENT_RAISE ? ident->centre : step_of(ident, ident->index);
    probe->level = ident->level;
    probe->settle_s = settle[stage] * ident->mode.tau_s;
    probe->average = average[stage];
}

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

/* The lower end of the bin that the median lies in. */
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
    return ident->best_size > AN_CODES &&
           ident->best_size * ident->best_size * (float)ident->index > AN_OVER_NOISE * AN_OVER_NOISE * ident->noise2;
}

/* Looked at when a pair of points is complete: the outermost ones are well below the peak, so it is not the skirt of one
 * that lies further out. */
static bool has_found_a_peak(const an_ident *ident)
{
    const float outside = larger(ident->last_size[0], ident->last_size[1]);
    const float spacings = (float)(ident->index / 2u);
    const float least = AN_FIRST_SPAN * ident->mode.frequency_hz / ident->spacing_hz;
    const bool wide = spacings >= least && spacings >= AN_FIRST_SPACINGS;
    const bool passed = outside < AN_PASSED * ident->best_size;
    return wide && passed && is_above_noise(ident) && ident->best_size > AN_OVER_MEDIAN * median_size(ident);
}

static float aim(const an_ident *ident)
{
    const float aimed = AN_AIM * ident->mode.amplitude_limit * ident->level / ident->best_size;
    return aimed < ident->mode.drive_limit ? aimed : ident->mode.drive_limit;
}

/* A step towards the level of the fine sweep. */
static void raise(an_ident *ident)
{
    const float aimed = aim(ident);
    if (aimed <= ident->level) {
        ident->level = aimed;
        begin_fine(ident);
        return;
    }
    const float louder = AN_LOUDER * ident->level;
    ident->best_size *= (louder < aimed ? louder : aimed) / ident->level; /* what it ought to become */
    ident->level = louder < aimed ? louder : aimed;
    ident->stage = AN_IDENT_RAISE;
}

static void end_coarse(an_ident *ident)
{
    const float most = AN_COARSE_MAX * ident->mode.drive_limit;
    const float louder = AN_LOUDER * ident->level;
    if (is_above_noise(ident) || ident->lowered || ident->level >= most) {
        ident->stage = AN_IDENT_FAILED;
    } else {
        begin_coarse(ident, louder < most ? louder : most);
    }
}

static void answer_coarse(an_ident *ident, an_complex measured, float noise2)
{
    const float size = an_abs(measured);
    if (size > AN_TOO_MUCH * ident->mode.amplitude_limit) {
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
    if (ident->index % 2u == 1u && has_found_a_peak(ident)) {
        ident->centre = step_of(ident, ident->best);
        raise(ident);
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
    raise(ident);
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
    if (!fit_without_delay(ident, &fit) || !(fit.misfit < AN_MISFIT_MAX) || ident->rounds > ROUNDS_MAX ||
        !(fit.tau_s < AN_TAU_RATIO * ident->guess_tau_s && AN_TAU_RATIO * fit.tau_s > ident->guess_tau_s)) {
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

static void answer_survey(an_ident *ident, an_complex measured)
{
    const an_complex response = an_scale(measured, 1.0f / ident->level);
    const float slope = AN_TWO_PI * offset_hz(ident, ident->index) * ident->mode.tau_s;
    const an_complex own = an_div(ident->mode.gain, an_cplx(1.0f, slope));
    const an_complex late = an_conj(lead_of(ident, ident->index, ident->mode.delay_s));
    const float beside = an_abs(an_sub(response, an_mul(own, late)));
    ident->neighbour = beside > ident->neighbour ? beside : ident->neighbour;
    ident->index++;
    if (ident->index >= ident->points) {
        ident->stage = AN_IDENT_DONE;
    }
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
        answer_survey(ident, measured);
    }
}
