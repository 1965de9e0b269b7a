/* Tracking of the mode while it is driven, and detection of a lost plate or sensor, as opposed to a touched plate.
 *
 * With b = G / tau, which a finger's damping and stiffness leave unchanged, and a = 1/tau + j (w - w0), the envelope
 * obeys dU/dt + a U = b V. Over one period T, from the middle of one window to the middle of the next (trapezoidal
 * rule),
 *
 *     y = b T V - (U' - U) = a T (U + U') / 2.
 *
 * The slow step only records U and V. The main loop sums the normal equations over a block of AN_TRACK_WINDOWS windows,
 * solves for a by least squares, and lets frequency and time constant follow with a first-order filter.
 *
 * Two checks run in every window. The sensor must show the motion that the drives cause even in the most heavily damped
 * plate, and the energy shown must not exceed the work done: d|U|^2/dt = 2 Re((b V - a U) U*), where only a reversed
 * sensor makes Re a negative. At the end of each block, three findings are faults: a drive with almost no effect, a
 * motion that needs no drive, and a y that no a explains. Changes of damping and detuning are not. While the reference
 * changes, other modes move as well; only findings that no neighbouring mode can cause are faults then.
 */
#ifndef AN_TRACK_H
#define AN_TRACK_H

#include "an_pi.h"
#include "an_types.h"

enum { AN_TRACK_WINDOWS = 16, AN_TRACK_ROOM = 32 };

/* Record of a window: the measured phasor, and the drive that acted in it. */
typedef struct {
    an_complex measured;
    an_complex drive;
    uint32_t limited; /* as an_pi's */
} an_track_note;

/* Sums over a block of windows. */
typedef struct {
    float given;        /* sum of |b T V|^2 */
    float supply;       /* sum of |y|^2 */
    an_complex product; /* sum of y conj(U + U') */
    float motion;       /* sum of |U + U'|^2 */
    uint32_t limited;   /* windows with the drive at its limit */
    uint32_t count;     /* windows */
} an_balance;

/* Tracked values and the counters of the checks. */
typedef struct {
    float period_s;
    float rate;       /* 1/tau as identified, 1/s */
    float push;       /* b T */
    float share;      /* of T during which the newer of two drives acts */
    uint32_t read;    /* notes read so far */
    an_balance block; /* current block */
    float drive_limit;
    float detuning;   /* as requested, rad/s */
    float span;       /* largest shift of the resonance, rad/s */
    float noise2;     /* |U' - U|^2 due to noise */
    float shift;      /* of the resonance since its identification, rad/s */
    float rate_now;   /* 1/tau as tracked, 1/s */
    uint32_t idle;    /* blocks in which the drive had almost no effect; these three counters go up and down */
    uint32_t undriven; /* blocks in which the plate moved without needing a drive */
    uint32_t unexplained; /* blocks in steady state that the model explains too little */
    uint32_t unexplained_most;
    uint32_t unsteady; /* blocks until a change of the reference has settled */
    uint32_t unsteady_most;
    float neighbour; /* bound of the neighbours' response over the mode's */
    uint32_t limited;  /* nonzero: the drive was at its limit for most of the last block */
    an_complex least;  /* U of the most heavily damped plate, driven since the sensor last showed enough */
    uint32_t hidden;   /* consecutive windows that show less than half of it */
    uint32_t hidden_most;
    float unsupplied; /* recent growth of |U|^2 without work by the drive */
    float shown;  /* recent maximum of |U|^2 */
} an_track;

/* Start tracking a mode; detuning_hz as requested, noise2 as measured at rest. A shift tracked before is kept. */
void an_track_begin(an_track *track, const an_mode *mode, const an_pi_spec *spec, float detuning_hz, float noise2);

/* Reset the tracked shift, for another mode or after a new measurement. */
void an_track_forget(an_track *track);

/* Result of reading the notes. */
typedef enum {
    AN_TRACK_WAITS, /* block not complete */
    AN_TRACK_FOLLOWS,
    AN_TRACK_LOST /* the model no longer describes the plate: a fault */
} an_track_result;

/* Read new notes out of the last AN_TRACK_ROOM until a block is complete; written is the number of notes so far. If
 * notes were overwritten before they were read, the block starts again. */
an_track_result an_track_read(an_track *track, const an_track_note *notes, uint32_t written);

/* Report a change of the reference. */
void an_track_disturb(an_track *track);

/* Shift of the resonance since its identification, in Hz. */
float an_track_shift_hz(const an_track *track);

/* Return the mode as tracked. */
void an_track_mode(const an_track *track, const an_mode *identified, an_mode *now);

#endif
