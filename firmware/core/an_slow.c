#include "an_slow.h"

#include <stdatomic.h>

#include "an_clear.h"
#include "an_complex.h"
#include "an_faults.h"

#define AN_OFFSET_MAX 0.25f    /* of full scale */
#define AN_MISMATCH_FLOOR2 0.01f /* squared: a tenth of the amplitude limit */
#define AN_MISMATCH_SHARE2 0.25f /* squared: half of what the model says, for a finger may take the rest */

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
    const volatile uint32_t *active = &slow->active;
    if (*active != slow->posted) {
        return NULL;
    }
    return &slow->jobs[slow->posted ^ 1u];
}

void an_slow_post(an_slow *slow)
{
    atomic_signal_fence(memory_order_release);
    slow->posted ^= 1u;
}

static void take_job(an_slow *slow, an_fast *fast)
{
    slow->active = slow->posted;
    const an_job *job = &slow->jobs[slow->active];
    if (job->clear != 0u) {
        slow->trips = 0u;
        fast->faults = 0u;
    }
    slow->waited = 0u;
    slow->finished = 0u;
    slow->mismatched = 0u;
    slow->total = an_cplx(0.0f, 0.0f);
    if (job->kind == AN_JOB_TRACK) {
        an_pi_init(&slow->pi, &job->gains, slow->measured.tone);
    }
}

/* Written so that a NaN trips too. */
static uint32_t check_measurement(const an_window *window, const an_phasor *phasor, float amplitude_limit2)
{
    uint32_t trips = 0u;
    if (!(an_abs2(phasor->tone) <= amplitude_limit2)) {
        trips |= AN_FAULT_AMPLITUDE;
    }
    if (!(__builtin_fabsf(phasor->offset) <= AN_OFFSET_MAX)) {
        trips |= AN_FAULT_SENSOR_OFFSET;
    }
    if (window->clipped > AN_CLIPPED_MAX) {
        trips |= AN_FAULT_SENSOR_CLIPPED;
    }
    return trips;
}

static void check_model(an_slow *slow, const an_job *job, an_complex measured)
{
    const float allowed2 = AN_MISMATCH_FLOOR2 * job->amplitude_limit2 + AN_MISMATCH_SHARE2 * an_abs2(slow->pi.model);
    if (an_abs2(an_sub(measured, slow->pi.model)) <= allowed2) {
        slow->mismatched = 0u;
    } else if (++slow->mismatched > job->patience) {
        slow->trips |= AN_FAULT_MISMATCH;
    }
}

static an_complex dwell(an_slow *slow, const an_job *job, an_complex measured)
{
    if (slow->finished == 0u) {
        slow->waited++;
        if (slow->waited > job->settle) {
            slow->total = an_add(slow->total, measured);
        }
        slow->finished = slow->waited >= job->settle + job->average;
    }
    return job->drive;
}

static an_complex track(an_slow *slow, const an_job *job, an_complex measured)
{
    check_model(slow, job, measured);
    const an_complex drive = an_pi_step(&slow->pi, &job->gains, measured, slow->reference * slow->envelope);
    return an_mul(drive, job->gains.lead);
}

static an_complex do_job(an_slow *slow, const an_job *job, an_complex measured)
{
    switch (job->kind) {
    case AN_JOB_TRACK:
        return track(slow, job, measured);
    case AN_JOB_DWELL:
        return dwell(slow, job, measured);
    default:
        return an_cplx(0.0f, 0.0f);
    }
}

void an_slow_step(an_slow *slow, an_fast *fast)
{
    const an_window *window = &fast->window;
    const an_phasor phasor = an_demod_fit(&slow->jobs[slow->active].demod, &window->sums, window->last_phase);
    slow->measured = phasor;
    if (slow->active != slow->posted) {
        take_job(slow, fast);
    }
    const an_job *job = &slow->jobs[slow->active];
    slow->trips |= slow->outside | fast->faults | check_measurement(window, &phasor, job->amplitude_limit2);
    fast->command.drive = slow->trips == 0u ? do_job(slow, job, phasor.tone) : an_cplx(0.0f, 0.0f);
    fast->command.step = job->step;
    atomic_signal_fence(memory_order_release);
    fast->command.count = window->count;
}
