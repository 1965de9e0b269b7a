#include "an_track.h"

#include "an_assert.h"
#include "an_clear.h"
#include "an_complex.h"

#define AN_TWO_PI 6.2831853f
#define AN_SPAN 0.01f         /* of the frequency: ten times what 10 K do, three times what a finger does */
#define AN_SHARE 0.3f         /* of a block in what is followed: 10 ms */
#define AN_DAMPED_MAX 24.0f  /* times the identified damping: a finger makes 2 to 12 of it */
#define AN_DAMPED_MIN 0.06f
#define AN_DRIVE_MIN 0.25f  /* of the limit: a drive that ought to do something */
#define AN_MOTION_MIN 0.004f /* of full scale: eight codes */
#define AN_HIDDEN_MIN 0.0015f /* of full scale: three codes, of a whole window */
#define AN_HIDDEN2 0.25f      /* squared: half of what the most damped plate would show */
#define AN_PUSHED_MAX (-1.0f) /* times the identified damping: no neighbour that rings gives so much back */
#define AN_UNPAID_MAX 1.3f   /* times |U|^2: braking makes 1 of it where the sensor shows half, a reversed sensor 1.85 */
#define AN_LATELY 0.94f       /* of what was a window ago: half within 2.2 ms */
#define AN_ODD_SHARE 0.08f    /* of the energy that no damping and no detuning explains */
#define AN_ODD_MIN 3e-4f    /* of the motion's square: what a sensor's noise in proportion to its signal may do */
#define AN_ODD_TAU 3.0f       /* time constants that neighbours may ring out, beside ODD_MAX */
#define AN_NOISE_MARGIN 12.0f

enum { HIDDEN_MAX = 6, IDLE_MAX = 2, UNDRIVEN_MAX = 3, ODD_MAX = 32, UNSTEADY = 2 };

void an_track_forget(an_track *track)
{
    track->shift = 0.0f;
}

void an_track_begin(an_track *track, const an_mode *mode, const an_pi_wish *wish, float detuning_hz, float noise2)
{
    track->period_s = wish->period_s;
    track->rate = 1.0f / mode->tau_s;
    track->rate_now = track->rate;
    track->push = an_abs(mode->gain) * track->rate * wish->period_s;
    track->share = 1.0f - wish->ahead_s / wish->period_s;
    track->drive_limit = mode->drive_limit;
    track->detuning = AN_TWO_PI * detuning_hz;
    track->span = AN_TWO_PI * AN_SPAN * mode->frequency_hz;
    track->noise2 = noise2;
    track->read = 0u;
    track->idle = 0u;
    track->undriven = 0u;
    track->odd = 0u;
    track->odd_most = ODD_MAX + (uint32_t)(AN_ODD_TAU * mode->tau_s / (wish->period_s * (float)AN_TRACK_WINDOWS));
    track->unsteady = UNSTEADY;
    track->limited = 0u;
    track->least = an_cplx(0.0f, 0.0f);
    track->hidden = 0u;
    track->unpaid = 0.0f;
    track->shown = 0.0f;
    track->hidden_most = HIDDEN_MAX + (uint32_t)(1.0f / (AN_DAMPED_MAX * track->rate * wish->period_s));
    an_clear(&track->block, sizeof track->block);
}

static float larger(float a, float b)
{
    return a > b ? a : b;
}

static float within(float value, float low, float high)
{
    return value < low ? low : value > high ? high : value;
}

/* Counts up when something is so, down when it is not: what comes and goes is found as well as what stays. */
static bool exceeds(uint32_t *counter, bool is_so, uint32_t most)
{
    if (is_so) {
        (*counter)++;
    } else if (*counter > 0u) {
        (*counter)--;
    }
    return *counter >= most;
}

/* The strongest damping and detuning that are taken for a plate's, times a window. */
static float most_of(const an_track *track)
{
    const float detuning = track->detuning < 0.0f ? -track->detuning : track->detuning;
    return track->period_s * (AN_DAMPED_MAX * track->rate + 2.0f * detuning);
}

/* What a drive that ought to do something adds in a window. */
static float ought_of(const an_track *track)
{
    return AN_DRIVE_MIN * track->push * track->drive_limit;
}

static bool drive_does_nothing(const an_track *track, const an_balance *block)
{
    const float ought = ought_of(track);
    const float most = 0.5f * most_of(track);
    return block->given > ought * ought * (float)block->count && block->supply > most * most * block->motion;
}

static bool moves(const an_track *track, const an_balance *block)
{
    const float least2 = larger(AN_MOTION_MIN * AN_MOTION_MIN, AN_NOISE_MARGIN * track->noise2);
    return block->motion > 4.0f * least2 * (float)block->count;
}

static bool model_explains_too_little(const an_track *track, const an_balance *block)
{
    const float explained = an_abs2(block->product) / block->motion;
    const float left = block->supply - explained;
    return left > AN_ODD_SHARE * block->supply && left > 0.25f * AN_ODD_MIN * block->motion &&
           left > AN_NOISE_MARGIN * track->noise2 * (float)block->count;
}

static void follow(an_track *track, an_complex a)
{
    const float shift = track->shift - AN_SHARE * (a.im - track->detuning);
    const float rate = track->rate_now + AN_SHARE * (a.re - track->rate_now);
    track->shift = within(shift, -track->span, track->span);
    track->rate_now = within(rate, 0.25f * track->rate, AN_DAMPED_MAX * track->rate);
}

