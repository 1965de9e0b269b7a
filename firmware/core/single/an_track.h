/* Follows the mode while it is driven, and tells a touched plate from one that is not there.
 *
 * With b = G / tau, which neither a finger's damping nor its stiffness changes, and a = 1/tau + j (w - w0), the envelope
 * obeys dU/dt + a U = b V. Over one period T from the middle of a window to that of the next
 *
 *     y = b T V - (U' - U) = a T (U + U') / 2.
 *
 * The slow step only notes U and V. The main loop sums energies over AN_TRACK_WINDOWS windows, makes the least-squares a
 * of them, lets frequency and time constant follow it slowly, and judges. Window by window, what the drives must have
 * moved even the most damped plate is compared with what the sensor shows, and the work done with the energy shown:
 * d|U|^2/dt = 2 Re((b V - a U) U*), and Re a is negative for none but a sensor that shows the opposite. At the end of each
 * block a drive that moves next to nothing, a motion that needs no drive, and a y that no a explains are faults; damping and
 * detuning are not.
 * While the reference moves, the plate's other modes move too: then only what no neighbour can do is a fault.
 */
#ifndef AN_TRACK_H
#define AN_TRACK_H

#include "an_pi.h"
#include "an_types.h"

enum { AN_TRACK_WINDOWS = 16, AN_TRACK_ROOM = 32 };

/* A window: what was measured, and the drive that acted in it. */
typedef struct {
    an_complex measured;
    an_complex drive;
    uint32_t limited; /* as an_pi's */
} an_track_note;

/* Of a block of windows. */
typedef struct {
    float given;        /* sum of |b T V|^2 */
    float supply;       /* sum of |y|^2 */
    an_complex product; /* sum of y conj(U + U') */
    float motion;       /* sum of |U + U'|^2 */
    uint32_t limited;   /* windows in which the drive met its limit */
    uint32_t count;     /* windows */
} an_balance;

/* What the loop works with, and how sure it is. */
typedef struct {
    float period_s;
    float rate;       /* 1/tau as identified, 1/s */
    float push;       /* b T */
    float share;      /* of T in which the newer of two drives acts */
    uint32_t read;    /* notes so far */
    an_balance block; /* in the making */
    float drive_limit;
    float detuning;   /* asked for, rad/s */
    float span;       /* the resonance may move so far, rad/s */
    float noise2;     /* of U' - U, squared */
    float shift;      /* of the resonance from where it was identified, rad/s */
    float rate_now;   /* 1/tau */
    uint32_t idle;    /* blocks in which the drive moved next to nothing; each counts up by one and down by one */
    uint32_t undriven; /* in which the plate moved without need of a drive */
    uint32_t odd;      /* in which the model explained too little, of a plate that ought to be steady */
    uint32_t odd_most;
    uint32_t unsteady; /* blocks until a change of the reference has passed */
    uint32_t limited;  /* nonzero: the drive was at its limit for most of the last block */
    an_complex least;  /* U of the most damped plate there may be, from the drives since it showed anything */
    uint32_t hidden;   /* windows in a row that show less than half of it */
    uint32_t hidden_most;
    float unpaid; /* of |U|^2: what grew lately without work of the drive */
    float shown;  /* the largest |U|^2 lately */
} an_track;

/* Begins with a mode; detuning_hz as asked for; noise2 as seen at rest. What was followed before is kept when it is the
 * same mode still. */
void an_track_begin(an_track *track, const an_mode *mode, const an_pi_wish *wish, float detuning_hz, float noise2);

/* Forgets where the resonance went: another mode, or one measured anew. */
void an_track_forget(an_track *track);

/* What became of the notes. */
typedef enum {
    AN_TRACK_WAITS, /* no block is complete */
    AN_TRACK_FOLLOWS,
    AN_TRACK_LOST /* the model is no longer that of the plate: a fault */
} an_track_result;

/* Takes in the notes that are new, of the last AN_TRACK_ROOM, until a block is complete: written notes so far. A block
 * whose notes were overwritten before they were read is begun anew. */
an_track_result an_track_read(an_track *track, const an_track_note *notes, uint32_t written);

/* The reference has changed, or goes on changing. */
void an_track_disturb(an_track *track);

/* Of the resonance from where it was identified. */
float an_track_shift_hz(const an_track *track);

/* The mode as it is now. */
void an_track_mode(const an_track *track, const an_mode *identified, an_mode *now);

#endif
