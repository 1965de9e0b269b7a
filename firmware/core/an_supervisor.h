/* State machine common to both builds: when a start is allowed, what a fault does, and when it may be cleared.
 *
 * States: IDLE (outputs at rest), IDENTIFY (measurement of the plate), RUN (closed loop), FAULT (latched, outputs at
 * rest). The supervisor only decides; the build acts.
 */
#ifndef AN_SUPERVISOR_H
#define AN_SUPERVISOR_H

#include "an_wire.h"
#include "an_handover.h"
#include "an_types.h"

typedef enum {
    AN_ACT_NONE,
    AN_ACT_REST,    /* set the outputs to rest */
    AN_ACT_IDENTIFY /* continue the measurement */
} an_action;

typedef struct {
    an_state state;
    uint32_t inverse; /* complement of the state, to detect corruption */
    uint32_t faults;  /* latched, AN_FAULT_... */
    uint32_t first;   /* the faults that were found first */
    uint32_t cleared; /* number of clears so far */
    uint32_t heard;   /* window of the last message from the host */
    bool stopping;
    bool host_drives; /* started by a host, which must stay in contact */
    bool measure_only; /* identify, then rest */
} an_supervisor;

/* Start at rest, or in the fault state if any faults were found before. */
void an_supervisor_boot(an_supervisor *supervisor, uint32_t faults);

/* Enter a state. */
void an_supervisor_enter(an_supervisor *supervisor, an_state state);

/* True unless the state word is corrupted. */
bool an_supervisor_is_sound(const an_supervisor *supervisor);

/* True in the states that drive the outputs. */
bool an_supervisor_drives(const an_supervisor *supervisor);

/* Leave IDLE for a state that drives the outputs; an_supervisor_bind_host follows if a host requested it. */
void an_supervisor_begin(an_supervisor *supervisor, an_state state);

/* Require the host to stay in contact from now on. */
void an_supervisor_bind_host(an_supervisor *supervisor, uint32_t window);

/* True if a host started the job and has been silent for too long. */
bool an_supervisor_host_is_silent(const an_supervisor *supervisor, uint32_t window, float window_s);

/* Request a return to rest. */
void an_supervisor_stop(an_supervisor *supervisor);

/* Latch faults. */
void an_supervisor_fail(an_supervisor *supervisor, uint32_t faults);

/* True if the fault state may be left: no latched fault requires another table or another board. */
bool an_supervisor_may_clear(const an_supervisor *supervisor);
void an_supervisor_clear(an_supervisor *supervisor);

/* Decide the next action, once per main-loop pass, unless a job waits for the slow step (which acts on faults by
 * itself, and acts first). kind: of the active job; found: faults from the interrupts; window: number of the current
 * window; window_s: duration of a window. */
an_action an_supervisor_decide(an_supervisor *supervisor, an_job_kind kind, uint32_t found, uint32_t window, float window_s);

#endif
