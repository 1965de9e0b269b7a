/* Six-channel application: measure the transfer matrix T, invert it, and hold patterns. */
#ifndef AN_SIX_H
#define AN_SIX_H

#include "an_application.h"
#include "an_shaping.h"
#include "an_six_slow.h"
#include "an_six_watch.h"
#include "an_table.h"
#include "an_types.h"

typedef struct {
    an_application base; /* base.slot is the index of the shape */
    an_six_fast fast;
    an_six_slow slow;
    an_six_watch watch; /* used by an_six_look */
    uint32_t phase;     /* of the carrier at the last sample */
    uint32_t tick;      /* at the last sample */
    an_shape_head shape;
    uint32_t pattern;
    uint32_t channels;
    uint32_t step;
    uint32_t window;
    uint32_t identified; /* nonzero: shaping holds T and its inverse */
    an_shaping shaping;  /* for drives one sample ahead */
    float reachable; /* largest reference for the pattern within the drive limit */
    float target_reference;
    bool half_reach; /* started without a reference */
    bool eased;      /* the active job is that of an eased drive */
    float probe_level; /* drive of one actuator, or in a check response of every sensor */
    bool checking;  /* all actuators drive: with known values ... */
    bool verifying; /* ... or with those measured just now */
    float motion;   /* largest response during the measurement, of full scale */
    float misfit;   /* error of the superposition that T predicts */
    uint32_t probe; /* actuator being measured */
    uint32_t probing; /* nonzero: a dwell has been posted */
    bool glancing;    /* it only looks whether the level suits the actuator */
    bool glanced;     /* the level suits: the dwell goes on */
    float coherence[AN_SIX * AN_SIX]; /* sensor by actuator, squared; 0: not measured by this board */
    float probed_s; /* total duration of the dwells of this identification */
    an_table table; /* last member: it holds the only pointer */
} an_six;

/* A window holds two periods of the carrier. The watchdog at its fastest allows 8.26 ms for a window and the processing
 * after it. */
enum { AN_SIX_FREQUENCY_MIN_HZ = 350 };

/* Read the table and start at rest with its first shape. faults were found by the board before. */
void an_six_boot(an_six *app, const uint8_t *table, uint32_t length, float sample_rate_hz, uint32_t faults);

/* Run the slow step and advance the envelope; called once per window, before the end of the gap. */
void an_six_window_end(an_six *app);

/* Hold a pattern of the current shape at reference (fraction of full scale at the sensor with the largest target; 0:
 * half of the reachable one). If T is unknown, it is measured first. Returns false unless idle and the values are in
 * range. */
bool an_six_start(an_six *app, uint32_t pattern, float reference);

/* Select another shape, and with it another frequency; only when idle. */
bool an_six_choose(an_six *app, uint32_t shape);

/* Change to another pattern of the same shape while running. */
bool an_six_change(an_six *app, uint32_t pattern);

/* Change the reference while running; it is clipped to the reachable one. */
void an_six_set_reference(an_six *app, float reference);

/* Check for faults that cannot wait for the end of a window: clipped sensors, and corrupted state of the fast tick,
 * which is repaired so that windows still end. Called from an interrupt of the fast tick's priority. */
uint32_t an_six_check(an_six *app);

/* Check the samples after each tick for signals that no plate can produce. Returns faults. */
uint32_t an_six_look(an_six *app, const uint16_t *adc);

/* Log record of the last window: sensor and drive of the channel with the largest target. */
an_record an_six_record(const an_six *app);

/* Least duration of a measurement of T, in s: a settled dwell of each actuator, and one of all of them. */
float an_six_least_s(const an_six *app);

/* Share of a sensor's error that its integral takes per window. */
float an_six_integral(const an_six *app);

/* Interface of this build to the code common to both. */
extern const an_build an_six_build;

/* Members of an_six_build defined in an_six_link.c. */
uint8_t *an_six_put_status(const an_application *app, uint8_t *at);
an_result an_six_handle_request(an_application *app, const an_message *request, an_message *reply);

#endif
