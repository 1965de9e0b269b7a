/* Test rig: the single-mode application and a simulated plate in double precision, in lock step.
 *
 * A second of simulated time takes some ten milliseconds. The coefficients of the plate are computed in Python
 * (firmware/closed_loop.py) and may change between two runs.
 */
#ifndef RIG_H
#define RIG_H

#include "an_capture.h"
#include "an_single.h"
#include "an_types.h"

enum { RIG_MODES = 8, RIG_LINE = 64, RIG_SOON = 25 };

typedef enum { RIG_SOUND, RIG_DEAD, RIG_STUCK, RIG_REVERSED, RIG_CLIPPED } rig_sensor;

typedef struct {
    uint32_t count;
    double decay[RIG_MODES][2]; /* factor of each mode's state per sample; real and imaginary part */
    double fresh[RIG_MODES][2]; /* response to the newer drive within a sample ... */
    double stale[RIG_MODES][2]; /* ... and to the older one, split by the fractional part of the dead time */
    double residue[RIG_MODES][2];
    double state[RIG_MODES][2];
    double line[RIG_LINE]; /* delay line for the drives */
    uint32_t whole;        /* dead time in whole samples */
    double feedthrough;
    double offset;
    double noise;
    double sensitivity; /* of the sensor, 1: nominal */
    double swing;       /* level at which the amplifier clips, 0: never */
    double softening;   /* of the first mode: decrease of its phase per sample, rad, times its amplitude */
    rig_sensor sensor;
    uint64_t random;
} rig_plate;

/* Values at the end of a window. */
typedef struct {
    double measured[2];
    double drive[2]; /* in the mode's frame */
    double reference;
    double motion; /* true amplitude of the first mode, as an intact sensor would show it */
    uint32_t state;
    uint32_t limited;
} rig_window;

typedef struct {
    an_single app;
    rig_plate plate;
    an_capture capture;
    uint32_t code;
    uint32_t looked; /* ticks since the last check by the guard */
    double last_sensed;
} rig_single;

/* Advance by one sample; true if a window ended. */
bool rig_tick(rig_single *rig);

/* Advance by a number of samples. Returns the number of windows written, at most room. */
uint32_t rig_run(rig_single *rig, uint32_t ticks, rig_window *windows, uint32_t room);

/* Kind of injected fault: a failed sensor, a fault found by an interrupt, a flipped bit of the application's state. */
typedef enum { RIG_SENSOR, RIG_TRIP, RIG_FLIP } rig_injection;

/* Maxima of a run. */
typedef struct {
    double drive;  /* amplitude, 1: the table's limit */
    double motion; /* true amplitude of the first mode, as an intact sensor would show it */
} rig_extent;

/* Outcomes over all injections. */
typedef struct {
    uint32_t latched; /* ended in the fault state with the output permanently at rest */
    uint32_t held;    /* amplitude held as before, and a stop is obeyed */
    uint32_t unsafe;  /* neither */
    uint32_t soon;    /* of the latched ones, at rest within RIG_SOON ticks */
    uint32_t longest; /* of the latched ones, most ticks until the output was at rest */
    rig_extent broken; /* maxima from an injection to the end of its observation */
    rig_extent sound;  /* maxima of the same run without a fault */
} rig_outcome;

typedef struct {
    rig_injection kind;
    const uint32_t *details; /* rig_sensor, fault bits or bits of rig->app; a hash of the tick selects one */
    uint32_t count;
    uint32_t ticks;   /* length of the run */
    uint32_t stride;  /* ticks between two injections */
    uint32_t most;    /* most ticks until the output must be at rest */
    uint32_t latched; /* ticks for which it must then stay at rest */
    double further;   /* largest motion, relative to the maximum without a fault */
} rig_trial;

/* Run the rig and inject the trial's fault into a copy of it every stride ticks. */
rig_outcome rig_inject(rig_single *rig, const rig_trial *trial);

#endif
