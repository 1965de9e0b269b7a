#include "an_retry.h"

#define AN_RETRY_WAIT_S 1.0f  /* before the first retry; twice as long before each further one up to the fourth */
#define AN_RETRY_GOOD_S 2.0f  /* after as long a run the count of retries starts again */
#define AN_RETRY_SWEEP_S 20.0f /* a sweep that took longer is not repeated */

static const uint32_t retried = AN_FAULT_MISMATCH | AN_FAULT_IDENTIFY;

void an_retry_cancel(an_retry *retry)
{
    retry->waits = false;
    retry->due = false;
    retry->drove = false;
}

static void note_drive(an_retry *retry, const an_supervisor *supervisor, float lasted_s)
{
    retry->drove = true;
    retry->host_drives = supervisor->host_drives;
    retry->measure_only = supervisor->measure_only;
    if (supervisor->state == AN_STATE_RUN && lasted_s > AN_RETRY_GOOD_S) {
        retry->used = 0u;
    }
}

static bool may_retry(const an_retry *retry, const an_supervisor *supervisor, float lasted_s)
{
    const bool quick = (supervisor->faults & AN_FAULT_IDENTIFY) == 0u || lasted_s < AN_RETRY_SWEEP_S;
    return retry->drove && quick && (!retry->measure_only || retry->used < (uint32_t)AN_RETRY_MOST);
}

static an_retry_order wait(an_retry *retry, const an_supervisor *supervisor, uint32_t window, float window_s)
{
    retry->waits = retry->waits && (supervisor->faults & ~retried) == 0u &&
                   !an_supervisor_host_is_silent(supervisor, window, window_s);
    const float wait_s = AN_RETRY_WAIT_S * (float)(1u << retry->used);
    if (!retry->waits || (float)(window - retry->since) * window_s < wait_s) {
        return AN_RETRY_NOTHING;
    }
    retry->used += retry->used < (uint32_t)AN_RETRY_MOST ? 1u : 0u;
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
        retry->waits = changed ? may_retry(retry, supervisor, lasted_s) : retry->waits;
        return wait(retry, supervisor, window, window_s);
    }
    const bool due = retry->due;
    retry->used = due ? retry->used : 0u;
    an_retry_cancel(retry);
    return due ? AN_RETRY_START : AN_RETRY_NOTHING;
}
