/* Slow step of the single-mode build: once per period, from the measured window to the next command.
 *
 * It executes the job that the main loop posted last: rest, dwell (constant drive with averaged response, or a chirp) or
 * track (closed loop). After any fault it commands zero drive until the main loop posts a job that clears the fault.
 */
#ifndef AN_SLOW_H
#define AN_SLOW_H

#include "an_chirp.h"
#include "an_demod.h"
#include "an_dwell.h"
#include "an_fast.h"
#include "an_handover.h"
#include "an_pi.h"
#include "an_track.h"
#include "an_watch.h"
#include "an_types.h"

enum { AN_CLIPPED_MAX = 2 }; /* samples per window */

typedef struct {
    an_job_kind kind;
    uint32_t clear; /* nonzero: clear earlier faults */
    uint32_t step;
    an_demod demod;
    float amplitude_limit2; /* squared */
    an_complex drive; /* dwell: commanded drive, one sample ahead */
    an_chirp_request chirp; /* dwell: sweep of the drive, unless its steps are 0 */
    uint32_t settle;  /* dwell: windows to wait */
    uint32_t average; /* dwell: windows to average */
    an_pi_gains gains; /* track */
    an_watch_plan watch; /* track */
} an_job;

typedef struct {
    an_job jobs[2]; /* one active, one in preparation */
    an_handover hand;
    float reference; /* track: written by the main loop at any time */
    float envelope;  /* track: factor of the reference in the next window */
    an_pi pi;
    uint32_t tracking; /* nonzero: the loop is closed and continues when a job changes its gains */
    an_track_note notes[AN_TRACK_ROOM]; /* track: the last windows, for the main loop */
    uint32_t noted; /* track: windows noted so far */
    float quiet; /* rest: smoothed |U' - U|^2 between windows, due to noise */
    an_dwell dwell;
    an_chirp chirp;
    an_complex total;  /* dwell: sum of the averaged windows ... */
    float energy;      /* ... and of their squares */
    an_phasor measured; /* last window */
} an_slow;

/* Start at rest with a phase step. Returns false if the step cannot be demodulated. */
bool an_slow_init(an_slow *slow, an_fast *fast, uint32_t step);

/* Return the job to prepare next, or NULL while the last one waits to be taken over. */
an_job *an_slow_vacant(an_slow *slow);

/* One slow step; called once per window, before the end of the gap. */
void an_slow_step(an_slow *slow, an_fast *fast);

#endif
