/* Control of one mode in its rotating frame.
 *
 * The plant, seen from a drive at w: tau dU/dt + (1 + j tau (w - w0)) U = G V. Proportional and integral gains
 * cancel its pole a = exp(-T/tau):
 *
 *     Kp = (1 - p) / (1 - a) / G,    Ki = (1 - a) Kp a step,    p = exp(-T/response).
 *
 * The open loop is then (1 - p)/(z - 1) and the closed loop's pole p, whatever the mode's own tau.
 *
 * V += j tau (w - w0) / G U cancels its cross-coupling, and the drive is turned ahead by the known delay and the
 * mode's own phase, so that G counts as real here. A measurement is half a window old when its answer begins to
 * act: the plant's model carries it on to that moment.
 *
 * A finger that lifts leaves within milliseconds a plate that needs a sixth of the drive, long before the mode that is
 * followed shows it. So the drive that held the motion over the last step is weighed, from
 *
 *     U_k+1 - U_k = (G T / tau) (V - U / G'):
 *
 * whenever a unit of amplitude takes clearly less of it than 1 / G of the known mode, the law is that of the lesser G' and
 * tau', and the integral holds no more than the reference takes.
 *
 * Where the drive is limited only its direction counts. The way out of the limit has a pole of its own, a window long: the
 * drive stays at its limit until one window is enough to arrive.
 */
#ifndef AN_PI_H
#define AN_PI_H

#include "an_mode.h"
#include "an_types.h"

/* V = integral + proportional reference - state U - feed V before. */
typedef struct {
    float proportional;
    float integral;   /* a step */
    an_complex state; /* Kp - j tau (w - w0) / G, times what is left of a measurement when its answer acts */
    an_complex feed;  /* the same, times what the last drive adds until then */
} an_pi_law;

typedef struct {
    an_pi_law law[2];     /* of the mode as it is known: in general; from the limit */
    an_pi_law lighter[2]; /* what the laws of the plate without a finger have more */
    float inverse_gain;   /* drive that a unit of amplitude takes: of the mode as it is known ... */
    float lightest;       /* ... and of the plate without a finger; the same where none lies on it */
    float per_lift;       /* 1 over the difference of the two, or 0 */
    float most;           /* what the mode as it is known is seen to take, doubts included */
    float fresh;          /* share of the last step in what is seen */
    float noise;          /* what noise makes of it, times the amplitude */
    float pull;           /* drive that makes a unit of amplitude in a step, tau / (G T): no finger changes force and mass */
    float turning;        /* tau (w - w0) / G */
    float drive_limit;
    float age; /* of a measurement when its answer begins to act, in steps */
    an_complex lead; /* turns the drive ahead: one sample, the delay, the mode's phase */
} an_pi_gains;

/* What the loop is asked for. */
typedef struct {
    float period_s;         /* of the slow step */
    float ahead_s;          /* from the moment a measurement stands for to its answer */
    float response_s;       /* gives p */
    float leaving_s;        /* the same, from the limit */
    float proportional_max; /* drive over sensor: what the neighbours of the mode allow */
    float noise2;           /* at rest, of the difference of two measurements */
    float free_gain;        /* |G| without a finger */
} an_pi_wish;

enum { AN_PI_LIMITED = 2 };

typedef struct {
    an_complex integral;
    an_complex drive; /* the last, still acting */
    float before;        /* the one before that, in phase with the reference */
    an_complex measured; /* the last */
    float seen;          /* drive that a unit of amplitude took lately */
    float reference;  /* the last */
    uint32_t limited; /* AN_PI_LIMITED: the last drive met its limit; less: windows until its end shows in the measurement */
} an_pi;

/* Gains for a drive at a phase step, detuning_hz away from the mode. The mode must have been checked: gain and tau
 * not zero. */
void an_pi_plan(an_pi_gains *gains, const an_mode *mode, uint32_t step, float detuning_hz, const an_pi_wish *wish);

/* Starts from a plate that moves as measured, as if the loop had held it there. */
void an_pi_init(an_pi *pi, const an_pi_gains *gains, an_complex measured);

/* One step: measured phasor and reference in, drive in the mode's frame out, |drive| <= drive_limit. */
an_complex an_pi_step(an_pi *pi, const an_pi_gains *gains, an_complex measured, float reference);

#endif
