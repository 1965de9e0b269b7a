/* Slow step of the six-channel build: once per period, from six measured phasors to six drives.
 *
 *     V = T^-1 (W + I)
 *
 * The target pattern W is applied through the inverse of the measured matrix T. It fades in through a first-order
 * filter, because a step would excite the plate's lowest modes. An integral I per sensor corrects the errors of T.
 *
 * There is no proportional feedback. Off resonance, the envelope responds far more strongly at the difference
 * frequencies between modes and drive than in steady state. A purely integral gain of AN_SIX_INTEGRAL per time constant
 * is stable for any such differences.
 *
 * A sensor is lost if, for longer than a disturbance lasts, it differs from the model W + I, shows less than a quarter
 * of its steady target, or has an error that keeps growing. Every target is therefore at least AN_SIX_PILOT of the
 * largest: a sensor that is to show nothing would otherwise show the same whether it works or not.
 */
#ifndef AN_SIX_SLOW_H
#define AN_SIX_SLOW_H

#include "an_demod.h"
#include "an_dwell.h"
#include "an_handover.h"
#include "an_six_fast.h"
#include "an_types.h"

#define AN_SIX_INTEGRAL 0.3f
#define AN_SIX_PILOT 0.03f

typedef struct {
    an_job_kind kind;
    uint32_t clear; /* nonzero: clear earlier faults */
    uint32_t step;
    uint32_t window;
    uint32_t channels;
    an_demod demod;
    an_complex drive[AN_SIX]; /* dwell: commanded drives */
    uint32_t settle;          /* dwell: windows to wait */
    uint32_t average;         /* dwell: windows to average */
    an_complex inverse[AN_SIX * AN_SIX]; /* track: T^-1 by rows, rotated ahead by one sample */
    an_complex target[AN_SIX];           /* track: W at reference 1 */
    float soft; /* fraction of its remaining way that W covers per period (track), or a drive (dwell) */
    float integral;                      /* track: fraction of the error added per period */
    float drive_limit;
    uint32_t patience; /* track: doubts that make a sensor lost, AN_SIX_DOUBT per window that differs from the model */
} an_six_job;

typedef struct {
    an_six_job jobs[2];
    an_handover hand;
    float reference;
    float envelope;
    an_complex measured[AN_SIX];
    float offset[AN_SIX]; /* smoothed, because a ringing slow mode shifts the offset of a single window */
    an_complex drive[AN_SIX];
    an_complex target[AN_SIX]; /* W in the last window */
    an_complex integral[AN_SIX];
    an_complex total[AN_SIX]; /* dwell: sums of the averaged windows ... */
    float energy[AN_SIX];     /* ... and of their squares */
    an_dwell dwell;
    float limit;      /* of the drives: follows the job's as the targets follow theirs */
    uint32_t limited; /* nonzero: the last command was scaled down to the limit */
    float shown; /* of the integrals, by the sensors in the last window */
    an_complex error[AN_SIX]; /* smoothed over a time constant */
    uint32_t mismatched; /* doubts, up and down */
    uint32_t fading; /* nonzero: the targets fade out, whatever the reference */
    uint32_t ringing; /* windows for which an undriven plate may still ring beyond the sensors' range */
} an_six_slow;

enum { AN_SIX_DOUBT = 4, AN_SIX_DOUBTS_MAX = 2 * AN_SIX_DOUBT };

/* Start at rest with a phase step and window. */
void an_six_slow_init(an_six_slow *slow, an_six_fast *fast, uint32_t step, uint32_t window);

/* Return the job to prepare next, or NULL while the last one waits to be taken over. */
an_six_job *an_six_slow_vacant(an_six_slow *slow);

/* One slow step; called once per window, before the end of the gap. */
void an_six_slow_step(an_six_slow *slow, an_six_fast *fast);

#endif
