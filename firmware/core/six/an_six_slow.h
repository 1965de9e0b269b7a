/* The slow step of the six-channel build: once a period, from six measured phasors to six drives.
 *
 * V = T^-1 (W + I): the target pattern W acts through the inverse of the measured matrix, softly, for a jump would
 * ring the plate's lowest modes; each sensor's integral I takes out what T was wrong about. The measurement has no
 * proportional path: beside its resonances a plate answers the differences between frequencies far more strongly
 * than the drive itself, and an integral of AN_SIX_INTEGRAL per time constant is stable whatever those differences
 * are.
 */
#ifndef AN_SIX_SLOW_H
#define AN_SIX_SLOW_H

#include "an_demod.h"
#include "an_handover.h"
#include "an_six_fast.h"
#include "an_types.h"

#define AN_SIX_INTEGRAL 0.3f

typedef struct {
    an_job_kind kind;
    uint32_t clear; /* nonzero: forget earlier trips */
    uint32_t step;
    uint32_t window;
    uint32_t channels;
    an_demod demod;
    an_complex drive[AN_SIX]; /* dwell: as commanded */
    uint32_t settle;          /* dwell: windows to wait */
    uint32_t average;         /* dwell: windows to average */
    an_complex inverse[AN_SIX * AN_SIX]; /* track: of T, row by row, one sample ahead included */
    an_complex target[AN_SIX];           /* track: W at reference 1 */
    float soft;                          /* track: share of the way W goes in a period */
    float integral;                      /* track: share of the error a period */
    float drive_limit;
    uint32_t patience; /* track: windows that a sensor may differ from the model */
} an_six_job;

typedef struct {
    an_six_job jobs[2];
    an_handover hand;
    float reference;
    float envelope;
    an_complex measured[AN_SIX];
    float offset[AN_SIX]; /* smoothed: a slow mode that rings moves a single window's */
    an_complex drive[AN_SIX];
    an_complex target[AN_SIX]; /* W, as it acted in the last window */
    an_complex integral[AN_SIX];
    an_complex total[AN_SIX]; /* dwell: sums of the averaged windows */
    uint32_t waited;
    uint32_t finished;
    uint32_t limited; /* nonzero: the last command had to be scaled down */
    uint32_t mismatched;
    uint32_t ringing; /* windows more that a plate may ring on beyond the sensors' ends: nothing drives it any longer */
} an_six_slow;

/* At rest at a phase step. False when the step cannot be demodulated in such a window. */
bool an_six_slow_init(an_six_slow *slow, an_six_fast *fast, uint32_t step, uint32_t window);

/* The job to prepare next, or NULL while the last one has not been taken over. */
an_six_job *an_six_slow_vacant(an_six_slow *slow);

/* True when a dwell's totals are complete and may be read. */
bool an_six_slow_finished(const an_six_slow *slow);

/* Once for each window, before the gap ends. */
void an_six_slow_step(an_six_slow *slow, an_six_fast *fast);

#endif
