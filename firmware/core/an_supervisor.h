/* The state machine that both builds share: who may start, what a fault does, when it may be cleared.
 *
 * States: IDLE (outputs at rest), IDENTIFY (the plate is measured), RUN (closed loop), FAULT (latched, outputs at rest).
 * It only decides; the build it belongs to acts.
 */
#ifndef AN_SUPERVISOR_H
#define AN_SUPERVISOR_H

#include "an_faults.h"
#include "an_handover.h"
#include "an_types.h"

typedef enum { AN_STATE_IDLE, AN_STATE_IDENTIFY, AN_STATE_RUN, AN_STATE_FAULT } an_state;

typedef enum {
    AN_ACT_NONE,
    AN_ACT_REST,    /* outputs to rest */
    AN_ACT_IDENTIFY /* go on with the measurement */
} an_action;

typedef struct {
    an_state state;
    uint32_t inverse; /* of the state: a damaged word is noticed */
    uint32_t faults;  /* latched, AN_FAULT_... */
    uint32_t first;   /* those of them that were found first */
    uint32_t cleared; /* times that a fault was cleared */
    uint32_t heard;   /* the window in which the host spoke last */
    bool stopping;
    bool host_drives; /* started by a host, which must keep talking */
    bool measure_only; /* identify, then rest */
} an_supervisor;

/* At rest, or in the faults that were found before. */
void an_supervisor_boot(an_supervisor *supervisor, uint32_t faults);

/* Another state. */
void an_supervisor_enter(an_supervisor *supervisor, an_state state);

/* True while the state is what was entered last. */
bool an_supervisor_is_sound(const an_supervisor *supervisor);

/* True while a job drives the outputs. */
bool an_supervisor_drives(const an_supervisor *supervisor);

/* From IDLE into a state that drives, by whoever is at the board. */
void an_supervisor_begin(an_supervisor *supervisor, an_state state);

/* From now on the host must keep talking. */
void an_supervisor_bind_host(an_supervisor *supervisor, uint32_t window);

/* Asks for rest. */
void an_supervisor_stop(an_supervisor *supervisor);

/* Latches faults. */
void an_supervisor_fail(an_supervisor *supervisor, uint32_t faults);

/* True when the fault state may be left: nothing is wrong that only another table or another board could mend. */
bool an_supervisor_may_clear(const an_supervisor *supervisor);
void an_supervisor_clear(an_supervisor *supervisor);

/* What to do now: once a pass of the main loop, when no job is on its way to the slow step, which acts on faults by itself
 * and does so first. kind: of the job at work; found: faults of the interrupts; window: the present one; windows of this
 * length. */
an_action an_supervisor_decide(an_supervisor *supervisor, an_job_kind kind, uint32_t found, uint32_t window, float window_s);

#endif
