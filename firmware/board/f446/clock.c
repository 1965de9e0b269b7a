#include "board.h"
#include "registers.h"

enum { POLLS_MAX = 200000 }; /* some 50 ms at 16 MHz, far longer than a crystal takes to start */

#define CORE_PLL_HZ 180000000u
#define CORE_RC_HZ 16000000u

static bool from_pll;

static bool becomes_set(const reg *where, uint32_t bits)
{
    for (uint32_t i = 0u; i < POLLS_MAX; i++) {
        if ((*where & bits) == bits) {
            return true;
        }
    }
    return false;
}

static bool crystal_start(void)
{
    RCC->CR |= RCC_CR_HSEBYP | RCC_CR_HSEON; /* bypass: the debugger supplies 8 MHz */
    return becomes_set(&RCC->CR, RCC_CR_HSERDY);
}

/* Either source is divided to 2 MHz; 2 MHz x 180 / 2 = 180 MHz. */
static bool pll_start(bool crystal)
{
    const uint32_t source = crystal ? 4u | (uint32_t)RCC_PLLCFGR_PLLSRC_HSE : 8u;
    RCC->PLLCFGR = source | 180u << RCC_PLLCFGR_PLLN_POS | 8u << RCC_PLLCFGR_PLLQ_POS | 2u << RCC_PLLCFGR_PLLR_POS;
    RCC->CR |= RCC_CR_PLLON;
    return becomes_set(&RCC->CR, RCC_CR_PLLRDY);
}

static bool overdrive_start(void)
{
    PWR->CR |= PWR_CR_ODEN;
    if (!becomes_set(&PWR->CSR, PWR_CSR_ODRDY)) {
        return false;
    }
    PWR->CR |= PWR_CR_ODSWEN;
    return becomes_set(&PWR->CSR, PWR_CSR_ODSWRDY);
}

/* The flash wait states must be in effect before the clock is raised. */
static bool pll_run(void)
{
    FLASH->ACR = FLASH_ACR_LATENCY_5 | FLASH_ACR_PRFTEN | FLASH_ACR_ICEN | FLASH_ACR_DCEN;
    if (!becomes_set(&FLASH->ACR, FLASH_ACR_LATENCY_5)) {
        return false;
    }
    RCC->CFGR = RCC_CFGR_PPRE1_DIV4 | RCC_CFGR_PPRE2_DIV2; /* APB1 45 MHz, APB2 90 MHz */
    RCC->CFGR |= RCC_CFGR_SW_PLL;
    return becomes_set(&RCC->CFGR, RCC_CFGR_SWS_PLL);
}

static void peripherals_start(void)
{
    RCC->AHB1ENR |= RCC_AHB1ENR_GPIOAEN | RCC_AHB1ENR_GPIOBEN | RCC_AHB1ENR_GPIOCEN | RCC_AHB1ENR_DMA1EN |
                    RCC_AHB1ENR_DMA2EN;
    RCC->APB1ENR |= RCC_APB1ENR_TIM2EN | RCC_APB1ENR_USART2EN | RCC_APB1ENR_DACEN;
    RCC->APB2ENR |= RCC_APB2ENR_TIM1EN | RCC_APB2ENR_TIM8EN | RCC_APB2ENR_ADC1EN;
}

/* No other peripheral may be clocked while overdrive is being enabled (RM0390 5.1.4). */
bool clock_start(void)
{
    RCC->APB1ENR |= RCC_APB1ENR_PWREN;
    PWR->CR |= PWR_CR_VOS_SCALE1 | PWR_CR_PLS_2V9 | PWR_CR_PVDE;
    const bool crystal = crystal_start();
    from_pll = pll_start(crystal) && overdrive_start() && pll_run();
    peripherals_start();
    if (!crystal || !from_pll) {
        return false;
    }
    RCC->CR |= RCC_CR_CSSON; /* a later failure of the crystal raises an NMI */
    return true;
}

uint32_t clock_core_hz(void)
{
    return from_pll ? CORE_PLL_HZ : CORE_RC_HZ;
}

uint32_t clock_apb1_hz(void)
{
    return from_pll ? CORE_PLL_HZ / 4u : CORE_RC_HZ;
}

void clock_count_cycles(void)
{
    DEMCR |= DEMCR_TRCENA;
    DWT->CYCCNT = 0u;
    DWT->CTRL |= DWT_CTRL_CYCCNTENA;
}

bool clock_supply_is_low(void)
{
    return (PWR->CSR & PWR_CSR_PVDO) != 0u;
}

void debug_init(void)
{
    DBGMCU->CR |= DBGMCU_CR_DBG_SLEEP;
    DBGMCU->APB1_FZ |= DBGMCU_APB1_FZ_IWDG | DBGMCU_APB1_FZ_TIM2;
    DBGMCU->APB2_FZ |= DBGMCU_APB2_FZ_TIM1 | DBGMCU_APB2_FZ_TIM8;
}
