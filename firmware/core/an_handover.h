/* Handover between the main loop and the interrupts: which of two jobs is active, and which faults have occurred.
 *
 * The main loop prepares the inactive job and posts it; the slow step takes it over at its next window.
 */
#ifndef AN_HANDOVER_H
#define AN_HANDOVER_H

#include "an_types.h"

typedef enum { AN_JOB_REST, AN_JOB_DWELL, AN_JOB_TRACK } an_job_kind;

typedef struct {
    uint32_t active; /* active job, as all bits 0 or all bits 1; written by the slow step */
    uint32_t posted; /* job to become active, coded likewise; written by the main loop */
    uint32_t trips;  /* faults latched by the slow step */
} an_handover;

/* True if the last posted job has been taken over, so that the other one may be prepared. */
bool an_handover_vacant(const an_handover *hand);

/* Hand the prepared job to the slow step. */
void an_handover_post(an_handover *hand);

/* True unless one of the two job words is corrupted. */
bool an_handover_is_sound(const an_handover *hand);

/* Add faults, from the main loop, to a word that interrupts also modify. The fast tick sets its output to rest from the
 * next sample onwards. */
void an_handover_trip(uint32_t *faults, uint32_t found);

#endif
