#include "an_supervisor.h"

#include "an_assert.h"

#define AN_SILENCE_S 0.5f

static const uint32_t permanent = AN_FAULT_TABLE | AN_FAULT_CLOCK;

/* A measurement starts from rest only, and the fault state can only be left for rest. */
void an_supervisor_enter(an_supervisor *supervisor, an_state state)
{
    AN_ASSERT(!an_supervisor_is_sound(supervisor) || state == AN_STATE_IDLE || state == AN_STATE_FAULT ||
              supervisor->state == AN_STATE_IDLE || (state == AN_STATE_RUN && supervisor->state != AN_STATE_FAULT));
    supervisor->state = state;
    supervisor->inverse = ~(uint32_t)state;
}

bool an_supervisor_is_sound(const an_supervisor *supervisor)
{
    return supervisor->inverse == ~(uint32_t)supervisor->state;
}

void an_supervisor_boot(an_supervisor *supervisor, uint32_t faults)
{
    an_supervisor_enter(supervisor, faults == 0u ? AN_STATE_IDLE : AN_STATE_FAULT);
    supervisor->faults = faults;
    supervisor->first = faults;
    supervisor->cleared = 0u;
    supervisor->heard = 0u;
    supervisor->stopping = false;
    supervisor->host_drives = false;
    supervisor->measure_only = false;
}

bool an_supervisor_drives(const an_supervisor *supervisor)
{
    return supervisor->state == AN_STATE_IDENTIFY || supervisor->state == AN_STATE_RUN;
}

void an_supervisor_begin(an_supervisor *supervisor, an_state state)
{
    AN_ASSERT(supervisor->state != AN_STATE_FAULT && supervisor->faults == 0u);
    an_supervisor_enter(supervisor, state);
    supervisor->host_drives = false;
    supervisor->measure_only = false;
}

void an_supervisor_bind_host(an_supervisor *supervisor, uint32_t window)
{
    supervisor->host_drives = true;
    supervisor->heard = window;
}

void an_supervisor_stop(an_supervisor *supervisor)
{
    supervisor->stopping = an_supervisor_drives(supervisor);
}

void an_supervisor_fail(an_supervisor *supervisor, uint32_t faults)
{
    AN_ASSERT(faults != 0u);
    if (supervisor->faults == 0u) {
        supervisor->first = faults;
    }
    supervisor->faults |= faults;
    an_supervisor_enter(supervisor, AN_STATE_FAULT);
    supervisor->stopping = false;
}

bool an_supervisor_may_clear(const an_supervisor *supervisor)
{
    return supervisor->state == AN_STATE_FAULT && (supervisor->faults & permanent) == 0u;
}

void an_supervisor_clear(an_supervisor *supervisor)
{
    AN_ASSERT(an_supervisor_may_clear(supervisor));
    an_supervisor_enter(supervisor, AN_STATE_IDLE);
    supervisor->faults = 0u;
    supervisor->first = 0u;
    supervisor->cleared++;
}

bool an_supervisor_host_is_silent(const an_supervisor *supervisor, uint32_t window, float window_s)
{
    return supervisor->host_drives && (float)(window - supervisor->heard) * window_s > AN_SILENCE_S;
}

/* True if the active job matches the state and the state itself is not corrupted. */
static bool is_consistent(const an_supervisor *supervisor, an_job_kind kind)
{
    const an_state state = supervisor->state;
    const bool fits = kind == AN_JOB_REST    ? state != AN_STATE_RUN
                      : kind == AN_JOB_DWELL ? state == AN_STATE_IDENTIFY
                                             : kind == AN_JOB_TRACK && state == AN_STATE_RUN;
    return fits && (supervisor->faults != 0u) == (state == AN_STATE_FAULT) && an_supervisor_is_sound(supervisor);
}

an_action an_supervisor_decide(an_supervisor *supervisor, an_job_kind kind, uint32_t found, uint32_t window, float window_s)
{
    const bool stopping = supervisor->stopping;
    supervisor->stopping = false;
    if (!is_consistent(supervisor, kind)) {
        an_supervisor_fail(supervisor, AN_FAULT_MEMORY | found);
        return AN_ACT_REST;
    }
    if (supervisor->state == AN_STATE_FAULT) {
        supervisor->faults |= found;
        return AN_ACT_NONE;
    }
    if (found != 0u) {
        an_supervisor_fail(supervisor, found);
        return AN_ACT_REST;
    }
    if (!an_supervisor_drives(supervisor)) {
        return AN_ACT_NONE;
    }
    if (an_supervisor_host_is_silent(supervisor, window, window_s)) {
        an_supervisor_fail(supervisor, AN_FAULT_HOST_SILENT);
        return AN_ACT_REST;
    }
    if (stopping) {
        an_supervisor_enter(supervisor, AN_STATE_IDLE);
        return AN_ACT_REST;
    }
    return supervisor->state == AN_STATE_IDENTIFY ? AN_ACT_IDENTIFY : AN_ACT_NONE;
}
