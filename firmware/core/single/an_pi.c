#include "an_pi.h"

#include "an_clear.h"
#include "an_complex.h"
#include "an_sine.h"

#define AN_TWO_PI 6.2831853f
#define AN_FRESH 6.0f      /* steps over tau: a sixth of tau is remembered, in which a plate set free goes a sixth of its way */
#define AN_AHEAD 2.0f      /* steps from the middle of what was weighed to the end of the next answer */
#define AN_UNSURE 0.05f    /* of the drive: its age and the gain of the mode are known so well */
#define AN_NOISES 6.0f     /* that a fall must be larger than */
#define AN_NEAR 0.5f       /* of the reference, and the other way round: no finger leaves a plate that is further away */
#define AN_SEEN 0.004f     /* of full scale: eight codes */
#define AN_TOUCHED 1.25f   /* of the free plate's damping */
#define AN_FREE 0.8f       /* of what the free plate takes: it has not softened by more */
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

/* The law for a plate of which a unit of amplitude takes so much drive. */
static void plan_law(an_pi_law *law, const an_pi_basis *basis, float taken, uint32_t limited)
{
    const float spent = 1.0f - decay_of(basis->push * taken);
    const float least = AN_MIN_SHARE * taken;
    const float wanted = basis->reached[limited] * taken / spent;
    const float bounded = wanted < basis->proportional_max ? wanted : basis->proportional_max;
    const float proportional = bounded > least ? bounded : least;
    const an_complex feedback = an_cplx(proportional, -basis->turning);
    const an_complex decay = an_scale(basis->turn, decay_of(basis->age * basis->push * taken));
    const an_complex steady = an_div(an_cplx(1.0f, 0.0f), an_cplx(taken, basis->turning));
    law->proportional = proportional;
    law->integral = proportional * spent;
    law->state = an_mul(feedback, decay);
    law->feed = an_mul(feedback, an_mul(an_sub(an_cplx(1.0f, 0.0f), decay), steady));
}

void an_pi_plan(an_pi_gains *gains, const an_mode *mode, uint32_t step, float detuning_hz, const an_pi_wish *wish)
{
    const float size = an_abs(mode->gain);
    const float late = (mode->frequency_hz + detuning_hz) * mode->delay_s;
    const float fresh = AN_FRESH * wish->period_s / mode->tau_s;
    an_pi_basis *basis = &gains->basis;
    basis->push = size * wish->period_s / mode->tau_s;
    basis->turning = AN_TWO_PI * detuning_hz * mode->tau_s / size;
    basis->age = wish->ahead_s / wish->period_s;
    basis->turn = an_turn(phase_of_turns(-detuning_hz * wish->ahead_s));
    basis->reached[0] = 1.0f - decay_of(wish->period_s / wish->response_s);
    basis->reached[1] = 1.0f - decay_of(wish->period_s / wish->leaving_s);
    basis->proportional_max = wish->proportional_max;
    gains->inverse_gain = 1.0f / size;
    plan_law(&gains->law[0], basis, gains->inverse_gain, 0u);
    plan_law(&gains->law[1], basis, gains->inverse_gain, 1u);
    gains->least = gains->inverse_gain;
    if (gains->inverse_gain * wish->free_gain > AN_TOUCHED) {
        gains->least = AN_FREE / wish->free_gain;
    }
    gains->fresh = fresh < 1.0f ? fresh : 1.0f;
    gains->noise = AN_NOISES * gains->fresh * __builtin_sqrtf(wish->noise2) / basis->push;
    gains->drive_limit = mode->drive_limit;
    gains->lead = an_mul(an_turn(step + phase_of_turns(late)), an_scale(an_conj(mode->gain), 1.0f / size));
}

void an_pi_init(an_pi *pi, const an_pi_gains *gains, an_complex measured)
{
    an_clear(pi, sizeof *pi);
    pi->integral = an_scale(measured, gains->inverse_gain);
    pi->reference = measured.re;
    pi->measured = measured;
}

