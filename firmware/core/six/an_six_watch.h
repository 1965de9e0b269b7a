/* Tells a sensor that fails within a few samples, while the patterns are steady.
 *
 * The phasor of the last window, and what slower modes that ring add to it, foretell what each sensor ought to show now, x. A
 * sample that is further off than AN_SIX_ALLOWED must be that of a sensor that shows nothing, or -x, or what it showed
 * before; three in a row that together are far enough from x are a fault. Nothing is decided unless x was foretold well
 * until a few samples ago: not where noise is strong, nor while patterns change, nor after a knock on the plate, which fits
 * none of the three.
 */
#ifndef AN_SIX_WATCH_H
#define AN_SIX_WATCH_H

#include "an_six_slow.h"
#include "an_types.h"

/* Of one sensor, full scale = 1. */
typedef struct {
    an_complex tone; /* as last measured; its size; the offset */
    float size;
    float offset;
    float shown;    /* the last sample, less the offset */
    float expected; /* then */
    float ringing;  /* what slower modes added then, and its movement in a sample */
    float slope;
    float gone;     /* what speaks for a sensor that shows nothing: how far it was from what was expected, summed ... */
    float reversed; /* for one that changed its sign ... */
    float stuck;    /* for one that stands still: how far it ought to have moved */
    uint32_t run;   /* samples in a row that fit any of these */
    float off;        /* largest distance from what was expected, in the last few samples ... */
    float off_before; /* ... in the few before ... */
    float rough;      /* ... and in those before them, forgotten within milliseconds */
} an_six_trace;

typedef struct {
    an_six_trace traces[AN_SIX];
} an_six_watch;

/* Once a sample, after the tick: true when a sensor has failed. */
bool an_six_watch_look(an_six_watch *watch, const an_six_slow *slow, const an_six_fast *fast, const uint16_t *adc,
                       uint32_t channels);

/* Nothing is driven by what the sensors show: all is to be foretold anew. */
void an_six_watch_forget(an_six_watch *watch);

#endif
