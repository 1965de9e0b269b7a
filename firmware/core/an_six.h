/* The six-channel application: measure T, invert it, hold patterns. */
#ifndef AN_SIX_H
#define AN_SIX_H

#include "an_link.h"
#include "an_shaping.h"
#include "an_six_slow.h"
#include "an_supervisor.h"
#include "an_table.h"
#include "an_texture.h"
#include "an_types.h"

typedef struct {
    an_six_fast fast;
    an_six_slow slow;
    an_texture texture;
    an_shape_head shape;
    uint32_t shape_index;
    uint32_t pattern;
    uint32_t channels;
    uint32_t step;
    uint32_t window;
    uint32_t identified; /* nonzero: shaping holds T and its inverse */
    an_shaping shaping;  /* the drive one sample ahead */
    float reachable; /* largest reference that the drive limit allows for the pattern */
    float wanted_reference;
    bool half_reach; /* started without a reference */
    float probe_level;
    uint32_t probe; /* the actuator being measured */
    uint32_t probing;
    an_supervisor supervisor;
    uint32_t worst_cycles;
    float sample_rate_hz;
    an_table table; /* last: it holds the one pointer */
} an_six;

/* A window holds two periods of its carrier, and the watchdog, at its fastest, allows 8.26 ms for one and all that is done
 * after it. */
enum { AN_SIX_FREQUENCY_MIN_HZ = 350 };

/* Whether a sound table is one for this build at this rate, and within what it can do. */
an_table_result an_six_accepts(const an_table *table, float sample_rate_hz);

/* Reads the table and rests on its first shape. faults are those the board found before. */
void an_six_boot(an_six *app, const uint8_t *table, uint32_t length, float sample_rate_hz, uint32_t faults);

/* Once for each window, before the gap ends. */
void an_six_window_end(an_six *app);

/* One pass of the main loop. */
void an_six_poll(an_six *app);

/* Holds a pattern of the present shape at reference (sensor full scales at its largest target; 0: half of what is
 * reachable); measures T first when it is not known. False unless idle and the values are in range. */
bool an_six_start(an_six *app, uint32_t pattern, float reference);

/* Measures T anew, known or not, and rests. False unless idle. */
bool an_six_identify(an_six *app);

/* Another shape, which is another frequency; only when idle. */
bool an_six_choose(an_six *app, uint32_t shape);

/* Another pattern of the same shape while running. */
bool an_six_change(an_six *app, uint32_t pattern);

/* A new reference while running, clipped to what is reachable. */
void an_six_refer(an_six *app, float reference);

void an_six_stop(an_six *app);
bool an_six_clear(an_six *app);
void an_six_trip(an_six *app, uint32_t fault);

/* Faults that a look from outside finds in what the fast tick relies on, mended so that windows go on to end; from an
 * interrupt of its priority. */
uint32_t an_six_check(an_six *app);

/* A request of the host, as an_link passes it on. */
an_result an_six_obey(void *app, const an_message *request, const an_table *staged, an_message *reply);

/* The log's record of the last window: sensor and drive of the pattern's largest target, reference. */
void an_six_record(const an_six *app, float *record);

#endif
