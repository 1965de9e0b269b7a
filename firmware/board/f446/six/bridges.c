#include "bridges.h"

#include "board.h"
#include "registers.h"

enum { DEAD_TIME = 54 }; /* of 5.6 ns: 0.3 us */

enum {
    CENTRE_ALIGNED = 1 << 5,
    PRELOAD = 1 << 7,
    PWM_PRELOADED = 6 << 4 | 1 << 3,
    PAIRS = 5 << 0 | 5 << 4 | 5 << 8, /* three outputs and their complements */
    IDLE_DRIVEN = 1 << 10 | 1 << 11,
    BREAK_ENABLED = 1 << 12,
    GATES = 1 << 15,
    BREAK_SEEN = 1 << 7
};

void board_outputs_safe(void)
{
    bridges_off();
}

static void set_alternate(gpio_regs *port, uint32_t pin, uint32_t function)
{
    reg *half = pin < 8u ? &port->AFRL : &port->AFRH;
    *half |= function << (4u * (pin % 8u));
    port->MODER |= 2u << (2u * pin);
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
    GPIOB->PUPDR |= 1u << 24;
    GPIOA->PUPDR |= 1u << 12;
}

static void timer_init(tim_regs *timer)
{
    timer->CR1 = CENTRE_ALIGNED | PRELOAD;
    timer->PSC = 0u;
    timer->ARR = BRIDGES_TOP;
    timer->RCR = 1u; /* one update a period, not two */
    timer->CCMR1 = PWM_PRELOADED | PWM_PRELOADED << 8;
    timer->CCMR2 = PWM_PRELOADED;
    timer->CCR1 = BRIDGES_TOP / 2;
    timer->CCR2 = BRIDGES_TOP / 2;
    timer->CCR3 = BRIDGES_TOP / 2;
    timer->CCER = PAIRS;
    timer->BDTR = DEAD_TIME | IDLE_DRIVEN | BREAK_ENABLED; /* break when low; closing again is the program's decision */
    timer->EGR = 1u;
    timer->SR = 0u;
}

void bridges_init(void)
{
    timer_init(TIM1);
    timer_init(TIM8);
    TIM1->CR2 = 1u << 4;  /* its start is the trigger ... */
    TIM8->SMCR = 6u;      /* ... that starts TIM8 */
    TIM8->CR2 = 2u << 4;  /* whose update starts the scan */
    pins_init();
}

void bridges_start(void)
{
    TIM1->CR1 |= BIT(0);
}

void bridges_off(void)
{
    TIM1->BDTR &= ~(uint32_t)GATES;
    TIM8->BDTR &= ~(uint32_t)GATES;
}

void bridges_on(void)
{
    TIM1->BDTR |= GATES;
    TIM8->BDTR |= GATES;
}

bool bridges_broken(void)
{
    const bool broken = ((TIM1->SR | TIM8->SR) & BREAK_SEEN) != 0u;
    if (broken) {
        TIM1->SR = ~(uint32_t)BREAK_SEEN;
        TIM8->SR = ~(uint32_t)BREAK_SEEN;
    }
    return broken;
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
