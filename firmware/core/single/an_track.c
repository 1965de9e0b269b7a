#include "an_track.h"

#include "an_assert.h"
#include "an_bytes.h"
#include "an_complex.h"

#define AN_TWO_PI 6.2831853f
#define AN_SPAN 0.01f          /* of the frequency: ten times the shift for 10 K, three times that for a finger */
#define AN_SHARE 0.3f          /* weight of a block in the tracked values: a memory of 10 ms */
#define AN_DAMPED_MAX 24.0f    /* times the identified damping; a finger multiplies it by 2 to 12 */
#define AN_DAMPED_MIN 0.06f
#define AN_DRIVE_MIN 0.25f     /* of the limit: a drive with a clear effect */
#define AN_MOTION_MIN 0.004f   /* of full scale: eight codes */
#define AN_VISIBLE_MIN 0.0015f /* of full scale: three codes, over a whole window */
#define AN_VISIBLE_SHARE2 0.25f /* squared: half of the motion of the most heavily damped plate */
#define AN_PUSHED_MAX (-1.0f)  /* times the identified damping: no ringing neighbour returns energy faster */
#define AN_UNSUPPLIED_MAX 1.3f /* times |U|^2: braking reaches 1 with a sensor at half scale, a reversed sensor 1.85 */
#define AN_MEMORY 0.94f        /* factor per window: half within 2.2 ms */
#define AN_UNEXPLAINED_SHARE 0.08f /* of the energy, not explained by any damping and detuning */
#define AN_UNEXPLAINED_MIN 3e-4f /* of the squared motion: allows for noise in proportion to the signal */
#define AN_NEIGHBOUR_DECAY 3.0f /* time constants for neighbours to ring down, in addition to UNEXPLAINED_MAX */
#define AN_NOISE_MARGIN 12.0f
#define AN_SETTLED 3.0f /* time constants of the closed loop */

enum { HIDDEN_MAX = 6, IDLE_MAX = 2, UNDRIVEN_MAX = 3, UNEXPLAINED_MAX = 32, UNSTEADY = 2 };

void an_track_forget(an_track *track)
{
    track->shift = 0.0f;
}

