/* One sensor, one drive and its inverse, sampled and renewed together every 4 us. */
#ifndef CONVERTERS_H
#define CONVERTERS_H

#include <stdbool.h>
#include <stdint.h>

#include "registers.h"

#define CONVERTERS_RATE_HZ 250000.0f /* 90 MHz / 360 */

enum { CONVERTERS_MIDDLE = 2048 };

/* TIM2 will trigger DAC and ADC together; ADC_IRQHandler follows each conversion. */
void converters_init(void);
void converters_start(void);

/* Outputs in the middle at once, no more triggers. */
void converters_stop(void);

/* The ADC takes no trigger while an overrun stands in its status: forgets it. */
void converters_revive(void);

/* True when a sample was never read; forgets it. */
static inline bool converters_lost_one(void)
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

/* The code both channels take at the next trigger, the second one inverted. */
static inline void converters_drive(uint32_t code)
{
    DAC->DHR12RD = code | (2u * CONVERTERS_MIDDLE - code) << 16;
}

#endif
