#include "guard.h"

#include "an_wire.h"
#include "application.h"
#include "board.h"
#include "registers.h"

static volatile uint32_t count;
static volatile bool standstill;
static uint32_t samples;

void SysTick_Handler(void);

/* Sampling has just been started. A check that coincided with a sample would delay the fast interrupt, and the code of
 * that sample would reach the DAC one trigger late. The first period is therefore longer, so that all checks follow the
 * fast interrupt. */
void guard_start(void)
{
    samples = application_samples() - 1u;
    SCB->SHPR[SCB_SHPR_SYSTICK] = PRIORITY_FAST;
    SYSTICK->LOAD = GUARD_CYCLES - 1u + GUARD_LATER;
    SYSTICK->VAL = 0u;
    SYSTICK->CTRL = SYSTICK_CTRL_ENABLE | SYSTICK_CTRL_TICKINT | SYSTICK_CTRL_CORE_CLOCK;
    __asm volatile("dsb\n isb" ::: "memory"); /* the first, longer period has started */
    SYSTICK->LOAD = GUARD_CYCLES - 1u;
}

void guard_stop(void)
{
    SYSTICK->CTRL = 0u;
}

void SysTick_Handler(void)
{
    const uint32_t seen = samples;
    count++;
    samples = application_samples();
    if (samples == seen) {
        standstill = true;
        application_trip(AN_FAULT_FAST_LATE);
    }
    const uint32_t found = application_check() | (clock_supply_is_low() ? AN_FAULT_SUPPLY : 0u);
    if (found != 0u) {
        application_trip(found);
    }
}

bool guard_found_standstill(void)
{
    const bool found = standstill;
    standstill = false;
    return found;
}

uint32_t guard_count(void)
{
    return count;
}
