#include "converters.h"

#include "board.h"

enum { TICKS = 360, ENABLE = 1 << 0 };

static const uint32_t triggered = DAC_CR_TEN | DAC_CR_TEN << DAC_CR_CHANNEL2_POS;

void converters_enable(bool on)
{
    GPIOB->ODR = on ? ENABLE : 0u; /* port B has no other output in this build */
}

void board_outputs_safe(void)
{
    converters_drive(CONVERTERS_MIDDLE);
    converters_enable(false);
}

static void pins_analog(void)
{
    const uint32_t analog = GPIO_MODE_ANALOG;
    GPIOA->MODER |= analog << 0 | analog << 8 | analog << 10; /* PA0 sensor, PA4 drive, PA5 inverted drive */
    converters_enable(false);
    GPIOB->MODER |= (uint32_t)GPIO_MODE_OUTPUT << 0; /* PB0 amplifier enable */
}

static void dac_init(void)
{
    const uint32_t channel = DAC_CR_EN | DAC_CR_TSEL_TIM2;
    converters_drive(CONVERTERS_MIDDLE);
    DAC->CR = channel | channel << DAC_CR_CHANNEL2_POS;
}

static void adc_init(void)
{
    ADC_COMMON->CCR = ADC_CCR_ADCPRE_DIV4; /* 90 MHz / 4 = 22.5 MHz */
    ADC1->SMPR2 = ADC_SMP_15;              /* channel 0: 15 + 12 cycles = 1.2 us */
    ADC1->SQR1 = 0u;
    ADC1->SQR3 = 0u;
    ADC1->CR1 = ADC_CR1_EOCIE;
    ADC1->CR2 = ADC_CR2_ADON | ADC_CR2_EOCS | ADC_CR2_EXTSEL_TIM2_TRGO | ADC_CR2_EXTEN_RISING; /* detects overruns */
}

static void interrupts_init(void)
{
    SCB->SHPR[SCB_SHPR_PENDSV] = PRIORITY_SLOW;
    nvic_enable(ADC_IRQ);
}

void converters_init(void)
{
    pins_analog();
    dac_init();
    adc_init();
    TIM2->PSC = 0u;
    TIM2->ARR = TICKS - 1;
    TIM2->CR2 = TIM_CR2_MMS_UPDATE; /* the update event triggers both converters */
    interrupts_init();
}

void converters_start(void)
{
    ADC1->SR = 0u;
    DAC->CR |= triggered;
    TIM2->CR1 = TIM_CR1_CEN;
}

/* Without a trigger, a code written to the DAC takes effect at once. */
void converters_stop(void)
{
    TIM2->CR1 = 0u;
    DAC->CR &= ~triggered;
    board_outputs_safe();
}

void converters_revive(void)
{
    ADC1->SR = 0u;
}
