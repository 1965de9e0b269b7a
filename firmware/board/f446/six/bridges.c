#include "bridges.h"

#include "board.h"
#include "registers.h"

enum {
    DEAD_TIME = 54,  /* in units of 5.6 ns: 0.3 us */
    SCAN_LEAD = 648, /* in units of 5.6 ns: 3.6 us, half the duration of six conversions */
    THREE_PAIRS = TIM_CCER_PAIR | TIM_CCER_PAIR << TIM_CCER_NEXT_POS | TIM_CCER_PAIR << 2 * TIM_CCER_NEXT_POS
};

void board_outputs_safe(void)
{
    bridges_off();
}

static void set_alternate(gpio_regs *port, uint32_t pin, uint32_t function)
{
    reg *half = pin < 8u ? &port->AFRL : &port->AFRH;
    *half |= function << (4u * (pin % 8u));
    port->MODER |= (uint32_t)GPIO_MODE_ALTERNATE << (2u * pin);
}

static void pins_init(void)
{
    for (uint32_t i = 0u; i < 3u; i++) {
        set_alternate(GPIOA, 8u + i, 1u);  /* TIM1 CH1 to CH3 */
        set_alternate(GPIOB, 13u + i, 1u); /* TIM1 CH1N to CH3N */
        set_alternate(GPIOC, 6u + i, 3u);  /* TIM8 CH1 to CH3 */
    }
    set_alternate(GPIOA, 7u, 3u); /* TIM8 CH1N to CH3N */
    set_alternate(GPIOB, 0u, 3u);
    set_alternate(GPIOB, 1u, 3u);
    set_alternate(GPIOB, 12u, 1u); /* TIM1 BKIN */
    set_alternate(GPIOA, 6u, 3u);  /* TIM8 BKIN */
    GPIOB->PUPDR |= (uint32_t)GPIO_PULL_UP << 24;
    GPIOA->PUPDR |= (uint32_t)GPIO_PULL_UP << 12;
}

static void timer_init(tim_regs *timer)
{
    timer->CR1 = TIM_CR1_CMS_1 | TIM_CR1_ARPE;
    timer->PSC = 0u;
    timer->ARR = BRIDGES_TOP;
    timer->RCR = 1u; /* one update per period instead of two */
    timer->CCMR1 = TIM_OC_PWM1_PRELOADED | TIM_OC_PWM1_PRELOADED << TIM_CCMR_UPPER_POS;
    timer->CCMR2 = TIM_OC_PWM1_PRELOADED | TIM_OC_PWM2 << TIM_CCMR_UPPER_POS;
    timer->CCR1 = BRIDGES_TOP / 2;
    timer->CCR2 = BRIDGES_TOP / 2;
    timer->CCR3 = BRIDGES_TOP / 2;
    timer->CCR4 = BRIDGES_TOP - SCAN_LEAD;
    timer->CCER = THREE_PAIRS;
    /* Break input active high, so that a broken wire asserts it, too. The gates are closed by software only; dead time
     * and polarities are locked. */
    timer->BDTR = DEAD_TIME | TIM_BDTR_OSSI | TIM_BDTR_OSSR | TIM_BDTR_BKE | TIM_BDTR_BKP | TIM_BDTR_LOCK_2;
    timer->EGR = TIM_EGR_UG;
    timer->SR = 0u;
}

void bridges_init(void)
{
    timer_init(TIM1);
    timer_init(TIM8);
    TIM1->CR2 = TIM_CR2_MMS_ENABLE;    /* the start of TIM1 is the trigger ... */
    TIM8->SMCR = TIM_SMCR_SMS_TRIGGER; /* ... that starts TIM8, */
    TIM8->CR2 = TIM_CR2_MMS_OC4REF;    /* which starts the scan shortly before the end of its count */
    pins_init();
    bridges_arm_break();
    nvic_enable(TIM1_BRK_IRQ);
    nvic_enable(TIM8_BRK_IRQ);
}

void bridges_start(void)
{
    TIM1->CR1 |= TIM_CR1_CEN;
}

void bridges_off(void)
{
    TIM1->BDTR &= ~(uint32_t)TIM_BDTR_MOE;
    TIM8->BDTR &= ~(uint32_t)TIM_BDTR_MOE;
}

void bridges_on(void)
{
    TIM1->BDTR |= TIM_BDTR_MOE;
    TIM8->BDTR |= TIM_BDTR_MOE;
}

bool bridges_broken(void)
{
    return ((TIM1->SR | TIM8->SR) & TIM_SR_BIF) != 0u;
}

void bridges_arm_break(void)
{
    TIM1->SR = ~(uint32_t)TIM_SR_BIF;
    TIM8->SR = ~(uint32_t)TIM_SR_BIF;
    TIM1->DIER = TIM_DIER_BIE;
    TIM8->DIER = TIM_DIER_BIE;
}

void bridges_mask_break(void)
{
    TIM1->DIER = 0u;
    TIM8->DIER = 0u;
}

void bridges_set(const uint16_t *duty)
{
    TIM1->CCR1 = duty[0];
    TIM1->CCR2 = duty[1];
    TIM1->CCR3 = duty[2];
    TIM8->CCR1 = duty[3];
    TIM8->CCR2 = duty[4];
    TIM8->CCR3 = duty[5];
}
