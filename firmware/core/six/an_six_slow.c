#include "an_six_slow.h"

#include <stdatomic.h>

#include "an_assert.h"
#include "an_bytes.h"
#include "an_check.h"
#include "an_complex.h"
#include "an_wire.h"

#define AN_AMPLITUDE_MAX2 0.81f   /* squared: 0.9 of a sensor's full scale */
#define AN_OFFSET_SHARE 0.0625f   /* weight of a window in the smoothed offset */
#define AN_MISMATCH_FLOOR2 1e-4f  /* squared: a hundredth of full scale, for noise */
#define AN_MISMATCH_SHARE2 0.25f  /* squared: half of the target, for a finger or an error of the matrix */
#define AN_INTEGRAL_LARGEST2 0.1f /* squared, of the largest target: for an integral that corrects a wrong matrix */
#define AN_FOLLOWED_LARGEST2 1.0f /* likewise, while the sensor follows its target within half of it */
#define AN_LIMITED_LARGEST2 0.02f /* likewise, for an error that no integral corrects */
#define AN_FADE 0.5f              /* of the rate at which a pattern fades in: rate at which it fades out */
#define AN_UNSTEADY2 0.01f        /* squared, of the target: its way that makes it unsteady */
#define AN_SHOWN 0.25f            /* of the target: less is nothing */
#define AN_SHOWN_MIN2 2.5e-7f     /* squared: smallest target to judge, ten times the smoothed noise */
#define AN_GROWTH 1.15f           /* error over smoothed error; of a reversed sensor 1.24 */
#define AN_GROWN_FLOOR2 2.5e-5f   /* squared: smallest error to judge ... */
#define AN_GROWN_LARGEST2 0.01f   /* ... plus this of the largest target */

#define AN_LIFTED 0.1f      /* of the integrals, seen again as error: a finger has begun to lift */
#define AN_LEAP 0.02f       /* of the integrals, seen within one window: it lifts at once ... */
#define AN_LEAP_FLOOR2 6e-6f /* ... unless it is noise; squared, of full scale */
#define AN_UNSHOWN (-0.03f) /* of a pattern at rest: what is below approaches it, no finger lifts */
#define AN_LEAP_AHEAD 16.0f /* what the next window would show, over that */

/* A window of two periods or more can measure any tone that a table may have. */
void an_six_slow_init(an_six_slow *slow, an_six_fast *fast, uint32_t step, uint32_t window)
{
    an_clear(slow, sizeof *slow);
    an_six_fast_init(fast, step, window);
    slow->envelope = 1.0f;
    slow->jobs[0].step = step;
    slow->jobs[0].window = window;
    slow->jobs[0].channels = AN_SIX;
    const bool measurable = an_demod_plan(&slow->jobs[0].demod, step, window, 1.0f / (float)AN_SIX_ADC_MIDDLE);
    AN_ASSERT(measurable);
    (void)measurable;
}

an_six_job *an_six_slow_vacant(an_six_slow *slow)
{
    return an_handover_vacant(&slow->hand) ? &slow->jobs[(slow->hand.posted ^ 1u) & 1u] : NULL;
}

/* From one pattern to another the loop continues; after any other job it starts from zero targets and integrals. */
static void begin_track(an_six_slow *slow, an_job_kind kind_before, float drive_limit)
{
    if (kind_before == AN_JOB_TRACK) {
        return;
    }
    slow->limit = drive_limit;
    for (uint32_t i = 0u; i < AN_SIX; i++) {
        slow->target[i] = an_cplx(0.0f, 0.0f);
        slow->integral[i] = an_cplx(0.0f, 0.0f);
        slow->error[i] = an_cplx(0.0f, 0.0f);
    }
}

static void take_job(an_six_slow *slow, an_six_fast *fast)
{
    const an_six_job *job = &slow->jobs[slow->hand.posted & 1u];
    begin_track(slow, slow->jobs[slow->hand.active & 1u].kind, job->drive_limit);
    slow->fading = 0u;
    slow->hand.active = slow->hand.posted;
    an_clear_trips(&slow->hand, job->clear, &fast->faults);
    an_clear(&slow->dwell, sizeof slow->dwell);
    slow->mismatched = 0u;
    for (uint32_t i = 0u; i < AN_SIX; i++) {
        slow->total[i] = an_cplx(0.0f, 0.0f);
        slow->energy[i] = 0.0f;
    }
}

static void measure(an_six_slow *slow, an_six_fast *fast, const an_six_job *job)
{
    const an_six_window *window = &fast->window;
    an_sums *sums = fast->sums[window->bank];
    uint32_t trips = window->clipped > AN_SIX_CLIPPED_MAX ? (uint32_t)AN_FAULT_SENSOR_CLIPPED : 0u;
    for (uint32_t i = 0u; i < job->channels; i++) {
        const an_phasor phasor = an_demod_fit(&job->demod, &sums[i], window->last_phase);
        slow->measured[i] = phasor.tone;
        slow->offset[i] += AN_OFFSET_SHARE * (phasor.offset - slow->offset[i]);
        trips |= an_check(phasor.tone, slow->offset[i], AN_AMPLITUDE_MAX2);
    }
    an_clear(sums, sizeof fast->sums[0]);
    if (slow->ringing == 0u) {
        slow->hand.trips |= trips;
    } else {
        slow->ringing--;
    }
}

