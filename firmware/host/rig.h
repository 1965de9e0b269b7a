/* A test rig: the single-mode application and a plate in double precision, in lock step, a second in some ten milliseconds.
 *
 * The plate's coefficients are computed in Python (firmware/host/rig.py); they may change between two runs.
 */
#ifndef RIG_H
#define RIG_H

#include "an_single.h"
#include "an_types.h"

enum { RIG_MODES = 8, RIG_LINE = 64 };

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

/* Ticks until the output is at rest and the application in its fault state, at most `most`; most + 1 when it never is. */
uint32_t rig_ticks_to_safety(rig_single *rig, uint32_t most);

/* What goes wrong: a sensor, or a fault that an interrupt finds. */
typedef enum { RIG_SENSOR, RIG_TRIP } rig_injection;

/* Runs so many ticks, and at each stride-th of them lets go wrong on a copy what `detail` says (a rig_sensor, fault bits).
 * Returns the longest time to safety, in ticks; most + 1 when one was not safe by then, or left safety within `latched`
 * ticks more. */
uint32_t rig_inject(rig_single *rig, rig_injection kind, uint32_t detail, uint32_t ticks, uint32_t stride, uint32_t most,
                    uint32_t latched);

#endif
