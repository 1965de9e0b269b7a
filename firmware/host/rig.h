/* A test rig: the single-mode application and a plate in double precision, in lock step, a second in some ten milliseconds.
 *
 * The plate's coefficients are computed in Python (firmware/closed_loop.py); they may change between two runs.
 */
#ifndef RIG_H
#define RIG_H

#include "an_single.h"
#include "an_types.h"

enum { RIG_MODES = 8, RIG_LINE = 64, RIG_SOON = 25 };

typedef enum { RIG_SOUND, RIG_DEAD, RIG_STUCK, RIG_REVERSED, RIG_CLIPPED } rig_sensor;

typedef struct {
    uint32_t count;
    double decay[RIG_MODES][2]; /* of each mode's state over a sample; real and imaginary part */
    double fresh[RIG_MODES][2]; /* response to what is driven now ... */
    double stale[RIG_MODES][2]; /* ... and to what was driven a sample earlier, the dead time's fraction between them */
    double residue[RIG_MODES][2];
    double state[RIG_MODES][2];
    double line[RIG_LINE]; /* the drives on their way through the dead time */
    uint32_t whole;        /* samples of dead time */
    double feedthrough;
    double offset;
    double noise;
    double sensitivity; /* of the sensor, 1: as described */
    rig_sensor sensor;
    uint64_t random;
} rig_plate;

/* What a window ended with. */
typedef struct {
    double measured[2];
    double drive[2]; /* in the mode's frame */
    double reference;
    double motion; /* the first mode's true amplitude, as the sound sensor would show it */
    uint32_t state;
    uint32_t limited;
} rig_window;

typedef struct {
    an_single app;
    rig_plate plate;
    uint32_t code;
    uint32_t looked; /* ticks since the board's guard looked last */
    double last_sensed;
} rig_single;

/* One sample period; true when a window ended. */
bool rig_tick(rig_single *rig);

/* So many; returns how many windows it wrote, at most room (0: none are written). */
uint32_t rig_run(rig_single *rig, uint32_t ticks, rig_window *windows, uint32_t room);

/* What goes wrong: a sensor, a fault that an interrupt finds, a bit of the application's state. */
typedef enum { RIG_SENSOR, RIG_TRIP, RIG_FLIP } rig_injection;

/* The largest of a run. */
typedef struct {
    double drive;  /* amplitude, 1: the table's limit */
    double motion; /* the first mode's true amplitude, as the sound sensor would show it */
} rig_extent;

/* How it ended, over all moments. */
typedef struct {
    uint32_t latched; /* in the fault state, the output at rest for good */
    uint32_t held;    /* the plate is held as before, and rests when asked to */
    uint32_t unsafe;  /* neither */
    uint32_t soon;    /* of those that latched, within RIG_SOON ticks */
    uint32_t longest; /* ticks until the last unsafe one, of those that latched */
    rig_extent broken; /* of all moments, from what goes wrong until it has rested for as long as is looked */
    rig_extent sound;  /* of the same run, nothing being wrong */
} rig_outcome;

typedef struct {
    rig_injection kind;
    const uint32_t *details; /* a rig_sensor; fault bits; bits of rig->app: one of them at each moment, by the moment's hash */
    uint32_t count;
    uint32_t ticks;   /* length of the run */
    uint32_t stride;  /* each so-many-th tick is a moment */
    uint32_t most;    /* ticks that may pass until it is safe */
    uint32_t latched; /* ticks more that it has to stay safe */
    double further;   /* the plate may move so many times as far as it does at most while nothing is wrong */
} rig_trial;

/* Runs, and at each moment lets go wrong on a copy what the trial says. */
rig_outcome rig_inject(rig_single *rig, const rig_trial *trial);

#endif
