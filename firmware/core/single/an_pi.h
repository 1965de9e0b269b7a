/* PI control of one mode in the frame rotating with the drive.
 *
 * With the drive at w, the complex envelope U of the mode obeys tau dU/dt + (1 + j tau (w - w0)) U = G V. The zero of
 * the PI controller cancels the plant's pole a = exp(-T/tau):
 *
 *     Kp = (1 - p) / (1 - a) / G,    Ki = (1 - a) Kp per step,    p = exp(-T/response).
 *
 * The open loop is then (1 - p)/(z - 1), and the pole of the closed loop is p, whatever the time constant of the mode.
 *
 * The term V += j tau (w - w0) / G U cancels the cross-coupling of real and imaginary parts. The drive is rotated ahead
 * by the known delay and the phase of the mode, so that G is real and positive here. A measurement is half a window
 * old, plus the gap, when its answer takes effect; the model of the plant predicts U at that time.
 *
 * When a finger lifts, the plate suddenly needs as little as a sixth of the drive, milliseconds before the tracked mode
 * follows. The loop therefore estimates G' from the drive that held the motion over the last step:
 *
 *     U_k+1 - U_k = (G T / tau) (V - U / G').
 *
 * If the drive per unit amplitude, 1 / G', is clearly below 1 / G of the known mode, the law is that of G' and tau',
 * and the integral is limited to the drive that the reference needs.
 *
 * At the drive limit only the phase of the drive is free. A separate, faster pole applies on leaving the limit: the
 * drive stays at the limit until the reference is within reach of one window.
 */
#ifndef AN_PI_H
#define AN_PI_H

#include "an_mode.h"
#include "an_types.h"

#define AN_LOOP_GAIN_MIN 0.1f  /* lower bound on Kp G, below which the plate alone would respond faster */
#define AN_NEIGHBOUR_LOOP 0.5f /* largest loop gain through any other mode, whatever its phase */

/* V = integral + proportional reference - state U - feed V before. */
typedef struct {
    float proportional;
    float integral;   /* per step */
    an_complex state; /* Kp - j tau (w - w0) / G, times the decay of the state until the answer takes effect */
    an_complex feed;  /* Kp - j tau (w - w0) / G, times the response to the last drive until then */
} an_pi_law;

typedef struct {
    an_pi_law law[2];     /* of the known mode: in general; when leaving the limit */
    an_pi_law lighter[2]; /* laws of the plate without a finger, minus those of the known mode */
    float inverse_gain;   /* 1 / G, drive per unit amplitude of the known mode ... */
    float lightest;       /* ... and of the plate without a finger; equal unless the plate is touched */
    float per_lift;       /* inverse of their difference, or 0 */
    float most;           /* upper bound of the estimated drive per amplitude, including its uncertainty */
    float fresh;          /* weight of the last step in the estimate */
    float noise;          /* uncertainty of the estimate due to noise, times the amplitude */
    float pull;           /* drive per unit amplitude and step, tau / (G T); independent of a finger's damping */
    float turning;        /* tau (w - w0) / G */
    float drive_limit;
    float age; /* of a measurement when its answer takes effect, in steps */
    an_complex lead; /* rotates the drive ahead by one sample, the delay and the phase of the mode */
} an_pi_gains;

/* Specification of the loop. */
typedef struct {
    float period_s;         /* T, period of the slow step */
    float ahead_s;          /* from the middle of a measurement window to the start of its answer */
    float response_s;       /* closed-loop time constant, determines p */
    float leaving_s;        /* likewise, when leaving the limit */
    float proportional_max; /* drive over sensor: upper bound on Kp set by the neighbouring modes */
    float noise2;           /* variance of the difference of two measurements at rest */
    float free_gain;        /* |G| without a finger */
} an_pi_spec;

enum { AN_PI_LIMITED = 2 };

typedef struct {
    an_complex integral;
    an_complex drive;    /* last drive, still acting */
    float before;        /* drive before that, real part */
    an_complex measured; /* last measurement */
    float seen;          /* filtered drive per unit amplitude */
    float reference;     /* last reference */
    uint32_t limited; /* AN_PI_LIMITED: last drive at its limit; below: windows until its end shows in a measurement */
} an_pi;

/* Compute the gains for a drive at a phase step, detuning_hz above the mode, whose gain and tau must be nonzero. */
void an_pi_plan(an_pi_gains *gains, const an_mode *mode, uint32_t step, float detuning_hz, const an_pi_spec *spec);

/* Start with the plate moving as measured, as if the loop had held it there. */
void an_pi_init(an_pi *pi, const an_pi_gains *gains, an_complex measured);

/* One step: from the measured phasor and the reference to the drive in the mode's frame, |drive| <= drive_limit. */
an_complex an_pi_step(an_pi *pi, const an_pi_gains *gains, an_complex measured, float reference);

#endif