/* Drive that a unit of amplitude took lately, no more than the mode as it is known is seen to take. */
static float seen_of(const an_pi *pi, const an_pi_gains *gains)
{
    const float most = (1.0f + AN_UNSURE) * gains->inverse_gain;
    return pi->taken < most * pi->motion ? pi->taken / pi->motion : most;
}

/* What held the motion from the middle of one window to that of the next: the old drive until the gap had passed, the new
 * one after that. Doubts make it more. */
static void weigh(an_pi *pi, const an_pi_gains *gains, an_complex measured)
{
    const an_pi_basis *basis = &gains->basis;
    const an_complex middle = an_scale(an_add(measured, pi->measured), 0.5f);
    const float drive = pi->drive.re + basis->age * (pi->before - pi->drive.re);
    const float held = drive - (measured.re - pi->measured.re) / basis->push + basis->turning * middle.im;
    const float was = seen_of(pi, gains);
    pi->taken += gains->fresh * ((held + AN_UNSURE * __builtin_fabsf(drive)) * middle.re - pi->taken);
    pi->motion += gains->fresh * (middle.re * middle.re - pi->motion);
    const float falls = was - seen_of(pi, gains);
    pi->falls = falls > 0.0f ? falls : 0.0f;
    pi->measured = measured;
    pi->before = pi->drive.re;
}

/* Drive that a unit of amplitude will take while the next answer acts: as the mode is known, or clearly less. */
static float taken_of(const an_pi *pi, const an_pi_gains *gains, float measured, float reference)
{
    const bool near = measured > AN_NEAR * reference && AN_NEAR * measured < reference;
    if (!near || measured < AN_SEEN) {
        return gains->inverse_gain;
    }
    const float taken = seen_of(pi, gains) - AN_AHEAD * pi->falls + gains->noise / __builtin_sqrtf(pi->motion);
    const float most = taken < gains->inverse_gain ? taken : gains->inverse_gain;
    return most > gains->least ? most : gains->least;
}

/* The integral compares a measurement with the reference of its own age, as if that moved evenly between two
 * steps: with the new one it would gather half a step too much and overshoot. */
static void integrate(an_pi *pi, float age, float integral, an_complex measured, float reference)
{
    const float then = reference - age * (reference - pi->reference);
    pi->integral.re += integral * (then - measured.re);
    pi->integral.im -= integral * measured.im;
}

/* While the drive is limited the integral is what would hold the present amplitude: control leaves the limit as if
 * it had just started there, and neither overshoots nor crawls. */
an_complex an_pi_step(an_pi *pi, const an_pi_gains *gains, an_complex measured, float reference)
{
    const uint32_t leaves = pi->limited == AN_PI_LIMITED ? 1u : 0u;
    an_pi_law law = gains->law[leaves];
    weigh(pi, gains, measured);
    const float taken = taken_of(pi, gains, measured.re, reference);
    if (taken < gains->inverse_gain) {
        const float aim = pi->limited != 0u && measured.re < reference ? measured.re : reference;
        plan_law(&law, &gains->basis, taken, leaves);
        pi->integral.re = pi->integral.re < taken * aim ? pi->integral.re : taken * aim;
    }
    const an_complex held = an_add(an_mul(law.state, measured), an_mul(law.feed, pi->drive));
    an_complex drive = an_sub(pi->integral, held);
    drive.re += law.proportional * reference;
    const float size2 = an_abs2(drive);
    if (size2 > gains->drive_limit * gains->drive_limit) {
        drive = an_scale(drive, gains->drive_limit / __builtin_sqrtf(size2));
        pi->integral = an_scale(measured, taken);
        pi->limited = AN_PI_LIMITED;
    } else if (pi->limited != 0u) {
        pi->integral = an_scale(measured, taken);
        pi->limited--;
    } else {
        integrate(pi, gains->basis.age, law.integral, measured, reference);
    }
    pi->reference = reference;
    pi->drive = drive;
    return drive;
}
