/* What main loop and interrupts pass to each other: which of two jobs is at work, and what went wrong.
 *
 * The main loop prepares the job that is not at work and posts it; the slow step takes it over at its next window.
 */
#ifndef AN_HANDOVER_H
#define AN_HANDOVER_H

#include "an_types.h"

typedef enum { AN_JOB_REST, AN_JOB_DWELL, AN_JOB_TRACK } an_job_kind;

typedef struct {
    uint32_t active; /* job at work, all bits of it 0 or all 1: written by the slow step */
    uint32_t posted; /* job to be at work, likewise: written by the main loop */
    uint32_t trips;  /* faults that the slow step latched */
} an_handover;

/* True while the job that was posted last has been taken over: the other one may be prepared. */
bool an_handover_vacant(const an_handover *hand);

/* Hands the prepared job to the slow step. */
void an_handover_post(an_handover *hand);

/* True while neither word was damaged. */
bool an_handover_is_sound(const an_handover *hand);

/* From the main loop: adds faults to a word that interrupts add to as well. The fast tick rests its output from its next
 * sample on. */
void an_handover_trip(uint32_t *faults, uint32_t found);

#endif
