#include "an_pi.h"

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

/* What both laws of a plate are made of: push is the amplitude that a unit of drive adds in a step, turn what becomes of a
 * free mode until an answer acts, reached the share of a difference that is gone within a step. */
typedef struct {
    float push;
    float turning;
    float age;
    float proportional_max;
    an_complex turn;
    float reached[2];
} an_basis;

/* The law for a plate of which a unit of amplitude takes so much drive. */
static an_pi_law law_of(const an_basis *basis, float taken, uint32_t limited)
{
    const float spent = 1.0f - decay_of(basis->push * taken);
    const float least = AN_MIN_SHARE * taken;
    const float aimed = basis->reached[limited] * taken / spent;
    const float bounded = aimed < basis->proportional_max ? aimed : basis->proportional_max;
    const float proportional = bounded > least ? bounded : least;
    const an_complex feedback = an_cplx(proportional, -basis->turning);
    const an_complex decay = an_scale(basis->turn, decay_of(basis->age * basis->push * taken));
    const an_complex steady = an_div(an_cplx(1.0f, 0.0f), an_cplx(taken, basis->turning));
    const an_complex push = an_mul(an_sub(an_cplx(1.0f, 0.0f), decay), steady);
    return (an_pi_law){proportional, proportional * spent, an_mul(feedback, decay), an_mul(feedback, push)};
}

static void plan_laws(an_pi_gains *gains, const an_basis *basis)
{
    for (uint32_t limited = 0u; limited < 2u; limited++) {
        const an_pi_law light = law_of(basis, gains->lightest, limited);
        const an_pi_law known = law_of(basis, gains->inverse_gain, limited);
        gains->law[limited] = known;
        gains->lighter[limited] = (an_pi_law){
            light.proportional - known.proportional,
            light.integral - known.integral,
            an_sub(light.state, known.state),
            an_sub(light.feed, known.feed),
        };
    }
}

void an_pi_plan(an_pi_gains *gains, const an_mode *mode, uint32_t step, float detuning_hz, const an_pi_wish *wish)
{
    const float size = an_abs(mode->gain);
    const float late = (mode->frequency_hz + detuning_hz) * mode->delay_s;
    const float fresh = AN_FRESH * wish->period_s / mode->tau_s;
    const an_basis basis = {
        .push = size * wish->period_s / mode->tau_s,
        .turning = AN_TWO_PI * detuning_hz * mode->tau_s / size,
        .age = wish->ahead_s / wish->period_s,
        .proportional_max = wish->proportional_max,
        .turn = an_turn(phase_of_turns(-detuning_hz * wish->ahead_s)),
        .reached = {1.0f - decay_of(wish->period_s / wish->response_s), 1.0f - decay_of(wish->period_s / wish->leaving_s)},
    };
    const bool touched = wish->free_gain > AN_TOUCHED * size;
    gains->inverse_gain = 1.0f / size;
    gains->lightest = touched ? AN_FREE / wish->free_gain : gains->inverse_gain;
    gains->per_lift = touched ? 1.0f / (gains->inverse_gain - gains->lightest) : 0.0f;
    plan_laws(gains, &basis);
    gains->most = (1.0f + AN_UNSURE) * gains->inverse_gain;
    gains->fresh = fresh < 1.0f ? fresh : 1.0f;
    gains->pull = 1.0f / basis.push;
    gains->noise = AN_NOISES * gains->fresh * gains->pull * __builtin_sqrtf(wish->noise2);
    gains->turning = basis.turning;
    gains->drive_limit = mode->drive_limit;
    gains->age = basis.age;
    gains->lead = an_mul(an_turn(step + phase_of_turns(late)), an_scale(an_conj(mode->gain), 1.0f / size));
}

void an_pi_init(an_pi *pi, const an_pi_gains *gains, an_complex measured)
{
    pi->integral = an_scale(measured, gains->inverse_gain);
    pi->drive = an_cplx(0.0f, 0.0f);
    pi->before = 0.0f;
    pi->measured = measured;
    pi->seen = gains->most;
    pi->reference = measured.re;
    pi->limited = 0u;
}

static float smaller(float a, float b)
{
    return a < b ? a : b;
}

/* Drive that a unit of amplitude will take while the next answer acts: as the mode is known, or clearly less.
 *
 * Weighed is what held the motion from the middle of one window to that of the next: the old drive until the gap had passed,
 * the new one after that. Doubts make it more. What falls is carried on to the end of the next answer. */
static float taken_of(an_pi *pi, const an_pi_gains *gains, an_complex measured, float reference)
{
    const float middle = 0.5f * (measured.re + pi->measured.re);
    const float drive = pi->drive.re + gains->age * (pi->before - pi->drive.re);
    const float crossed = 0.5f * gains->turning * (measured.im + pi->measured.im);
    const float held = drive - gains->pull * (measured.re - pi->measured.re) + crossed;
    const bool near = measured.re > AN_NEAR * reference && AN_NEAR * measured.re < reference;
    pi->measured = measured;
    pi->before = pi->drive.re;
    if (!near || measured.re < AN_SEEN || middle < AN_NEAR * AN_SEEN) {
        pi->seen = gains->most;
        return gains->inverse_gain;
    }
    const float each = 1.0f / middle;
    const float was = smaller(pi->seen, gains->most);
    const float now = was + gains->fresh * (each * (held + AN_UNSURE * __builtin_fabsf(drive)) - was);
    pi->seen = smaller(now, gains->most);
    const float taken = pi->seen - AN_AHEAD * (was - smaller(was, pi->seen)) + gains->noise * each;
    const float lighter = smaller(taken, gains->inverse_gain);
    return lighter > gains->lightest ? lighter : gains->lightest;
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
    const an_pi_law *law = &gains->law[leaves];
    const an_pi_law *lighter = &gains->lighter[leaves];
    const float taken = taken_of(pi, gains, measured, reference);
    const float lifted = (gains->inverse_gain - taken) * gains->per_lift;
    if (lifted > 0.0f) {
        pi->integral.re = smaller(pi->integral.re, taken * (pi->limited != 0u ? smaller(measured.re, reference) : reference));
    }
    const an_complex state = an_add(law->state, an_scale(lighter->state, lifted));
    const an_complex feed = an_add(law->feed, an_scale(lighter->feed, lifted));
    an_complex drive = an_sub(pi->integral, an_add(an_mul(state, measured), an_mul(feed, pi->drive)));
    drive.re += (law->proportional + lifted * lighter->proportional) * reference;
    const float size2 = an_abs2(drive);
    if (size2 > gains->drive_limit * gains->drive_limit) {
        drive = an_scale(drive, gains->drive_limit / __builtin_sqrtf(size2));
        pi->integral = an_scale(measured, taken);
        pi->limited = AN_PI_LIMITED;
    } else if (pi->limited != 0u) {
        pi->integral = an_scale(measured, taken);
        pi->limited--;
    } else {
        integrate(pi, gains->age, law->integral + lifted * lighter->integral, measured, reference);
    }
    pi->reference = reference;
    pi->drive = drive;
    return drive;
}
