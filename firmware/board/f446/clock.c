#include "board.h"
#include "registers.h"

enum { PATIENCE = 200000 }; /* turns of a polling loop: some 50 ms at 16 MHz, far beyond a crystal's start */

static bool becomes_set(const reg *where, uint32_t bits)
{
    for (uint32_t i = 0u; i < PATIENCE; i++) {
        if ((*where & bits) == bits) {
            return true;
        }
    }
    return false;
}

static bool crystal_start(void)
{
    RCC->CR |= BIT(18) | BIT(16); /* HSEBYP, HSEON: the debugger feeds 8 MHz */
    return becomes_set(&RCC->CR, BIT(17));
}

/* 8 MHz / 4 = 2 MHz, times 180 = 360 MHz, / 2 = 180 MHz. */
static bool pll_start(void)
{
    RCC->PLLCFGR = 4u | 180u << 6 | BIT(22) | 8u << 24 | 2u << 28;
    RCC->CR |= BIT(24);
    return becomes_set(&RCC->CR, BIT(25));
}

static bool overdrive_start(void)
{
    PWR->CR |= BIT(16); /* ODEN */
    if (!becomes_set(&PWR->CSR, BIT(16))) {
        return false;
    }
    PWR->CR |= BIT(17); /* ODSWEN */
    return becomes_set(&PWR->CSR, BIT(17));
}

bool clock_start(void)
{
    RCC->AHB1ENR |= BIT(0) | BIT(1) | BIT(2) | BIT(21) | BIT(22); /* GPIOA to C, DMA1, DMA2 */
    RCC->APB1ENR |= BIT(0) | BIT(17) | BIT(28) | BIT(29);         /* TIM2, USART2, PWR, DAC */
    RCC->APB2ENR |= BIT(0) | BIT(1) | BIT(8) | BIT(9) | BIT(10);  /* TIM1, TIM8, ADC1 to ADC3 */
    PWR->CR |= 3u << 14 | 7u << 5 | BIT(4);                       /* highest core voltage; watch for less than 2.9 V */
    if (!crystal_start() || !pll_start() || !overdrive_start()) {
        return false;
    }
    FLASH->ACR = 5u | BIT(8) | BIT(9) | BIT(10); /* five wait states, prefetch, both caches */
    RCC->CFGR = 5u << 10 | 4u << 13;             /* APB1 45 MHz, APB2 90 MHz */
    RCC->CFGR |= 2u;                             /* run from the PLL */
    if (!becomes_set(&RCC->CFGR, 2u << 2)) {
        return false;
    }
    RCC->CR |= BIT(19); /* a crystal that dies later raises the NMI */
    return true;
}

bool clock_reset_by_watchdog(void)
{
    const bool watchdog = (RCC->CSR & BIT(29)) != 0u;
    RCC->CSR |= BIT(24);
    return watchdog;
}

void clock_count_cycles(void)
{
    DEMCR |= BIT(24);
    DWT->CYCCNT = 0u;
    DWT->CTRL |= BIT(0);
}

bool clock_supply_is_low(void)
{
    return (PWR->CSR & BIT(2)) != 0u;
}
