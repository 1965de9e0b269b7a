/* The slow step of the single-mode build: once a period, from the measured window to the next command.
 *
 * It does the job the main loop posted last: rest, dwell (constant drive, average the response) or track (closed loop).
 * Any fault trips it; it then commands silence until the main loop posts a job that clears the trip.
 */
#ifndef AN_SLOW_H
#define AN_SLOW_H

#include "an_demod.h"
#include "an_fast.h"
#include "an_handover.h"
#include "an_pi.h"
#include "an_track.h"
#include "an_watch.h"
#include "an_types.h"

enum { AN_CLIPPED_MAX = 2 }; /* samples of a window */

typedef struct {
    an_job_kind kind;
    uint32_t clear; /* nonzero: forget earlier trips */
    uint32_t step;
    an_demod demod;
    float amplitude_limit2; /* squared */
    an_complex drive; /* dwell: as commanded, one sample ahead included */
    uint32_t settle;  /* dwell: windows to wait */
    uint32_t average; /* dwell: windows to average */
    an_pi_gains gains; /* track */
    an_watch_plan watch; /* track */
} an_job;

typedef struct {
    an_job jobs[2]; /* one at work, one being prepared */
    an_handover hand;
    float reference; /* track: written by the main loop at any time */
    float envelope;  /* track: the factor it is multiplied by in the next window */
    an_pi pi;
    uint32_t tracking; /* nonzero: the loop is closed, and goes on when a job changes its gains */
    an_track_note notes[AN_TRACK_ROOM]; /* track: the last windows, for the main loop */
    uint32_t noted;
    float quiet; /* rest: |U' - U|^2, smoothed: what noise does */
    uint32_t waited;   /* dwell: windows so far */
    an_complex total;  /* dwell: sum of the averaged windows ... */
    float energy;      /* ... and of their squares */
    uint32_t finished; /* dwell: set when total is complete */
    an_phasor measured; /* in the last window */
} an_slow;

/* At rest at a phase step. False when the step cannot be demodulated. */
bool an_slow_init(an_slow *slow, an_fast *fast, uint32_t step);

/* The job to prepare next, or NULL while the last one has not been taken over. */
an_job *an_slow_vacant(an_slow *slow);

/* True when a dwell's total is complete and may be read. */
bool an_slow_finished(const an_slow *slow);

/* Once for each window, before the gap ends. */
void an_slow_step(an_slow *slow, an_fast *fast);

#endif
