#include "an_six_watch.h"

#include "an_bytes.h"
#include "an_complex.h"
#include "an_sincos.h"

#define AN_SIX_ALLOWED 0.2f /* of the amplitude: largest deviation of a sample that agrees with its prediction */
#define AN_SIX_STILL 0.13f  /* of the amplitude times the phase step: largest movement of a stuck sensor per sample */
#define AN_SIX_DISTANCE_SUM 0.5f /* of the amplitude: sum of deviations that decides */
#define AN_SIX_MOVEMENT_SUM 0.25f /* of the amplitude: sum of predicted movements that decides */
#define AN_SIX_MIN 0.02f    /* of full scale: smallest usable amplitude */
#define AN_SIX_QUIET2 1444.0f /* squared: smallest amplitude over recent rms prediction error, fifty times the noise */
#define AN_SIX_KNOCK2 0.2f  /* share of one large deviation's square in the roughness */
#define AN_SIX_FORGET 0.81f /* decay of the roughness per block */
#define AN_SIX_LEVEL 0.5f   /* weight of a deviation in the level of the slow modes */
#define AN_SIX_SLOPE 0.15f  /* likewise, in their slope */

enum {
    RUN_MIN = 3,
    BLOCK = 8, /* samples */
    TAKE_OVER = 2 * AN_SIX_GAP /* tick for a new measurement: leaves time to detect a failure at the window's end */
};

void an_six_watch_forget(an_six_watch *watch)
{
    an_clear(watch, sizeof *watch);
    for (uint32_t i = 0u; i < AN_SIX; i++) {
        watch->traces[i].rough2 = 1.0f;
    }
}

/* A hypothesis accumulates evidence as long as every sample fits it. */
static bool accumulate(float *sum, bool fits, float more)
{
    *sum = fits ? *sum + more : 0.0f;
    return fits;
}

static float larger(float a, float b)
{
    return a > b ? a : b;
}

/* Track the contribution of slower modes with an alpha-beta filter for level and slope. A sensor that may have failed
 * does not correct it. */
static void follow(an_six_trace *trace, float distance, bool followed)
{
    trace->ringing += trace->slope;
    if (followed) {
        trace->ringing += AN_SIX_LEVEL * distance;
        trace->slope += AN_SIX_SLOPE * distance;
    }
}

/* Predict x = carrier + slow modes and test the three hypotheses: signal gone, reversed or stuck. */
static bool look(an_six_trace *trace, float shown, float tone, float angle)
{
    const float expected = tone + trace->ringing + trace->slope;
    const float allowed = AN_SIX_ALLOWED * trace->size;
    const float still = AN_SIX_STILL * angle * trace->size;
    const float distance = shown - expected;
    const float off = __builtin_fabsf(distance);
    const bool sound = off <= allowed;
    const float more = sound ? 0.0f : off;
    const float moved = __builtin_fabsf(expected - trace->expected);
    const bool gone = accumulate(&trace->gone, __builtin_fabsf(shown) <= allowed, more);
    const bool reversed = accumulate(&trace->reversed, __builtin_fabsf(shown + expected) <= allowed, more);
    const bool stuck = accumulate(&trace->stuck, __builtin_fabsf(shown - trace->shown) <= still, moved);
    const bool fits = gone || reversed || stuck;
    trace->run = fits ? trace->run + 1u : 0u;
    if (sound) {
        trace->off2 += off * off;
    } else if (!fits) {
        trace->rough2 = larger(trace->rough2, AN_SIX_KNOCK2 * off * off);
    }
    follow(trace, distance, sound || !fits);
    trace->shown = shown;
    trace->expected = expected;
    const float enough = AN_SIX_DISTANCE_SUM * trace->size;
    const bool quiet = trace->size * trace->size > AN_SIX_QUIET2 * trace->rough2;
    return trace->size > AN_SIX_MIN && quiet && trace->run >= RUN_MIN &&
           (trace->gone > enough || trace->reversed > enough || trace->stuck > AN_SIX_MOVEMENT_SUM * trace->size);
}

static float sample_of(an_complex tone, an_complex carrier)
{
    return tone.re * carrier.re - tone.im * carrier.im;
}

/* Adopt the new measurement. The last prediction changes with it, so that the change does not count as a movement. */
static void take_over(an_six_watch *watch, const an_six_slow *slow, an_complex carrier)
{
    for (uint32_t i = 0u; i < AN_SIX; i++) {
        an_six_trace *trace = &watch->traces[i];
        trace->expected += sample_of(an_sub(slow->measured[i], trace->tone), carrier);
        trace->tone = slow->measured[i];
        trace->size = an_abs(trace->tone);
        trace->offset = slow->offset[i];
    }
}

static void forget_slowly(an_six_watch *watch)
{
    for (uint32_t i = 0u; i < AN_SIX; i++) {
        an_six_trace *trace = &watch->traces[i];
        trace->rough2 += (1.0f - AN_SIX_FORGET) * (trace->off2_before * (1.0f / (float)BLOCK) - trace->rough2);
        trace->off2_before = trace->off2;
        trace->off2 = 0.0f;
    }
}

bool an_six_watch_look(an_six_watch *watch, const an_six_slow *slow, const an_six_fast *fast, const uint16_t *adc,
                       uint32_t channels)
{
    const an_complex carrier = an_sincos(fast->phase - fast->step);
    const float angle = (float)fast->step * AN_TURN_PER_LSB;
    bool failed = false;
    for (uint32_t i = 0u; i < channels; i++) {
        an_six_trace *trace = &watch->traces[i];
        const float level = (float)((int32_t)adc[i] - AN_SIX_ADC_MIDDLE) * (1.0f / (float)AN_SIX_ADC_MIDDLE);
        failed = look(trace, level - trace->offset, sample_of(trace->tone, carrier), angle) || failed;
    }
    if (fast->tick % BLOCK == 0u) {
        forget_slowly(watch);
    }
    if (fast->tick == TAKE_OVER) {
        take_over(watch, slow, carrier);
    }
    return failed;
}
