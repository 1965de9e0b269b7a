/* Tells a sensor that fails from a plate, within 100 us: a plate that rings cannot stop or turn about so soon.
 *
 * A look takes the last AN_WATCH_TICKS samples and fits cosine, sine, offset and slope to them: a sensor that went dead or
 * stuck shows no tone from one look to the next, one that changed its sign the opposite. Over two looks the envelope U of
 * a sound one can only go
 *
 *     U' = U + b V D,  b = G / tau,  D the time between them,
 *
 * to within as much again for what the plate's other modes do, and a share for damping and detuning. Where U is so small, or
 * the drive against it so large, that the plate itself might come near zero, nothing is decided: an_track does that later.
 */
#ifndef AN_WATCH_H
#define AN_WATCH_H

#include "an_fast.h"
#include "an_mode.h"
#include "an_types.h"

enum { AN_WATCH_TICKS = 10, AN_WATCH_PAIRS = AN_WATCH_TICKS / 2 };

/* Of one frequency. */
typedef struct {
    float cosine[AN_WATCH_PAIRS]; /* weights of the sums of samples as far before the middle as behind it */
    float sine[AN_WATCH_PAIRS];   /* of their differences */
    an_complex push;              /* b D, of the drive as the fast tick holds it */
    bool decides;
} an_watch_plan;

typedef struct {
    an_complex seen[2];  /* U in the last look and the one before, in counts */
    an_complex given[2]; /* b D V in them */
    float peak;          /* of |U|, squared, forgotten within some milliseconds */
} an_watch;

/* lead turns the drive ahead, as an_pi_gains has it. Tones too low for one turn and a half in a look get a plan that
 * decides nothing. */
void an_watch_prepare(an_watch_plan *plan, const an_mode *mode, an_complex lead, uint32_t step, float sample_rate_hz);

/* Once every AN_WATCH_TICKS ticks: true when the sensor has failed. quiet: of |U' - U|^2 between windows at rest, full
 * scale = 1. */
bool an_watch_look(an_watch *watch, const an_watch_plan *plan, const an_fast *fast, float quiet);

/* Nothing is driven by what the sensor shows. */
void an_watch_forget(an_watch *watch);

#endif
