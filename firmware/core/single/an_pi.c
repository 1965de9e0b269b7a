#include "an_pi.h"

#include "an_complex.h"
#include "an_sine.h"

#define AN_TWO_PI 6.2831853f
#define AN_UPDATE_RATE 6.0f    /* per tau: a memory of tau / 6, in which a released plate covers a sixth of its way */
#define AN_UNSEEN 2.0f         /* times gains->most: there is no estimate yet */
#define AN_LOOKAHEAD 2.6f      /* two steps from the middle of the data to the end of the next answer, and what the margins below
                                * hide of a lift; with 3.2 a plate of Q 30 is braked so hard that it swings back */
#define AN_DRIVE_ERROR 0.02f   /* relative uncertainty of the drive, from its timing and from the gain of the mode */
#define AN_NOISE_SIGMAS 6.0f   /* a decrease must exceed this many standard deviations */
#define AN_NEAR_RATIO 0.5f     /* amplitude over reference, or its inverse; farther apart, no finger is lifting */
#define AN_AMPLITUDE_MIN 0.004f /* of full scale: eight codes */
#define AN_TOUCHED_RATIO 1.25f /* times the damping of the free plate */
#define AN_FREE_MARGIN 0.8f    /* lower bound on the drive per amplitude, relative to that of the free plate */

/* exp(-x) for x >= 0 as a Pade approximant: between 0 and 1, with an error below 1e-4 for x up to 0.7. */
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

/* Quantities common to the control laws of a plate, whatever its damping. */
typedef struct {
    float push;             /* b T = G T / tau: amplitude that unit drive adds in a step */
    float turning;          /* tau (w - w0) / G */
    float age;              /* of a measurement when its answer takes effect, in steps */
    float proportional_max;
    an_complex turn;        /* rotation of the free mode, in the drive's frame, over that age */
    float reached[2];       /* 1 - p, in general and when leaving the limit */
} an_basis;

/* Control law of a plate that needs the drive taken = 1 / G' per unit amplitude. A finger changes G' and tau' alike, so
 * that b = G / tau is known and T / tau' = b T / G'; spent is 1 - a'. The prediction from the middle of the window to
 * the time when the answer takes effect is U = decay * (measured U) + push * (last drive). */
static an_pi_law law_of(const an_basis *basis, float taken, uint32_t limited)
{
    const float spent = 1.0f - decay_of(basis->push * taken);
    const float least = AN_LOOP_GAIN_MIN * taken;
    const float aimed = basis->reached[limited] * taken / spent;
    const float bounded = aimed < basis->proportional_max ? aimed : basis->proportional_max;
    const float proportional = bounded > least ? bounded : least;
    const an_complex feedback = an_cplx(proportional, -basis->turning);
    const an_complex decay = an_scale(basis->turn, decay_of(basis->age * basis->push * taken));
    const an_complex steady = an_div(an_cplx(1.0f, 0.0f), an_cplx(taken, basis->turning));
    const an_complex push = an_mul(an_sub(an_cplx(1.0f, 0.0f), decay), steady);
    return (an_pi_law){proportional, proportional * spent, an_mul(feedback, decay), an_mul(feedback, push)};
}

/* Laws of the known mode, and their differences from those of the free plate, for interpolation in between. */
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

