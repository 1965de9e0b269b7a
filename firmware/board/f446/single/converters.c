#include "converters.h"

#include "board.h"

enum { TICKS = 360 };

static const uint32_t triggered = 1u << 2 | 1u << 18; /* of both DAC channels */

void board_outputs_safe(void)
{
    converters_drive(CONVERTERS_MIDDLE);
}

static void pins_analog(void)
{
    GPIOA->MODER |= 3u << 0 | 3u << 8 | 3u << 10; /* PA0 sensor, PA4 drive, PA5 inverted drive */
}

static void dac_init(void)
{
    const uint32_t channel = BIT(0) | 4u << 3; /* on, its trigger is TIM2's */
    converters_drive(CONVERTERS_MIDDLE);
    DAC->CR = channel | channel << 16;
}

static void adc_init(void)
{
    ADC_COMMON->CCR = 1u << 16; /* 90 MHz / 4 = 22.5 MHz */
    ADC1->SMPR2 = 1u;           /* channel 0: 15 + 12 cycles = 1.2 us */
    ADC1->SQR1 = 0u;
    ADC1->SQR3 = 0u;
    ADC1->CR1 = BIT(5);                                 /* interrupt after each conversion */
    ADC1->CR2 = BIT(0) | BIT(10) | 6u << 24 | 1u << 28; /* on, overrun watched, TIM2's rising trigger */
}

static void interrupts_init(void)
{
    NVIC->IPR[ADC_IRQ] = 0x00;
    SCB->SHPR[PENDSV_PRIORITY_BYTE] = 0x20;
    NVIC->ISER[0] = BIT(ADC_IRQ);
}

void converters_init(void)
{
    pins_analog();
    dac_init();
    adc_init();
    TIM2->PSC = 0u;
    TIM2->ARR = TICKS - 1;
    TIM2->CR2 = 2u << 4; /* its update is the trigger of both converters */
    interrupts_init();
}

void converters_start(void)
{
    ADC1->SR = 0u;
    DAC->CR |= triggered;
    TIM2->CR1 = BIT(0);
}

/* Without a trigger the DAC takes over what is written at once. */
void converters_stop(void)
{
    TIM2->CR1 = 0u;
    DAC->CR &= ~triggered;
    converters_drive(CONVERTERS_MIDDLE);
}
