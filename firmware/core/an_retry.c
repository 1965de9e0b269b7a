#include "an_retry.h"

#define AN_RETRY_WAIT_S 1.0f  /* before the first retry; twice as long before each further one */
#define AN_RETRY_GOOD_S 2.0f  /* after as long a run the count of retries starts again */
#define AN_RETRY_SWEEP_S 20.0f /* a sweep that took longer is not repeated */

static const uint32_t retried = AN_FAULT_MISMATCH | AN_FAULT_IDENTIFY;

void an_retry_cancel(an_retry *retry)
{
    retry->waits = false;
    retry->due = false;
    retry->drove = false;
    retry->gave_up = 0u;
}

static void note_drive(an_retry *retry, const an_supervisor *supervisor, float lasted_s)
{
    retry->drove = true;
    retry->gave_up = 0u;
    retry->host_drives = supervisor->host_drives;
    retry->measure_only = supervisor->measure_only;
    if (supervisor->state == AN_STATE_RUN && lasted_s > AN_RETRY_GOOD_S) {
        retry->used = 0u;
    }
}

/* A sweep that takes long is not worth another one. */
static void note_fault(an_retry *retry, const an_supervisor *supervisor, float lasted_s)
{
    const bool slow = (supervisor->faults & AN_FAULT_IDENTIFY) != 0u && lasted_s >= AN_RETRY_SWEEP_S;
    retry->used = slow ? (uint32_t)AN_RETRY_MOST : retry->used;
    retry->waits = retry->drove;
}

static an_retry_order wait(an_retry *retry, const an_supervisor *supervisor, uint32_t window, float window_s)
{
    retry->waits = retry->waits && (supervisor->faults & ~retried) == 0u &&
                   !an_supervisor_host_is_silent(supervisor, window, window_s);
    if (retry->waits && retry->used >= (uint32_t)AN_RETRY_MOST) {
        an_retry_cancel(retry);
        retry->gave_up = supervisor->faults;
        return AN_RETRY_GIVE_UP;
    }
    const float wait_s = AN_RETRY_WAIT_S * (float)(1u << retry->used);
    if (!retry->waits || (float)(window - retry->since) * window_s < wait_s) {
        return AN_RETRY_NOTHING;
    }
    retry->used++;
    retry->waits = false;
    retry->due = true;
    return AN_RETRY_CLEAR;
}

an_retry_order an_retry_decide(an_retry *retry, const an_supervisor *supervisor, uint32_t window, float window_s)
{
    const float lasted_s = (float)(window - retry->since) * window_s;
    const bool changed = supervisor->state != retry->state;
    if (changed) {
        retry->since = window;
        retry->state = supervisor->state;
    }
    if (an_supervisor_drives(supervisor)) {
        note_drive(retry, supervisor, changed ? 0.0f : lasted_s);
        return AN_RETRY_NOTHING;
    }
    if (supervisor->state == AN_STATE_FAULT) {
        if (changed) {
            note_fault(retry, supervisor, lasted_s);
        }
        return wait(retry, supervisor, window, window_s);
    }
    const bool due = retry->due;
    retry->used = due ? retry->used : 0u;
    const uint32_t gave_up = retry->gave_up;
    an_retry_cancel(retry);
    retry->gave_up = gave_up;
    return due ? AN_RETRY_START : AN_RETRY_NOTHING;
}