void an_track_disturb(an_track *track)
{
    track->unsteady = UNSTEADY;
}

static bool judge(an_track *track)
{
    AN_ASSERT(track->block.count == (uint32_t)AN_TRACK_WINDOWS);
    const an_balance *block = &track->block;
    const bool steady = track->unsteady == 0u;
    const bool moving = moves(track, block);
    an_complex a = an_cplx(track->rate_now, track->detuning);
    if (moving) {
        a = an_scale(block->product, 2.0f / (track->period_s * block->motion));
        follow(track, a);
    }
    track->limited = 2u * block->limited > block->count ? 1u : 0u;
    const bool idle = exceeds(&track->idle, drive_does_nothing(track, block), IDLE_MAX);
    const float least = (steady ? AN_DAMPED_MIN : AN_PUSHED_MAX) * track->rate;
    const bool undriven = exceeds(&track->undriven, moving && a.re < least, UNDRIVEN_MAX);
    const bool odd = steady && exceeds(&track->odd, moving && model_explains_too_little(track, block), track->odd_most);
    track->unsteady -= steady ? 0u : 1u;
    return idle || undriven || odd;
}

/* Counting starts anew whenever the sensor shows enough: a plate that is braked is driven hard, and ends at rest. */
static void look_for_motion(an_track *track, an_complex given, an_complex measured)
{
    const float least2 = larger(AN_HIDDEN_MIN * AN_HIDDEN_MIN, AN_NOISE_MARGIN * track->noise2);
    track->least = an_scale(an_add(track->least, given), 1.0f / (1.0f + most_of(track)));
    const float shown2 = AN_HIDDEN2 * an_abs2(track->least);
    if (an_abs2(measured) >= larger(shown2, least2)) {
        track->least = an_cplx(0.0f, 0.0f);
    }
    track->hidden = an_abs2(measured) < shown2 && shown2 > least2 ? track->hidden + 1u : 0u;
}

/* Work that no drive did, as that of neighbours that give back. Work and motion are forgotten alike, so that noise which the
 * loop feeds back does not add up. */
static void look_for_work(an_track *track, an_complex twice, float spent, an_complex measured)
{
    const float given_back = -0.5f * AN_PUSHED_MAX * track->period_s * track->rate * an_abs2(twice);
    track->unpaid = larger(AN_LATELY * track->unpaid - spent - given_back, 0.0f);
    track->shown = larger(AN_LATELY * track->shown, an_abs2(measured));
}

static bool moves_unpaid(const an_track *track)
{
    const float least2 = 4.0f * larger(AN_MOTION_MIN * AN_MOTION_MIN, AN_NOISE_MARGIN * track->noise2);
    return track->unpaid > AN_UNPAID_MAX * larger(track->shown, least2);
}

/* From the middle of a window to that of the next: the old drive until the gap has passed, the new one after that. */
static void add(an_track *track, const an_track_note *before, const an_track_note *now)
{
    an_balance *block = &track->block;
    const an_complex drive = an_add(an_scale(now->drive, track->share), an_scale(before->drive, 1.0f - track->share));
    const an_complex given = an_scale(drive, track->push);
    look_for_motion(track, given, now->measured);
    const an_complex y = an_sub(given, an_sub(now->measured, before->measured));
    const an_complex twice = an_add(now->measured, before->measured);
    block->given += an_abs2(given);
    block->supply += an_abs2(y);
    block->motion += an_abs2(twice);
    const an_complex product = an_mul(y, an_conj(twice));
    look_for_work(track, twice, product.re, now->measured);
    block->product = an_add(block->product, product);
    block->limited += now->limited == AN_PI_LIMITED ? 1u : 0u;
    block->count++;
}

an_track_result an_track_read(an_track *track, const an_track_note *notes, uint32_t written)
{
    if (written - track->read >= AN_TRACK_ROOM || track->read == 0u) {
        track->read = written;
        an_clear(&track->block, sizeof track->block);
        return AN_TRACK_WAITS;
    }
    while (track->read != written && track->block.count < AN_TRACK_WINDOWS) {
        const uint32_t at = track->read % AN_TRACK_ROOM;
        add(track, &notes[(at + AN_TRACK_ROOM - 1u) % AN_TRACK_ROOM], &notes[at]);
        track->read++;
    }
    if (track->hidden >= track->hidden_most || moves_unpaid(track)) {
        return AN_TRACK_LOST;
    }
    if (track->block.count < AN_TRACK_WINDOWS) {
        return AN_TRACK_WAITS;
    }
    const bool lost = judge(track);
    an_clear(&track->block, sizeof track->block);
    return lost ? AN_TRACK_LOST : AN_TRACK_FOLLOWS;
}

float an_track_shift_hz(const an_track *track)
{
    return track->shift / AN_TWO_PI;
}

void an_track_mode(const an_track *track, const an_mode *identified, an_mode *now)
{
    const float share = track->rate / track->rate_now;
    *now = *identified;
    now->frequency_hz = identified->frequency_hz + track->shift / AN_TWO_PI;
    now->tau_s = identified->tau_s * share;
    now->gain = an_scale(identified->gain, share);
}
