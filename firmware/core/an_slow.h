/* The slow step of the single-mode build: once a period, from the measured window to the next command.
 *
 * It does the job the main loop posted last: rest, dwell (constant drive, average the response) or track (closed loop).
 * Any fault trips it; it then commands silence until the main loop posts a job that clears the trip.
 */
#ifndef AN_SLOW_H
#define AN_SLOW_H

#include "an_demod.h"
#include "an_fast.h"
#include "an_pi.h"
#include "an_types.h"

enum { AN_JOB_REST, AN_JOB_DWELL, AN_JOB_TRACK };

enum { AN_CLIPPED_MAX = 2 }; /* samples of a window */

typedef struct {
    uint32_t kind;
    uint32_t clear; /* nonzero: forget earlier trips */
    uint32_t step;
    an_demod demod;
    float amplitude_limit2; /* squared */
    an_complex drive; /* dwell: as commanded, one sample ahead included */
    uint32_t settle;  /* dwell: windows to wait */
    uint32_t average; /* dwell: windows to average */
    an_pi_gains gains; /* track */
    uint32_t patience; /* track: windows that sensor and model may disagree, as they do while neighbours ring out */
} an_job;

typedef struct {
    an_job jobs[2]; /* one at work, one being prepared */
    uint32_t active;
    uint32_t posted;
    float reference; /* track: written by the main loop at any time */
    float envelope;  /* track: the factor it is multiplied by in the next window */
    an_pi pi;
    uint32_t waited;   /* dwell: windows so far */
    an_complex total;  /* dwell: sum of the averaged windows */
    uint32_t finished; /* dwell: set when total is complete */
    uint32_t mismatched;
    uint32_t trips;
    uint32_t outside; /* faults found elsewhere: written by the main loop alone */
    an_phasor measured; /* in the last window */
} an_slow;

/* At rest at a phase step. False when the step cannot be demodulated. */
bool an_slow_init(an_slow *slow, an_fast *fast, uint32_t step);

/* The job to prepare next, or NULL while the last one has not been taken over. */
an_job *an_slow_vacant(an_slow *slow);

/* Hands the prepared job to the slow step. */
void an_slow_post(an_slow *slow);

/* Once for each window, before the gap ends. */
void an_slow_step(an_slow *slow, an_fast *fast);

#endif
