#include "an_slow.h"

#include <stdatomic.h>

#include "an_assert.h"
#include "an_bytes.h"
#include "an_check.h"
#include "an_complex.h"
#include "an_wire.h"

#define AN_QUIET_SHARE 0.0625f /* weight of a window in the noise at rest */

bool an_slow_init(an_slow *slow, an_fast *fast, uint32_t step)
{
    an_clear(slow, sizeof *slow);
    an_fast_init(fast, step);
    slow->envelope = 1.0f;
    slow->jobs[0].step = step;
    slow->jobs[0].amplitude_limit2 = 1.0f;
    return an_demod_plan(&slow->jobs[0].demod, step, AN_WINDOW, 1.0f / (float)AN_ADC_MIDDLE);
}

an_job *an_slow_vacant(an_slow *slow)
{
    return an_handover_vacant(&slow->hand) ? &slow->jobs[(slow->hand.posted ^ 1u) & 1u] : NULL;
}

static const an_job *job_at_work(const an_slow *slow)
{
    return &slow->jobs[slow->hand.active & 1u];
}

static const an_job *take_job(an_slow *slow, an_fast *fast)
{
    slow->hand.active = slow->hand.posted;
    const an_job *job = job_at_work(slow);
    if (job->kind == AN_JOB_TRACK) {
        return job;
    }
    an_clear_trips(&slow->hand, job->clear, &fast->faults);
    slow->tracking = 0u;
    slow->dwell.waited = 0u;
    slow->dwell.finished = 0u;
    slow->total = an_cplx(0.0f, 0.0f);
    slow->energy = 0.0f;
    slow->chirp.begun = 0u;
    return job;
}

static an_complex dwell(an_slow *slow, const an_job *job, an_complex measured)
{
    if (job->chirp.steps != 0u) {
        return an_chirp_step(&slow->chirp, &job->chirp, job->drive);
    }
    if (an_dwell_counts(&slow->dwell, job->settle, job->average)) {
        slow->total = an_add(slow->total, measured);
        slow->energy += an_abs2(measured);
    }
    return job->drive;
}

static void note(an_slow *slow, an_complex measured)
{
    an_track_note *now = &slow->notes[slow->noted % AN_TRACK_ROOM];
    now->measured = measured;
    now->drive = slow->pi.drive;
    now->limited = slow->pi.limited;
    atomic_signal_fence(memory_order_release);
    slow->noted++;
}

/* The first window only initialises the loop with the motion of the plate. */
static an_complex track(an_slow *slow, const an_job *job, an_complex measured)
{
    if (slow->tracking == 0u) {
        slow->tracking = 1u;
        slow->noted = 0u;
        an_pi_init(&slow->pi, &job->gains, measured);
        return an_cplx(0.0f, 0.0f);
    }
    note(slow, measured);
    AN_ASSERT(slow->reference >= 0.0f && slow->reference <= 1.0f);
    return an_mul(an_pi_step(&slow->pi, &job->gains, measured, slow->reference * slow->envelope), job->gains.lead);
}

static an_complex rest(an_slow *slow, an_complex measured)
{
    slow->quiet += AN_QUIET_SHARE * (an_abs2(an_sub(measured, slow->measured.tone)) - slow->quiet);
    return an_cplx(0.0f, 0.0f);
}

static an_complex do_job(an_slow *slow, const an_job *job, an_complex measured)
{
    switch (job->kind) {
    case AN_JOB_TRACK:
        return track(slow, job, measured);
    case AN_JOB_DWELL:
        return dwell(slow, job, measured);
    case AN_JOB_REST:
    default:
        return rest(slow, measured);
    }
}

void an_slow_step(an_slow *slow, an_fast *fast)
{
    const an_window *window = &fast->window;
    const an_job *job = job_at_work(slow);
    const an_phasor phasor = an_demod_fit(&job->demod, &window->sums, window->last_phase);
    if (slow->hand.active != slow->hand.posted) {
        job = take_job(slow, fast);
    }
    slow->hand.trips |= fast->faults | an_check(phasor.tone, phasor.offset, job->amplitude_limit2);
    if (window->clipped > AN_CLIPPED_MAX) {
        slow->hand.trips |= AN_FAULT_SENSOR_CLIPPED;
    }
    const an_complex drive = slow->hand.trips == 0u ? do_job(slow, job, phasor.tone) : an_cplx(0.0f, 0.0f);
    fast->command.drive = an_scale(drive, (float)AN_DAC_SWING);
    slow->measured = phasor;
    fast->command.step = job->step;
    atomic_signal_fence(memory_order_release);
    fast->command.count = window->count;
}
