#include "an_six_fast.h"

#include <stdatomic.h>

#include "an_bytes.h"
#include "an_complex.h"
#include "an_sincos.h"
#include "an_wire.h"

/* Unroll the loops over six channels: the loop instructions would take a fifth of the tick. */
#if defined(__GNUC__) && !defined(__clang__)
#define UNROLLED _Pragma("GCC unroll 6")
#else
#define UNROLLED
#endif

#define AN_LEVEL_MAX 1.0002f /* full drive with rounding errors, still within the timer's range */

void an_six_fast_init(an_six_fast *fast, uint32_t step, uint32_t window)
{
    an_clear(fast, sizeof *fast);
    fast->step = step;
    fast->end = AN_SIX_GAP + window;
    fast->growing = AN_SIX_GAP_BANK;
    fast->command.step = step;
    fast->command.window = window;
}

static void take_command(an_six_fast *fast)
{
    if (fast->command.count == fast->window.count) {
        fast->acting = fast->command.bank;
        fast->step = fast->command.step;
        fast->end = AN_SIX_GAP + fast->command.window;
    } else {
        fast->faults |= AN_FAULT_SLOW_LATE;
    }
    fast->growing = fast->window.bank ^ 1u;
}

static void end_window(an_six_fast *fast)
{
    fast->tick = 0u;
    fast->window.bank = fast->growing;
    fast->window.last_phase = fast->phase;
    fast->window.clipped = fast->clipped;
    fast->clipped = 0u;
    fast->growing = AN_SIX_GAP_BANK;
    atomic_signal_fence(memory_order_release);
    fast->window.count++;
}

static void measure(an_six_fast *fast, an_complex carrier, const uint16_t *adc)
{
    an_sums *sums = fast->sums[fast->growing <= AN_SIX_GAP_BANK ? fast->growing : (uint32_t)AN_SIX_GAP_BANK];
    UNROLLED
    for (uint32_t i = 0u; i < AN_SIX; i++) {
        const uint32_t sample = adc[i];
        const float x = (float)((int32_t)sample - AN_SIX_ADC_MIDDLE);
        sums[i].cosine += x * carrier.re;
        sums[i].sine += x * carrier.im;
        sums[i].offset += x;
        fast->clipped += ((sample + AN_SIX_ADC_MARGIN) & (4096u - 2u * AN_SIX_ADC_MARGIN)) == 0u;
    }
}

/* Duty cycle of a drive level. A NaN fails the comparison, so that no undefined conversion can occur. */
static uint32_t duty_of(an_six_fast *fast, float level)
{
    if (!(__builtin_fabsf(level) <= AN_LEVEL_MAX)) {
        fast->faults |= AN_FAULT_NOT_FINITE;
        return AN_SIX_DUTY_MIDDLE;
    }
    return (uint32_t)(int32_t)(level * (float)AN_SIX_DUTY_SWING + ((float)AN_SIX_DUTY_MIDDLE + 0.5f));
}

static void act(an_six_fast *fast, an_complex carrier, uint16_t *duty)
{
    const bool acts = fast->faults == 0u && fast->acting < AN_SIX_REST_BANK;
    const an_complex *drive = fast->drive[acts ? fast->acting : (uint32_t)AN_SIX_REST_BANK];
    UNROLLED
    for (uint32_t i = 0u; i < AN_SIX; i++) {
        duty[i] = (uint16_t)duty_of(fast, drive[i].re * carrier.re - drive[i].im * carrier.im);
    }
}

void an_six_tick(an_six_fast *fast, const uint16_t *adc, uint16_t *duty)
{
    const an_complex carrier = an_sincos(fast->phase);
    measure(fast, carrier, adc);
    act(fast, carrier, duty);
    fast->tick++;
    if (fast->tick == AN_SIX_GAP) {
        take_command(fast);
    } else if (fast->tick == fast->end) {
        end_window(fast);
    }
    fast->phase += fast->step;
}
