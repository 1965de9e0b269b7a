/* One sensor, one drive and its inverse, sampled and updated together every 4 us. */
#ifndef CONVERTERS_H
#define CONVERTERS_H

#include <stdbool.h>
#include <stdint.h>

#include "registers.h"

#define CONVERTERS_RATE_HZ 250000.0f /* 90 MHz / 360 */

enum { CONVERTERS_MIDDLE = 2048 };

/* Prepare the converters. TIM2 triggers DAC and ADC together; ADC_IRQHandler runs after each conversion. */
void converters_init(void);
void converters_start(void);

/* Stop the triggers and set the outputs to mid-scale at once. */
void converters_stop(void);

/* Clear an overrun: the ADC ignores triggers while the flag is set. */
void converters_revive(void);

/* True if a sample was overwritten before it was read; clears the flag. */
static inline bool converters_overran(void)
{
    const bool lost = (ADC1->SR & ADC_SR_OVR) != 0u;
    if (lost) {
        ADC1->SR = 0u;
    }
    return lost;
}

static inline uint32_t converters_sample(void)
{
    return ADC1->DR;
}

/* Set the code for the next trigger on both channels, inverted on the second. */
static inline void converters_drive(uint32_t code)
{
    DAC->DHR12RD = code | (2u * CONVERTERS_MIDDLE - code) << 16;
}

/* Enable the amplifier (PB0 high), from any context; board_outputs_safe disables it. */
void converters_enable(bool on);

#endif
