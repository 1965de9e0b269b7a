/* What main loop and slow step pass to each other: which of two jobs is at work, and what went wrong.
 *
 * The main loop prepares the job that is not at work and posts it; the slow step takes it over at its next window.
 */
#ifndef AN_HANDOVER_H
#define AN_HANDOVER_H

#include "an_types.h"

typedef enum { AN_JOB_REST, AN_JOB_DWELL, AN_JOB_TRACK } an_job_kind;

typedef struct {
    uint32_t active;  /* job at work: written by the slow step */
    uint32_t posted;  /* job to be at work: written by the main loop */
    uint32_t trips;   /* faults that the slow step latched */
    uint32_t outside; /* faults found elsewhere: written by the main loop alone */
} an_handover;

/* True while the job that was posted last has been taken over: the other one may be prepared. */
bool an_handover_vacant(const an_handover *hand);

/* Hands the prepared job to the slow step. */
void an_handover_post(an_handover *hand);

#endif
