/* Detection of a failed sensor within 100 us: a ringing plate cannot stop or reverse that quickly.
 *
 * Each check fits cosine, sine, offset and slope to the last AN_WATCH_TICKS samples. From one check to the next, the
 * carrier disappears from the signal of a dead or stuck sensor and changes sign in that of a reversed one. The envelope
 * U from an intact sensor, by contrast, can only change as
 *
 *     U' = U + b V D,    b = G / tau,
 *
 * over the time D of two checks, plus the same amount again for the other modes of the plate and a fraction of U for
 * damping and detuning. If U is so small, or the opposing drive so strong, that the plate itself might come near zero,
 * the check does not decide; an_track does so later.
 */
#ifndef AN_WATCH_H
#define AN_WATCH_H

#include "an_fast.h"
#include "an_mode.h"
#include "an_types.h"

enum { AN_WATCH_TICKS = 10, AN_WATCH_PAIRS = AN_WATCH_TICKS / 2 };

/* Weights of the fit at one frequency. */
typedef struct {
    float cosine[AN_WATCH_PAIRS]; /* weights of the sums of two samples, equally far before and after the middle */
    float sine[AN_WATCH_PAIRS];   /* weights of their differences */
    an_complex push;              /* b D, for the drive in the fast tick's units and frame */
    bool decides;
} an_watch_plan;

typedef struct {
    an_complex seen[2];  /* U in the last check and the one before, in counts */
    an_complex given[2]; /* b D V in the same checks */
    float peak;          /* recent peak of |U|^2, with a memory of some milliseconds */
} an_watch;

/* Compute the weights; lead rotates the drive ahead, as in an_pi_gains. At frequencies
 * with less than about one and a half periods per check, the plan never decides. */
void an_watch_prepare(an_watch_plan *plan, const an_mode *mode, an_complex lead, uint32_t step, float sample_rate_hz);

/* Check once every AN_WATCH_TICKS ticks; true if the sensor has failed. quiet is |U' - U|^2 between windows at rest,
 * with full scale = 1. */
bool an_watch_look(an_watch *watch, const an_watch_plan *plan, const an_fast *fast, float quiet);

/* Start again, while the drive does not depend on the sensor. */
void an_watch_forget(an_watch *watch);

#endif
