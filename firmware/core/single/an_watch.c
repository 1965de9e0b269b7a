#include "an_watch.h"

#include "an_bytes.h"
#include "an_complex.h"
#include "an_sincos.h"

#define AN_REGRESSOR_MIN 0.35f  /* smallest squared norm of a regressor: noise of a fit at most 1.2 times a sample's */
#define AN_GONE2 0.0625f        /* squared: a quarter of the previous amplitude */
#define AN_STILL2 (0.5f * (float)AN_WATCH_TICKS / 81.0f) /* sum of squares of a sinusoid of a ninth of the amplitude */
#define AN_PEAK_SHARE2 0.25f    /* squared: half of the recent peak; beating modes pass through smaller amplitudes */
#define AN_FORGET 0.06f         /* decay of the squared peak per check: half of it within half a millisecond */
#define AN_CHANGE2 0.605f       /* of |U|^2: damping and detuning of a touched plate, plus the margin AN_GONE2 */
#define AN_MIN2 67.0f           /* 0.004 of full scale in counts, squared */
#define AN_QUIET 575.0f         /* times the noise power between windows at rest: 10 times the noise of a sample */
#define AN_STILL_QUIET 150.0f   /* likewise: mean of the sum of squares of noise alone, plus four standard deviations */
#define AN_FULL_SCALE2 4194304.0f /* counts, squared */

/* Remove the component along another regressor. */
static void orthogonalise(float *values, const float *of)
{
    float product = 0.0f;
    float square = 0.0f;
    for (uint32_t i = 0u; i < AN_WATCH_PAIRS; i++) {
        product += values[i] * of[i];
        square += of[i] * of[i];
    }
    for (uint32_t i = 0u; i < AN_WATCH_PAIRS; i++) {
        values[i] -= product / square * of[i];
    }
}

/* Turn a regressor into the weights of a least-squares fit. Returns false if noise would dominate the fit. */
static bool normalise(float *values)
{
    float square = 0.0f;
    for (uint32_t i = 0u; i < AN_WATCH_PAIRS; i++) {
        square += values[i] * values[i];
    }
    for (uint32_t i = 0u; i < AN_WATCH_PAIRS; i++) {
        values[i] *= 0.5f / square;
    }
    return square > AN_REGRESSOR_MIN;
}

/* About the middle of the samples, cosine and offset are even, sine and slope are odd: the fit splits into two problems
 * with two unknowns each. Orthogonalising cosine against the offset, and sine against the slope, leaves one unknown
 * each. */
void an_watch_prepare(an_watch_plan *plan, const an_mode *mode, an_complex lead, uint32_t step, float sample_rate_hz)
{
    static const float even[AN_WATCH_PAIRS] = {1.0f, 1.0f, 1.0f, 1.0f, 1.0f};
    static const float odd[AN_WATCH_PAIRS] = {0.5f, 1.5f, 2.5f, 3.5f, 4.5f};
    for (uint32_t i = 0u; i < AN_WATCH_PAIRS; i++) {
        const an_complex turn = an_turn((step >> 1) * (2u * i + 1u));
        plan->cosine[i] = turn.re;
        plan->sine[i] = turn.im;
    }
    orthogonalise(plan->cosine, even);
    orthogonalise(plan->sine, odd);
    const bool sine_fits = normalise(plan->sine);
    const bool fits = normalise(plan->cosine) && sine_fits;
    const float full_scale = (float)AN_ADC_MIDDLE / (float)AN_DAC_SWING;
    const float looks_s = 2.0f * (float)AN_WATCH_TICKS / sample_rate_hz;
    plan->push = an_scale(an_conj(lead), an_abs(mode->gain) / mode->tau_s * looks_s * full_scale);
    plan->decides = fits;
}

/* Sample of a number of ticks ago. */
static float recent(const an_fast *fast, uint32_t ticks)
{
    const float *end = fast->recent + fast->tick;
    return fast->tick >= ticks ? *(end - ticks) : *(end + AN_PERIOD - ticks);
}

/* Envelope in the middle of the last samples. */
static an_complex envelope(const an_watch_plan *plan, const an_fast *fast)
{
    an_complex tone = {0.0f, 0.0f};
    for (uint32_t i = 0u; i < AN_WATCH_PAIRS; i++) {
        const float after = recent(fast, (uint32_t)AN_WATCH_PAIRS - i);
        const float before = recent(fast, (uint32_t)AN_WATCH_PAIRS + 1u + i);
        tone.re += plan->cosine[i] * (after + before);
        tone.im -= plan->sine[i] * (after - before);
    }
    const uint32_t middle = fast->phase - (uint32_t)AN_WATCH_PAIRS * fast->step - (fast->step >> 1);
    return an_mul(tone, an_conj(an_sincos(middle)));
}

/* True if all samples are nearly equal. Where the beat of two modes passes through zero, some are not. */
static bool is_still(const an_fast *fast, float size2, float noise2)
{
    const float first = recent(fast, 1u);
    float sum = 0.0f;
    float squares = 0.0f;
    for (uint32_t i = 2u; i <= AN_WATCH_TICKS; i++) {
        const float x = recent(fast, i) - first;
        sum += x;
        squares += x * x;
    }
    return squares - sum * sum * (1.0f / (float)AN_WATCH_TICKS) <= AN_STILL2 * size2 + AN_STILL_QUIET * noise2;
}

/* True if the sensor shows nothing, or the opposite of before, and the plate cannot have moved there from its expected
 * state. With F the effect of the drive over two checks, it moves by at most |F| + 0.55 |U|, and (|F| + 0.55 |U|)^2 <=
 * 2 |F|^2 + 0.605 |U|^2. */
static bool failed(const an_watch *watch, const an_fast *fast, an_complex now, an_complex given, float noise2)
{
    const an_complex was = watch->seen[1];
    const float size2 = an_abs2(was);
    const float most2 = an_abs2(given) + an_abs2(watch->given[1]) + AN_CHANGE2 * size2;
    const an_complex expected = an_add(was, an_scale(an_add(given, watch->given[1]), 0.5f));
    if (an_abs2(now) <= AN_GONE2 * size2) {
        return an_abs2(expected) > most2 && is_still(fast, size2, noise2);
    }
    return an_abs2(an_add(now, was)) <= AN_GONE2 * size2 && an_abs2(an_add(expected, was)) > most2;
}

bool an_watch_look(an_watch *watch, const an_watch_plan *plan, const an_fast *fast, float quiet)
{
    const an_complex now = envelope(plan, fast);
    const an_complex given = an_mul(plan->push, fast->drive);
    const float size2 = an_abs2(watch->seen[1]);
    const float noise2 = AN_FULL_SCALE2 * quiet;
    const bool decided = size2 > AN_MIN2 && size2 > AN_QUIET * noise2 && size2 > AN_PEAK_SHARE2 * watch->peak &&
                         failed(watch, fast, now, given, noise2);
    const float left = (1.0f - AN_FORGET) * watch->peak;
    watch->peak = an_abs2(now) > left ? an_abs2(now) : left;
    watch->seen[1] = watch->seen[0];
    watch->seen[0] = now;
    watch->given[1] = watch->given[0];
    watch->given[0] = given;
    return decided;
}

void an_watch_forget(an_watch *watch)
{
    an_clear(watch, sizeof *watch);
}