void an_pi_plan(an_pi_gains *gains, const an_mode *mode, uint32_t step, float detuning_hz, const an_pi_spec *spec)
{
    const float size = an_abs(mode->gain);
    const float late = (mode->frequency_hz + detuning_hz) * mode->delay_s;
    const float fresh = AN_UPDATE_RATE * spec->period_s / mode->tau_s;
    const an_basis basis = {
        .push = size * spec->period_s / mode->tau_s,
        .turning = AN_TWO_PI * detuning_hz * mode->tau_s / size,
        .age = spec->ahead_s / spec->period_s,
        .proportional_max = spec->proportional_max,
        .turn = an_turn(phase_of_turns(-detuning_hz * spec->ahead_s)),
        .reached = {1.0f - decay_of(spec->period_s / spec->response_s),
                    1.0f - decay_of(spec->period_s / spec->leaving_s)},
    };
    const bool touched = spec->free_gain > AN_TOUCHED_RATIO * size;
    gains->inverse_gain = 1.0f / size;
    gains->lightest = touched ? AN_FREE_MARGIN / spec->free_gain : gains->inverse_gain;
    gains->per_lift = touched ? 1.0f / (gains->inverse_gain - gains->lightest) : 0.0f;
    plan_laws(gains, &basis);
    gains->most = (1.0f + AN_DRIVE_ERROR) * gains->inverse_gain;
    gains->fresh = fresh < 1.0f ? fresh : 1.0f;
    gains->pull = 1.0f / basis.push;
    gains->noise = AN_NOISE_SIGMAS * gains->fresh * gains->pull * __builtin_sqrtf(spec->noise2);
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

/* Predict the drive per unit amplitude, 1 / G', while the next answer acts: that of the known mode, or clearly less.
 *
 * held is the drive that balanced the damping from the middle of one window to the middle of the next, with the old
 * drive acting until the gap had passed and the new one after that. A first-order filter smooths held over amplitude.
 * All uncertainties are added, so that only a clear decrease changes the law. A decrease is extrapolated to the end of
 * the next answer. */
static float drive_per_amplitude(an_pi *pi, const an_pi_gains *gains, an_complex measured, float reference)
{
    const float middle = 0.5f * (measured.re + pi->measured.re);
    const float drive = pi->drive.re + gains->age * (pi->before - pi->drive.re);
    const float crossed = 0.5f * gains->turning * (measured.im + pi->measured.im);
    const float held = drive - gains->pull * (measured.re - pi->measured.re) + crossed;
    const bool near = measured.re > AN_NEAR_RATIO * reference && AN_NEAR_RATIO * measured.re < reference;
    pi->measured = measured;
    pi->before = pi->drive.re;
    if (!near || measured.re < AN_AMPLITUDE_MIN || middle < AN_NEAR_RATIO * AN_AMPLITUDE_MIN) {
        pi->seen = AN_UNSEEN * gains->most;
        return gains->inverse_gain;
    }
    const float each = 1.0f / middle;
    const float was = smaller(pi->seen, gains->most);
    const float ahead = pi->seen < AN_UNSEEN * gains->most ? AN_LOOKAHEAD : 1.0f; /* a first fall may be older */
    const float now = was + gains->fresh * (each * (held + AN_DRIVE_ERROR * __builtin_fabsf(drive)) - was);
    pi->seen = smaller(now, gains->most);
    const float taken = pi->seen - ahead * (was - smaller(was, pi->seen)) + gains->noise * each;
    const float lighter = smaller(taken, gains->inverse_gain);
    return lighter > gains->lightest ? lighter : gains->lightest;
}

/* Compare the measurement with the reference at the time of the measurement, interpolated between two steps. With the
 * new reference, the integral would gain half a step too much and the amplitude would overshoot. */
static void integrate(an_pi *pi, float age, float integral, an_complex measured, float reference)
{
    const float then = reference - age * (reference - pi->reference);
    pi->integral.re += integral * (then - measured.re);
    pi->integral.im -= integral * measured.im;
}

/* V = I + Kp r - state U - feed V_before, with anti-windup: while the drive is limited, the integral is set to the
 * drive that holds the present amplitude. The loop then leaves the limit as if it had just been closed, without
 * overshoot or creep. */
an_complex an_pi_step(an_pi *pi, const an_pi_gains *gains, an_complex measured, float reference)
{
    const uint32_t leaves = pi->limited == AN_PI_LIMITED ? 1u : 0u;
    const an_pi_law *law = &gains->law[leaves];
    const an_pi_law *lighter = &gains->lighter[leaves];
    const float taken = drive_per_amplitude(pi, gains, measured, reference);
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