static an_complex interpolate(an_complex from, an_complex to, float share)
{
    return an_add(from, an_scale(an_sub(to, from), share));
}

static void dwell(an_six_slow *slow, const an_six_job *job)
{
    const bool counts = an_dwell_counts(&slow->dwell, job->settle, job->average);
    for (uint32_t i = 0u; i < AN_SIX; i++) {
        slow->drive[i] = interpolate(slow->drive[i], job->drive[i], job->soft);
        if (counts) {
            slow->total[i] = an_add(slow->total[i], slow->measured[i]);
            slow->energy[i] += an_abs2(slow->measured[i]);
        }
    }
}

static float largest2_of(const an_complex *values, uint32_t count)
{
    float largest = 0.0f;
    for (uint32_t i = 0u; i < count; i++) {
        const float size = an_abs2(values[i]);
        largest = size > largest ? size : largest;
    }
    return largest;
}

/* True if a sensor differs from the model. The model is the target plus the integral, because the integral of a dead
 * sensor keeps growing. While the drive is limited, no integral grows, and the model is the target alone. A finger on a
 * travelling wave needs large integrals, but leaves sensors that follow. */
static bool sensors_differ(const an_six_slow *slow, const an_six_job *job)
{
    const float largest2 = largest2_of(slow->target, job->channels);
    for (uint32_t i = 0u; i < job->channels; i++) {
        const float own2 = AN_MISMATCH_SHARE2 * an_abs2(slow->target[i]);
        const bool follows = an_abs2(an_sub(slow->measured[i], slow->target[i])) <= own2;
        const float share2 = slow->limited != 0u ? AN_LIMITED_LARGEST2 : follows ? AN_FOLLOWED_LARGEST2 : AN_INTEGRAL_LARGEST2;
        const float allowed2 = AN_MISMATCH_FLOOR2 + share2 * largest2 + own2;
        const an_complex grown = slow->limited != 0u ? an_cplx(0.0f, 0.0f) : slow->integral[i];
        const an_complex model = an_add(slow->target[i], grown);
        if (!(an_abs2(an_sub(slow->measured[i], model)) <= allowed2)) {
            return true;
        }
    }
    return false;
}

static float along(an_complex z, an_complex direction)
{
    return z.re * direction.re + z.im * direction.im;
}

/* Doubt about one sensor at a steady target, while the drive is not limited. A finger, or a knock, makes errors that
 * decay or turn; those of a reversed sensor grow in one direction. */
static uint32_t doubt_of(an_complex target, an_complex error, an_complex smoothed, float largest2)
{
    const float smoothed2 = an_abs2(smoothed);
    if (smoothed2 > AN_GROWN_FLOOR2 + AN_GROWN_LARGEST2 * largest2 && along(error, smoothed) > AN_GROWTH * smoothed2) {
        return AN_SIX_DOUBTS_MAX;
    }
    const float target2 = an_abs2(target);
    return target2 > AN_SHOWN_MIN2 && along(smoothed, target) > (1.0f - AN_SHOWN) * target2 ? 1u : 0u;
}

/* Largest doubt about any sensor; reference: of this window. */
static uint32_t largest_doubt(const an_six_slow *slow, const an_six_job *job, float reference)
{
    uint32_t largest = sensors_differ(slow, job) ? (uint32_t)AN_SIX_DOUBT : 0u;
    const float largest2 = largest2_of(slow->target, job->channels);
    for (uint32_t i = 0u; i < job->channels && slow->limited == 0u; i++) {
        const an_complex target = slow->target[i];
        const float way2 = an_abs2(an_sub(an_scale(job->target[i], reference), target));
        const an_complex error = an_sub(target, slow->measured[i]);
        const uint32_t doubt = doubt_of(target, error, slow->error[i], largest2);
        if (way2 <= AN_UNSTEADY2 * an_abs2(target) && doubt > largest) {
            largest = doubt;
        }
    }
    return largest;
}

/* Count up and down, so that an intermittent mismatch is found as well. */
static void check_model(an_six_slow *slow, const an_six_job *job, float reference)
{
    const uint32_t doubt = largest_doubt(slow, job, reference);
    if (doubt > 0u) {
        slow->mismatched += doubt;
    } else if (slow->mismatched >= (uint32_t)AN_SIX_DOUBT) {
        slow->mismatched -= (uint32_t)AN_SIX_DOUBT;
    } else {
        slow->mismatched = 0u;
    }
    if (slow->mismatched > job->patience) {
        slow->hand.trips |= AN_FAULT_MISMATCH;
    }
}

