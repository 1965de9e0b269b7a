/* Retries after a hand. A plate under a heavy hand moves as little as one whose sensor is lost, and a hand during the
 * sweep hides the resonance. The faults AN_FAULT_MISMATCH and AN_FAULT_IDENTIFY are therefore cleared, and the last job
 * is started again from rest, after 1, 2 and 4 s. If the plate then runs for AN_RETRY_GOOD_S, the waits start again. The
 * fault of the last of AN_RETRY_MOST retries is cleared as well: the board gives the job up and rests, ready for another
 * start, which begins with a check of the plate. In the meantime the outputs are at rest.
 */
#ifndef AN_RETRY_H
#define AN_RETRY_H

#include "an_supervisor.h"
#include "an_types.h"

enum { AN_RETRY_MOST = 3 };

typedef enum { AN_RETRY_NOTHING, AN_RETRY_CLEAR, AN_RETRY_START, AN_RETRY_GIVE_UP } an_retry_order;

typedef struct {
    an_state state;    /* at the last decision */
    uint32_t since;    /* window in which this state began */
    uint32_t used;     /* retries so far, at most AN_RETRY_MOST */
    bool drove;        /* the outputs were driven just before */
    bool waits;        /* in the fault state: a retry will follow */
    bool due;          /* cleared, to be started */
    uint32_t gave_up;  /* faults for which the last job was given up, until the next one or a stop */
    bool host_drives;  /* of the job to start again ... */
    bool measure_only; /* ... as in an_supervisor */
} an_retry;

/* Decide once per main-loop pass, while no job waits for the slow step; arguments as for an_supervisor_decide. */
an_retry_order an_retry_decide(an_retry *retry, const an_supervisor *supervisor, uint32_t window, float window_s);

/* Forget any retry, and what was given up, after a stop. */
void an_retry_cancel(an_retry *retry);

#endif
