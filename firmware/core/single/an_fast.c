#include "an_fast.h"

#include <stdatomic.h>

#include "an_bytes.h"
#include "an_complex.h"
#include "an_sincos.h"
#include "an_wire.h"

void an_fast_init(an_fast *fast, uint32_t step)
{
    an_clear(fast, sizeof *fast);
    fast->step = step;
    fast->command.step = step;
}

/* Take over the slow step's command, or note that it is late. The slow step itself reports the faults of its window. */
static void take_command(an_fast *fast)
{
    if (fast->command.count == fast->window.count) {
        fast->drive = fast->command.drive;
        fast->step = fast->command.step;
    } else {
        volatile uint32_t *faults = &fast->faults; /* volatile: a value held in a register would slow down every tick */
        *faults |= AN_FAULT_SLOW_LATE;
    }
    fast->sums = (an_sums){0.0f, 0.0f, 0.0f};
}

static void end_window(an_fast *fast)
{
    fast->tick = 0u;
    fast->window.sums = fast->sums;
    fast->window.last_phase = fast->phase;
    fast->window.clipped = fast->clipped;
    fast->clipped = 0u;
    atomic_signal_fence(memory_order_release);
    fast->window.count++;
}

#define AN_LEVEL_MAX 2047.4f /* full drive with rounding errors, still within the DAC's range */

/* Round to the nearest DAC code. A NaN fails the comparison, so that no undefined conversion can occur. Any fault,
 * whatever its origin, sets the output to rest. */
static uint32_t dac_code(an_fast *fast, float level)
{
    if (!(__builtin_fabsf(level) <= AN_LEVEL_MAX)) {
        fast->faults |= AN_FAULT_NOT_FINITE;
        return AN_DAC_MIDDLE;
    }
    if (fast->faults != 0u) {
        return AN_DAC_MIDDLE;
    }
    return (uint32_t)(int32_t)(level + ((float)AN_DAC_MIDDLE + 0.5f));
}

uint32_t an_fast_tick(an_fast *fast, uint32_t adc)
{
    const an_complex carrier = an_sincos(fast->phase);
    const float x = (float)((int32_t)adc - AN_ADC_MIDDLE);
    fast->sums.cosine += x * carrier.re;
    fast->sums.sine += x * carrier.im;
    fast->sums.offset += x;
    fast->clipped += ((adc + AN_ADC_MARGIN) & (4096u - 2u * AN_ADC_MARGIN)) == 0u;
    const uint32_t code = dac_code(fast, fast->drive.re * carrier.re - fast->drive.im * carrier.im);

    fast->recent[fast->tick & AN_RECENT_MASK] = x;
    fast->tick++;
    if (fast->tick == AN_GAP) {
        take_command(fast);
    } else if (fast->tick == AN_PERIOD) {
        end_window(fast);
    }
    fast->phase += fast->step;
    return code;
}