/* Scale all drives by the same factor, so that the pattern keeps its shape. */
static void limit(an_six_slow *slow, const an_six_job *job)
{
    slow->limit += job->soft * (job->drive_limit - slow->limit);
    const float size2 = largest2_of(slow->drive, job->channels);
    slow->limited = size2 > slow->limit * slow->limit;
    if (slow->limited != 0u) {
        const float factor = slow->limit / __builtin_sqrtf(size2);
        for (uint32_t i = 0u; i < job->channels; i++) {
            slow->drive[i] = an_scale(slow->drive[i], factor);
        }
    }
}

/* V = T^-1 (W + I). */
static void invert(an_six_slow *slow, const an_six_job *job)
{
    for (uint32_t i = 0u; i < AN_SIX; i++) {
        slow->drive[i] = an_cplx(0.0f, 0.0f);
    }
    for (uint32_t j = 0u; j < job->channels; j++) {
        const an_complex target = an_add(slow->target[j], slow->integral[j]);
        for (uint32_t i = 0u; i < job->channels; i++) {
            slow->drive[i] = an_add(slow->drive[i], an_mul(job->inverse[i * AN_SIX + j], target));
        }
    }
}

/* Share of the integrals to give up. They hold a steady pattern against a finger; once it has lifted, the sensors show
 * them on top of their targets. Within a window little of a sudden lift shows, and the next one comes too late. */
static float relief(an_six_slow *slow, const an_six_job *job, float reference)
{
    float shown = 0.0f;
    float held = AN_MISMATCH_FLOOR2;
    float way2 = 0.0f;
    float size2 = 0.0f;
    for (uint32_t i = 0u; i < job->channels; i++) {
        const an_complex target = slow->target[i];
        shown += along(an_sub(slow->measured[i], target), slow->integral[i]);
        held += an_abs2(slow->integral[i]);
        way2 += an_abs2(an_sub(an_scale(job->target[i], reference), target));
        size2 += an_abs2(target);
    }
    const float share = shown / held;
    const float rise = share - slow->shown;
    slow->shown = share > AN_UNSHOWN ? share : AN_UNSHOWN;
    if (way2 > AN_UNSTEADY2 * size2) {
        return 0.0f;
    }
    const bool leaps = rise > AN_LEAP && rise * rise * held > AN_LEAP_FLOOR2;
    const float given = leaps ? AN_LEAP_AHEAD * rise : share > AN_LIFTED ? share : 0.0f;
    return given < 1.0f ? given : 1.0f;
}

static void track(an_six_slow *slow, const an_six_job *job)
{
    AN_ASSERT(slow->reference >= 0.0f && slow->reference <= 1.0f);
    const float reference = slow->fading == 0u ? slow->reference * slow->envelope : 0.0f;
    check_model(slow, job, reference);
    const float relieved = relief(slow, job, reference);
    for (uint32_t i = 0u; i < job->channels; i++) {
        const an_complex error = an_sub(slow->target[i], slow->measured[i]);
        slow->error[i] = interpolate(slow->error[i], error, job->integral * (1.0f / AN_SIX_INTEGRAL));
        const an_complex goal = an_scale(job->target[i], reference);
        if (slow->limited == 0u) {
            slow->integral[i] = an_add(slow->integral[i], an_scale(error, job->integral));
        }
        slow->integral[i] = an_scale(slow->integral[i], 1.0f - relieved);
        slow->target[i] = interpolate(slow->target[i], goal, slow->fading == 0u ? job->soft : AN_FADE * job->soft);
        if (slow->fading != 0u) {
            slow->integral[i] = an_scale(slow->integral[i], 1.0f - AN_FADE * job->soft);
        }
    }
    invert(slow, job);
    limit(slow, job);
}

static void rest(an_six_slow *slow)
{
    for (uint32_t i = 0u; i < AN_SIX; i++) {
        slow->drive[i] = an_cplx(0.0f, 0.0f);
    }
}

static void do_job(an_six_slow *slow, const an_six_job *job)
{
    if (job->kind == AN_JOB_TRACK) {
        track(slow, job);
    } else if (job->kind == AN_JOB_DWELL) {
        dwell(slow, job);
    }
    if (slow->hand.trips != 0u || job->kind == AN_JOB_REST) {
        rest(slow);
    }
}

void an_six_slow_step(an_six_slow *slow, an_six_fast *fast)
{
    slow->hand.trips |= fast->faults;
    measure(slow, fast, &slow->jobs[slow->hand.active & 1u]);
    if (slow->hand.active != slow->hand.posted) {
        take_job(slow, fast);
    }
    const an_six_job *job = &slow->jobs[slow->hand.active & 1u];
    do_job(slow, job);
    const uint32_t bank = fast->command.bank ^ 1u;
    for (uint32_t i = 0u; i < AN_SIX; i++) {
        fast->drive[bank][i] = slow->drive[i];
    }
    fast->command.bank = bank;
    fast->command.step = job->step;
    fast->command.window = job->window;
    atomic_signal_fence(memory_order_release);
    fast->command.count = fast->window.count;
}
