/* Detection of a failed sensor within a few samples, while the pattern is steady.
 *
 * The phasor of the last window, plus the contribution of ringing slower modes, predicts the present sample x of each
 * sensor. A sample that deviates by more than AN_SIX_ALLOWED counts against the sensor if it is zero (dead), -x
 * (reversed) or equal to the last sample (stuck). Three such samples in a row that together deviate far enough are a
 * fault. The check decides only if the predictions were accurate until a few samples ago, in the mean: one outlier of
 * the noise must not stop it. It therefore does not decide in strong noise, while patterns change, or after a knock on the plate, which fits none of the three.
 */
#ifndef AN_SIX_WATCH_H
#define AN_SIX_WATCH_H

#include "an_six_slow.h"
#include "an_types.h"

/* State of one sensor, full scale = 1. */
typedef struct {
    an_complex tone; /* phasor in the last window */
    float size;      /* its amplitude */
    float offset;
    float shown;    /* last sample minus the offset */
    float expected; /* prediction of that sample */
    float ringing;  /* contribution of slower modes to it */
    float slope;    /* change of that contribution per sample */
    float gone;     /* evidence for a dead sensor: sum of deviations from the predictions */
    float reversed; /* likewise, for a reversed sensor */
    float stuck;    /* evidence for a stuck sensor: sum of predicted movements */
    uint32_t run;   /* consecutive samples that fit any of these */
    float off2;        /* sum of squared deviations from the predictions in the current block of samples ... */
    float off2_before; /* ... in the block before ... */
    float rough2;      /* ... and their mean in earlier blocks, with a memory of some milliseconds */
} an_six_trace;

typedef struct {
    an_six_trace traces[AN_SIX];
} an_six_watch;

/* Check one sample of each sensor, after the tick; true if a sensor has failed. */
bool an_six_watch_look(an_six_watch *watch, const an_six_slow *slow, const an_six_fast *fast, const uint16_t *adc,
                       uint32_t channels);

/* Reset all predictions, while the drives do not depend on the sensors. */
void an_six_watch_forget(an_six_watch *watch);

#endif