void an_track_begin(an_track *track, const an_mode *mode, const an_pi_spec *spec, float detuning_hz, float noise2)
{
    track->period_s = spec->period_s;
    track->rate = 1.0f / mode->tau_s;
    track->rate_now = track->rate;
    track->push = an_abs(mode->gain) * track->rate * spec->period_s;
    track->share = 1.0f - spec->ahead_s / spec->period_s;
    track->drive_limit = mode->drive_limit;
    track->detuning = AN_TWO_PI * detuning_hz;
    track->span = AN_TWO_PI * AN_SPAN * mode->frequency_hz;
    track->noise2 = noise2;
    track->read = 0u;
    track->idle = 0u;
    track->undriven = 0u;
    track->unexplained = 0u;
    track->unexplained_most =
        UNEXPLAINED_MAX + (uint32_t)(AN_NEIGHBOUR_DECAY * mode->tau_s / (spec->period_s * (float)AN_TRACK_WINDOWS));
    const float bounded = spec->proportional_max * an_abs(mode->gain);
    const float loop = bounded > AN_LOOP_GAIN_MIN ? bounded : AN_LOOP_GAIN_MIN;
    track->unsteady_most = UNSTEADY + (uint32_t)(AN_SETTLED * mode->tau_s / (loop * spec->period_s * (float)AN_TRACK_WINDOWS));
    track->unsteady = track->unsteady_most;
    track->neighbour = AN_NEIGHBOUR_LOOP / loop;
    track->limited = 0u;
    track->least = an_cplx(0.0f, 0.0f);
    track->hidden = 0u;
    track->unsupplied = 0.0f;
    track->shown = 0.0f;
    track->hidden_most = HIDDEN_MAX + (uint32_t)(1.0f / (AN_DAMPED_MAX * track->rate * spec->period_s));
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

/* Count up while a condition holds and down while it does not, so that an intermittent condition is found as well. */
static bool exceeds(uint32_t *counter, bool is_so, uint32_t most)
{
    if (is_so) {
        (*counter)++;
    } else if (*counter > 0u) {
        (*counter)--;
    }
    return *counter >= most;
}

/* Strongest plausible damping and detuning, times the period. */
static float strongest_damping(const an_track *track)
{
    const float detuning = track->detuning < 0.0f ? -track->detuning : track->detuning;
    return track->period_s * (AN_DAMPED_MAX * track->rate + 2.0f * detuning);
}

/* Amplitude that a drive with a clear effect adds in a period. */
static float effective_push(const an_track *track)
{
    return AN_DRIVE_MIN * track->push * track->drive_limit;
}

static bool drive_does_nothing(const an_track *track, const an_balance *block)
{
    const float effective = effective_push(track);
    const float most = 0.5f * strongest_damping(track);
    return block->given > effective * effective * (float)block->count && block->supply > most * most * block->motion;
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
    return left > AN_UNEXPLAINED_SHARE * block->supply && left > 0.25f * AN_UNEXPLAINED_MIN * block->motion &&
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
    track->unsteady = track->unsteady_most;
}

/* Damping that a drive may seem to lack while its neighbours answer with another sign: of them, only a bound is known. */
static float hidden_damping(const an_track *track, const an_balance *block)
{
    return 2.0f * track->neighbour / track->period_s * __builtin_sqrtf(block->given / block->motion);
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
    const float least = steady ? AN_DAMPED_MIN * track->rate
                               : AN_PUSHED_MAX * track->rate - (moving ? hidden_damping(track, block) : 0.0f);
    const bool undriven = exceeds(&track->undriven, moving && a.re < least, UNDRIVEN_MAX);
    const bool unexplained = steady && exceeds(&track->unexplained, moving && model_explains_too_little(track, block),
                                               track->unexplained_most);
    track->unsteady -= steady ? 0u : 1u;
    return idle || undriven || unexplained;
}

/* Compare the sensor with the motion that the drives must at least have caused in the most heavily damped plate, from
 * an implicit Euler step of dU/dt + a U = b V. The model restarts from rest whenever the sensor shows enough, because
 * the drive is also strong while it brakes a moving plate. */
static void check_motion(an_track *track, an_complex given, an_complex measured)
{
    const float least2 = larger(AN_VISIBLE_MIN * AN_VISIBLE_MIN, AN_NOISE_MARGIN * track->noise2);
    track->least = an_scale(an_add(track->least, given), 1.0f / (1.0f + strongest_damping(track)));
    const float shown2 = AN_VISIBLE_SHARE2 * an_abs2(track->least);
    if (an_abs2(measured) >= larger(shown2, least2)) {
        track->least = an_cplx(0.0f, 0.0f);
    }
    track->hidden = an_abs2(measured) < shown2 && shown2 > least2 ? track->hidden + 1u : 0u;
}

/* Accumulate the energy that appears without work by the drive, beyond what ringing neighbours can return. Energy and
 * motion decay at the same rate, so that noise fed back by the loop does not accumulate. */
static void check_work(an_track *track, an_complex twice, float spent, an_complex measured)
{
    const float given_back = -0.5f * AN_PUSHED_MAX * track->period_s * track->rate * an_abs2(twice);
    track->unsupplied = larger(AN_MEMORY * track->unsupplied - spent - given_back, 0.0f);
    track->shown = larger(AN_MEMORY * track->shown, an_abs2(measured));
}

static bool gains_unsupplied_energy(const an_track *track)
{
    const float least2 = 4.0f * larger(AN_MOTION_MIN * AN_MOTION_MIN, AN_NOISE_MARGIN * track->noise2);
    return track->unsupplied > AN_UNSUPPLIED_MAX * larger(track->shown, least2);
}

/* Add a step from the middle of one window to the middle of the next; the old drive acts until the gap has passed, the
 * new one after that. The normal equation of y = a T (U + U') / 2 is a = 2 product / (T motion). */
static void add(an_track *track, const an_track_note *before, const an_track_note *now)
{
    an_balance *block = &track->block;
    const an_complex drive = an_add(an_scale(now->drive, track->share), an_scale(before->drive, 1.0f - track->share));
    const an_complex given = an_scale(drive, track->push);
    check_motion(track, given, now->measured);
    const an_complex y = an_sub(given, an_sub(now->measured, before->measured));
    const an_complex twice = an_add(now->measured, before->measured);
    block->given += an_abs2(given);
    block->supply += an_abs2(y);
    block->motion += an_abs2(twice);
    const an_complex product = an_mul(y, an_conj(twice));
    check_work(track, twice, product.re, now->measured);
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
    if (track->hidden >= track->hidden_most || gains_unsupplied_energy(track)) {
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
