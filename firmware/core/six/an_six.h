/* The six-channel application: measure T, invert it, hold patterns. */
#ifndef AN_SIX_H
#define AN_SIX_H

#include "an_application.h"
#include "an_shaping.h"
#include "an_six_slow.h"
#include "an_six_watch.h"
#include "an_table.h"
#include "an_types.h"

typedef struct {
    an_application base; /* its slot is the shape */
    an_six_fast fast;
    an_six_slow slow;
    an_six_watch watch; /* the looks' own */
    uint32_t phase;     /* of the carrier at the last look */
    an_shape_head shape;
    uint32_t pattern;
    uint32_t channels;
    uint32_t step;
    uint32_t window;
    uint32_t identified; /* nonzero: shaping holds T and its inverse */
    an_shaping shaping;  /* the drive one sample ahead */
    float reachable; /* largest reference that the drive limit allows for the pattern */
    float target_reference;
    bool half_reach; /* started without a reference */
    float probe_level;
    uint32_t probe; /* the actuator being measured */
    uint32_t probing;
    float probed_s; /* what the dwells of this identification take */
    an_table table; /* last: it holds the one pointer */
} an_six;

/* A window holds two periods of its carrier, and the watchdog, at its fastest, allows 8.26 ms for one and all that is done
 * after it. */
enum { AN_SIX_FREQUENCY_MIN_HZ = 350 };

/* Reads the table and rests on its first shape. faults are those the board found before. */
void an_six_boot(an_six *app, const uint8_t *table, uint32_t length, float sample_rate_hz, uint32_t faults);

/* Once for each window, before the gap ends. */
void an_six_window_end(an_six *app);

/* Holds a pattern of the present shape at reference (sensor full scales at its largest target; 0: half of what is
 * reachable); measures T first when it is not known. False unless idle and the values are in range. */
bool an_six_start(an_six *app, uint32_t pattern, float reference);

/* Another shape, which is another frequency; only when idle. */
bool an_six_choose(an_six *app, uint32_t shape);

/* Another pattern of the same shape while running. */
bool an_six_change(an_six *app, uint32_t pattern);

/* A new reference while running, clipped to what is reachable. */
void an_six_set_reference(an_six *app, float reference);

/* Faults that a look finds before a window's end, from an interrupt of the fast tick's priority: a sensor at the converter's
 * end, and damage to what the tick relies on, mended so that windows go on to end. */
uint32_t an_six_check(an_six *app);

/* After each tick, with its samples: the fault of a sensor that shows what no plate can. */
uint32_t an_six_look(an_six *app, const uint16_t *adc);

/* The log's record of the last window: sensor and drive of the pattern's largest target, reference. */
void an_six_record(const an_six *app, float *record);

/* What this build gives to what both share. */
extern const an_build an_six_build;

/* Members of it that stand in another file than the rest. */
uint8_t *an_six_put_status(const an_application *app, uint8_t *at);
an_result an_six_handle_request(an_application *app, const an_message *request);

#endif
