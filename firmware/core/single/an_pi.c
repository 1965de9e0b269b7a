#include "an_pi.h"

#include "an_complex.h"
#include "an_sine.h"

#define AN_TWO_PI 6.2831853f
#define AN_MIN_SHARE 0.1f /* Kp G at least: slower than this the plate alone would be faster */

/* exp(-x), x >= 0, as a Pade fraction: positive, below one, and within 1e-4 for x up to 0.7. */
static float decay_of(float x)
{
    const float even = 1.0f + x * x * (1.0f / 12.0f);
    return (even - 0.5f * x) / (even + 0.5f * x);
}

static uint32_t phase_of_turns(float turns)
{
    const float whole = (float)(int32_t)turns;
    return (uint32_t)(int32_t)((turns - whole) * 2147483648.0f) << 1;
}

/* U after a time: decay U + push V. */
static void plan_model(an_complex *decay, an_complex *push, const an_mode *mode, float detuning_hz, float time_s)
{
    const an_complex slope = an_cplx(1.0f, AN_TWO_PI * detuning_hz * mode->tau_s);
    const an_complex steady = an_div(an_cplx(an_abs(mode->gain), 0.0f), slope);
    *decay = an_scale(an_turn(phase_of_turns(-detuning_hz * time_s)), decay_of(time_s / mode->tau_s));
    *push = an_mul(an_sub(an_cplx(1.0f, 0.0f), *decay), steady);
}

static void plan_law(an_pi_law *law, const an_mode *mode, float detuning_hz, float ahead_s, float proportional)
{
    const float decoupling = AN_TWO_PI * detuning_hz * mode->tau_s / an_abs(mode->gain);
    const an_complex feedback = an_cplx(proportional, -decoupling);
    an_complex decay;
    an_complex push;
    plan_model(&decay, &push, mode, detuning_hz, ahead_s);
    law->proportional = proportional;
    law->state = an_mul(feedback, decay);
    law->feed = an_mul(feedback, push);
}

/* Kp for a closed loop of this time constant, within its bounds. */
static float proportional_of(const an_mode *mode, const an_pi_wish *wish, float response_s)
{
    const float size = an_abs(mode->gain);
    const float pole = decay_of(wish->period_s / mode->tau_s);
    const float wanted_pole = decay_of(wish->period_s / response_s);
    const float proportional = (1.0f - wanted_pole) / ((1.0f - pole) * size);
    const float least = AN_MIN_SHARE / size;
    const float bounded = proportional < wish->proportional_max ? proportional : wish->proportional_max;
    return bounded > least ? bounded : least;
}

void an_pi_plan(an_pi_gains *gains, const an_mode *mode, uint32_t step, float detuning_hz, const an_pi_wish *wish)
{
    const float size = an_abs(mode->gain);
    const float late = (mode->frequency_hz + detuning_hz) * mode->delay_s;
    const float proportional = proportional_of(mode, wish, wish->response_s);
    plan_law(&gains->law[0], mode, detuning_hz, wish->ahead_s, proportional);
    plan_law(&gains->law[1], mode, detuning_hz, wish->ahead_s, proportional_of(mode, wish, wish->leaving_s));
    gains->integral = proportional * (1.0f - decay_of(wish->period_s / mode->tau_s));
    gains->age = wish->ahead_s / wish->period_s;
    gains->inverse_gain = 1.0f / size;
    gains->drive_limit = mode->drive_limit;
    gains->lead = an_mul(an_turn(step + phase_of_turns(late)), an_scale(an_conj(mode->gain), 1.0f / size));
}

void an_pi_init(an_pi *pi, const an_pi_gains *gains, an_complex measured)
{
    pi->integral = an_scale(measured, gains->inverse_gain);
    pi->drive = an_cplx(0.0f, 0.0f);
    pi->reference = measured.re;
    pi->limited = 0u;
}

/* The integral compares a measurement with the reference of its own age, as if that moved evenly between two
 * steps: with the new one it would gather half a step too much and overshoot. */
static void integrate(an_pi *pi, const an_pi_gains *gains, an_complex measured, float reference)
{
    const float then = reference - gains->age * (reference - pi->reference);
    pi->integral.re += gains->integral * (then - measured.re);
    pi->integral.im -= gains->integral * measured.im;
}

/* While the drive is limited the integral is what would hold the present amplitude: control leaves the limit as if
 * it had just started there, and neither overshoots nor crawls. */
an_complex an_pi_step(an_pi *pi, const an_pi_gains *gains, an_complex measured, float reference)
{
    const an_pi_law *law = &gains->law[pi->limited == AN_PI_LIMITED];
    const an_complex held = an_add(an_mul(law->state, measured), an_mul(law->feed, pi->drive));
    an_complex drive = an_sub(pi->integral, held);
    drive.re += law->proportional * reference;
    const float size2 = an_abs2(drive);
    if (size2 > gains->drive_limit * gains->drive_limit) {
        drive = an_scale(drive, gains->drive_limit / __builtin_sqrtf(size2));
        pi->integral = an_scale(measured, gains->inverse_gain);
        pi->limited = AN_PI_LIMITED;
    } else if (pi->limited != 0u) {
        pi->integral = an_scale(measured, gains->inverse_gain);
        pi->limited--;
    } else {
        integrate(pi, gains, measured, reference);
    }
    pi->reference = reference;
    pi->drive = drive;
    return drive;
}
