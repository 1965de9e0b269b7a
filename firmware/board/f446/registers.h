/* Registers of the STM32F446 used by this firmware (RM0390; PM0214 for those of the core).
 *
 * Registers and bits have the names used in the manuals. The offset of every member is asserted.
 */
#ifndef REGISTERS_H
#define REGISTERS_H

#include <stddef.h>
#include <stdint.h>

typedef volatile uint32_t reg;

#define REGISTER_AT(type, member, offset) _Static_assert(offsetof(type, member) == (offset), #type "." #member)

typedef struct {
    reg CR, PLLCFGR, CFGR, CIR, AHB1RSTR, AHB2RSTR, AHB3RSTR, unused0, APB1RSTR, APB2RSTR, unused1[2];
    reg AHB1ENR, AHB2ENR, AHB3ENR, unused2, APB1ENR, APB2ENR, unused3[10], BDCR, CSR;
} rcc_regs;
REGISTER_AT(rcc_regs, CR, 0x00);
REGISTER_AT(rcc_regs, PLLCFGR, 0x04);
REGISTER_AT(rcc_regs, CFGR, 0x08);
REGISTER_AT(rcc_regs, CIR, 0x0c);
REGISTER_AT(rcc_regs, AHB1RSTR, 0x10);
REGISTER_AT(rcc_regs, AHB2RSTR, 0x14);
REGISTER_AT(rcc_regs, AHB3RSTR, 0x18);
REGISTER_AT(rcc_regs, APB1RSTR, 0x20);
REGISTER_AT(rcc_regs, APB2RSTR, 0x24);
REGISTER_AT(rcc_regs, AHB1ENR, 0x30);
REGISTER_AT(rcc_regs, AHB2ENR, 0x34);
REGISTER_AT(rcc_regs, AHB3ENR, 0x38);
REGISTER_AT(rcc_regs, APB1ENR, 0x40);
REGISTER_AT(rcc_regs, APB2ENR, 0x44);
REGISTER_AT(rcc_regs, BDCR, 0x70);
REGISTER_AT(rcc_regs, CSR, 0x74);

enum {
    RCC_CR_HSEON = 1 << 16,
    RCC_CR_HSERDY = 1 << 17,
    RCC_CR_HSEBYP = 1 << 18,
    RCC_CR_CSSON = 1 << 19,
    RCC_CR_PLLON = 1 << 24,
    RCC_CR_PLLRDY = 1 << 25,
    RCC_PLLCFGR_PLLN_POS = 6,
    RCC_PLLCFGR_PLLSRC_HSE = 1 << 22,
    RCC_PLLCFGR_PLLQ_POS = 24,
    RCC_PLLCFGR_PLLR_POS = 28,
    RCC_CFGR_SW_PLL = 2 << 0,
    RCC_CFGR_SWS_PLL = 2 << 2,
    RCC_CFGR_PPRE1_DIV4 = 5 << 10,
    RCC_CFGR_PPRE2_DIV2 = 4 << 13,
    RCC_AHB1ENR_GPIOAEN = 1 << 0,
    RCC_AHB1ENR_GPIOBEN = 1 << 1,
    RCC_AHB1ENR_GPIOCEN = 1 << 2,
    RCC_AHB1ENR_BKPSRAMEN = 1 << 18,
    RCC_AHB1ENR_DMA1EN = 1 << 21,
    RCC_AHB1ENR_DMA2EN = 1 << 22,
    RCC_APB1ENR_TIM2EN = 1 << 0,
    RCC_APB1ENR_USART2EN = 1 << 17,
    RCC_APB1ENR_PWREN = 1 << 28,
    RCC_APB1ENR_DACEN = 1 << 29,
    RCC_APB2ENR_TIM1EN = 1 << 0,
    RCC_APB2ENR_TIM8EN = 1 << 1,
    RCC_APB2ENR_ADC1EN = 1 << 8,
    RCC_CSR_RMVF = 1 << 24,
    RCC_CSR_PORRSTF = 1 << 27,
    RCC_CSR_IWDGRSTF = 1 << 29
};

typedef struct {
    reg CR, CSR;
} pwr_regs;
REGISTER_AT(pwr_regs, CR, 0x00);
REGISTER_AT(pwr_regs, CSR, 0x04);

enum {
    PWR_CR_PVDE = 1 << 4,
    PWR_CR_DBP = 1 << 8,
    PWR_CR_PLS_2V9 = 7 << 5,
    PWR_CR_VOS_SCALE1 = 3 << 14,
    PWR_CR_ODEN = 1 << 16,
    PWR_CR_ODSWEN = 1 << 17,
    PWR_CSR_PVDO = 1 << 2,
    PWR_CSR_BRE = 1 << 9,
    PWR_CSR_ODRDY = 1 << 16,
    PWR_CSR_ODSWRDY = 1 << 17
};

typedef struct {
    reg ACR, KEYR, OPTKEYR, SR, CR, OPTCR;
} flash_regs;
REGISTER_AT(flash_regs, ACR, 0x00);
REGISTER_AT(flash_regs, KEYR, 0x04);
REGISTER_AT(flash_regs, OPTKEYR, 0x08);
REGISTER_AT(flash_regs, SR, 0x0c);
REGISTER_AT(flash_regs, CR, 0x10);
REGISTER_AT(flash_regs, OPTCR, 0x14);

enum {
    FLASH_ACR_LATENCY_5 = 5 << 0,
    FLASH_ACR_PRFTEN = 1 << 8,
    FLASH_ACR_ICEN = 1 << 9,
    FLASH_ACR_DCEN = 1 << 10,
    FLASH_ACR_ICRST = 1 << 11,
    FLASH_ACR_DCRST = 1 << 12,
    FLASH_SR_ERRORS = 0xf2, /* OPERR, WRPERR, PGAERR, PGPERR, PGSERR */
    FLASH_SR_BSY = 1 << 16,
    FLASH_CR_PG = 1 << 0,
    FLASH_CR_SER = 1 << 1,
    FLASH_CR_SNB_POS = 3,
    FLASH_CR_PSIZE_32 = 2 << 8,
    FLASH_CR_STRT = 1 << 16
};
#define FLASH_CR_LOCK (1u << 31)
#define FLASH_KEY1 0x45670123u
#define FLASH_KEY2 0xcdef89abu

typedef struct {
    reg MODER, OTYPER, OSPEEDR, PUPDR, IDR, ODR, BSRR, LCKR, AFRL, AFRH;
} gpio_regs;
REGISTER_AT(gpio_regs, MODER, 0x00);
REGISTER_AT(gpio_regs, OTYPER, 0x04);
REGISTER_AT(gpio_regs, OSPEEDR, 0x08);
REGISTER_AT(gpio_regs, PUPDR, 0x0c);
REGISTER_AT(gpio_regs, IDR, 0x10);
REGISTER_AT(gpio_regs, ODR, 0x14);
REGISTER_AT(gpio_regs, BSRR, 0x18);
REGISTER_AT(gpio_regs, LCKR, 0x1c);
REGISTER_AT(gpio_regs, AFRL, 0x20);
REGISTER_AT(gpio_regs, AFRH, 0x24);

enum { GPIO_MODE_OUTPUT = 1, GPIO_MODE_ALTERNATE = 2, GPIO_MODE_ANALOG = 3, GPIO_PULL_UP = 1 };

typedef struct {
    reg CR1, CR2, SMCR, DIER, SR, EGR, CCMR1, CCMR2, CCER, CNT, PSC, ARR, RCR, CCR1, CCR2, CCR3, CCR4, BDTR;
} tim_regs;
REGISTER_AT(tim_regs, CR1, 0x00);
REGISTER_AT(tim_regs, CR2, 0x04);
REGISTER_AT(tim_regs, SMCR, 0x08);
REGISTER_AT(tim_regs, DIER, 0x0c);
REGISTER_AT(tim_regs, SR, 0x10);
REGISTER_AT(tim_regs, EGR, 0x14);
REGISTER_AT(tim_regs, CCMR1, 0x18);
REGISTER_AT(tim_regs, CCMR2, 0x1c);
REGISTER_AT(tim_regs, CCER, 0x20);
REGISTER_AT(tim_regs, CNT, 0x24);
REGISTER_AT(tim_regs, PSC, 0x28);
REGISTER_AT(tim_regs, ARR, 0x2c);
REGISTER_AT(tim_regs, RCR, 0x30);
REGISTER_AT(tim_regs, CCR1, 0x34);
REGISTER_AT(tim_regs, CCR2, 0x38);
REGISTER_AT(tim_regs, CCR3, 0x3c);
REGISTER_AT(tim_regs, CCR4, 0x40);
REGISTER_AT(tim_regs, BDTR, 0x44);

enum {
    TIM_CR1_CEN = 1 << 0,
    TIM_CR1_CMS_1 = 1 << 5, /* centre-aligned */
    TIM_CR1_ARPE = 1 << 7,
    TIM_CR2_MMS_ENABLE = 1 << 4,
    TIM_CR2_MMS_UPDATE = 2 << 4,
    TIM_CR2_MMS_OC4REF = 7 << 4,
    TIM_SMCR_SMS_TRIGGER = 6 << 0, /* trigger mode from ITR0, which is TIM1 for TIM8 */
    TIM_DIER_BIE = 1 << 7,
    TIM_SR_BIF = 1 << 7,
    TIM_EGR_UG = 1 << 0,
    TIM_OC_PWM1_PRELOADED = 6 << 4 | 1 << 3, /* lower channel of a CCMR; the upper one is 8 bits higher */
    TIM_OC_PWM2 = 7 << 4,
    TIM_CCMR_UPPER_POS = 8,
    TIM_CCER_PAIR = 5, /* an output and its complement; the next pair is 4 bits higher */
    TIM_CCER_NEXT_POS = 4,
    TIM_BDTR_LOCK_2 = 2 << 8,
    TIM_BDTR_OSSI = 1 << 10,
    TIM_BDTR_OSSR = 1 << 11,
    TIM_BDTR_BKE = 1 << 12,
    TIM_BDTR_BKP = 1 << 13, /* break input active high */
    TIM_BDTR_MOE = 1 << 15
};

typedef struct {
    reg SR, CR1, CR2, SMPR1, SMPR2, JOFR[4], HTR, LTR, SQR1, SQR2, SQR3, JSQR, JDR[4], DR;
} adc_regs;
REGISTER_AT(adc_regs, SR, 0x00);
REGISTER_AT(adc_regs, CR1, 0x04);
REGISTER_AT(adc_regs, CR2, 0x08);
REGISTER_AT(adc_regs, SMPR1, 0x0c);
REGISTER_AT(adc_regs, SMPR2, 0x10);
REGISTER_AT(adc_regs, JOFR, 0x14);
REGISTER_AT(adc_regs, HTR, 0x24);
REGISTER_AT(adc_regs, LTR, 0x28);
REGISTER_AT(adc_regs, SQR1, 0x2c);
REGISTER_AT(adc_regs, SQR2, 0x30);
REGISTER_AT(adc_regs, SQR3, 0x34);
REGISTER_AT(adc_regs, JSQR, 0x38);
REGISTER_AT(adc_regs, JDR, 0x3c);
REGISTER_AT(adc_regs, DR, 0x4c);

enum {
    ADC_SR_OVR = 1 << 5,
    ADC_CR1_EOCIE = 1 << 5,
    ADC_CR1_SCAN = 1 << 8,
    ADC_CR2_ADON = 1 << 0,
    ADC_CR2_DMA = 1 << 8,
    ADC_CR2_DDS = 1 << 9,
    ADC_CR2_EOCS = 1 << 10,
    ADC_CR2_EXTSEL_TIM2_TRGO = 6 << 24,
    ADC_CR2_EXTSEL_TIM8_TRGO = 14 << 24,
    ADC_CR2_EXTEN_RISING = 1 << 28,
    ADC_SMP_15 = 1, /* cycles for one channel; the next channel is 3 bits higher */
    ADC_SMP_BITS = 3,
    ADC_SQ_BITS = 5,
    ADC_SQR1_L_POS = 20,
    ADC_CCR_ADCPRE_DIV4 = 1 << 16
};

typedef struct {
    reg CSR, CCR, CDR;
} adc_common_regs;
REGISTER_AT(adc_common_regs, CSR, 0x00);
REGISTER_AT(adc_common_regs, CCR, 0x04);
REGISTER_AT(adc_common_regs, CDR, 0x08);

typedef struct {
    reg CR, SWTRIGR, DHR12R1, DHR12L1, DHR8R1, DHR12R2, DHR12L2, DHR8R2, DHR12RD, DHR12LD, DHR8RD, DOR1, DOR2, SR;
} dac_regs;
REGISTER_AT(dac_regs, CR, 0x00);
REGISTER_AT(dac_regs, SWTRIGR, 0x04);
REGISTER_AT(dac_regs, DHR12R1, 0x08);
REGISTER_AT(dac_regs, DHR12L1, 0x0c);
REGISTER_AT(dac_regs, DHR8R1, 0x10);
REGISTER_AT(dac_regs, DHR12R2, 0x14);
REGISTER_AT(dac_regs, DHR12L2, 0x18);
REGISTER_AT(dac_regs, DHR8R2, 0x1c);
REGISTER_AT(dac_regs, DHR12RD, 0x20);
REGISTER_AT(dac_regs, DHR12LD, 0x24);
REGISTER_AT(dac_regs, DHR8RD, 0x28);
REGISTER_AT(dac_regs, DOR1, 0x2c);
REGISTER_AT(dac_regs, DOR2, 0x30);
REGISTER_AT(dac_regs, SR, 0x34);

enum { DAC_CR_EN = 1 << 0, DAC_CR_TEN = 1 << 2, DAC_CR_TSEL_TIM2 = 4 << 3, DAC_CR_CHANNEL2_POS = 16 };

typedef struct {
    reg SR, DR, BRR, CR1, CR2, CR3, GTPR;
} usart_regs;
REGISTER_AT(usart_regs, SR, 0x00);
REGISTER_AT(usart_regs, DR, 0x04);
REGISTER_AT(usart_regs, BRR, 0x08);
REGISTER_AT(usart_regs, CR1, 0x0c);
REGISTER_AT(usart_regs, CR2, 0x10);
REGISTER_AT(usart_regs, CR3, 0x14);
REGISTER_AT(usart_regs, GTPR, 0x18);

enum {
    USART_CR1_RE = 1 << 2,
    USART_CR1_TE = 1 << 3,
    USART_CR1_UE = 1 << 13,
    USART_CR3_DMAR = 1 << 6,
    USART_CR3_DMAT = 1 << 7
};

typedef struct {
    reg CR, NDTR, PAR, M0AR, M1AR, FCR;
} dma_stream_regs;
REGISTER_AT(dma_stream_regs, CR, 0x00);
REGISTER_AT(dma_stream_regs, NDTR, 0x04);
REGISTER_AT(dma_stream_regs, PAR, 0x08);
REGISTER_AT(dma_stream_regs, M0AR, 0x0c);
REGISTER_AT(dma_stream_regs, M1AR, 0x10);
REGISTER_AT(dma_stream_regs, FCR, 0x14);

typedef struct {
    reg LISR, HISR, LIFCR, HIFCR;
    dma_stream_regs stream[8];
} dma_regs;
REGISTER_AT(dma_regs, LISR, 0x00);
REGISTER_AT(dma_regs, HISR, 0x04);
REGISTER_AT(dma_regs, LIFCR, 0x08);
REGISTER_AT(dma_regs, HIFCR, 0x0c);
REGISTER_AT(dma_regs, stream[0].CR, 0x10);
REGISTER_AT(dma_regs, stream[5].CR, 0x88);
REGISTER_AT(dma_regs, stream[6].M0AR, 0xac);

enum {
    DMA_CR_EN = 1 << 0,
    DMA_CR_HTIE = 1 << 3,
    DMA_CR_TCIE = 1 << 4,
    DMA_CR_TO_PERIPHERAL = 1 << 6,
    DMA_CR_CIRC = 1 << 8,
    DMA_CR_MINC = 1 << 10,
    DMA_CR_PSIZE_16 = 1 << 11,
    DMA_CR_MSIZE_16 = 1 << 13,
    DMA_CR_CHSEL_POS = 25,
    DMA_LISR_HTIF0 = 1 << 4,
    DMA_LISR_TCIF0 = 1 << 5,
    DMA_FLAGS_STREAM0 = 0x3d,        /* in LISR and LIFCR */
    DMA_FLAGS_STREAM6 = 0x3d << 16   /* in HISR and HIFCR */
};

typedef struct {
    reg KR, PR, RLR, SR;
} iwdg_regs;
REGISTER_AT(iwdg_regs, KR, 0x00);
REGISTER_AT(iwdg_regs, PR, 0x04);
REGISTER_AT(iwdg_regs, RLR, 0x08);
REGISTER_AT(iwdg_regs, SR, 0x0c);

enum { IWDG_KR_START = 0xcccc, IWDG_KR_UNLOCK = 0x5555, IWDG_KR_FEED = 0xaaaa };

typedef struct {
    reg IDCODE, CR, APB1_FZ, APB2_FZ;
} dbgmcu_regs;
REGISTER_AT(dbgmcu_regs, IDCODE, 0x00);
REGISTER_AT(dbgmcu_regs, CR, 0x04);
REGISTER_AT(dbgmcu_regs, APB1_FZ, 0x08);
REGISTER_AT(dbgmcu_regs, APB2_FZ, 0x0c);

enum {
    DBGMCU_CR_DBG_SLEEP = 1 << 0,
    DBGMCU_APB1_FZ_TIM2 = 1 << 0,
    DBGMCU_APB1_FZ_IWDG = 1 << 12,
    DBGMCU_APB2_FZ_TIM1 = 1 << 0,
    DBGMCU_APB2_FZ_TIM8 = 1 << 1
};

typedef struct {
    reg CPUID, ICSR, VTOR, AIRCR, SCR, CCR;
    volatile uint8_t SHPR[12];
    reg SHCSR, CFSR, HFSR, DFSR, MMFAR, BFAR, AFSR, unused[18];
    reg CPACR;
} scb_regs;
REGISTER_AT(scb_regs, CPUID, 0x00);
REGISTER_AT(scb_regs, ICSR, 0x04);
REGISTER_AT(scb_regs, VTOR, 0x08);
REGISTER_AT(scb_regs, AIRCR, 0x0c);
REGISTER_AT(scb_regs, SCR, 0x10);
REGISTER_AT(scb_regs, CCR, 0x14);
REGISTER_AT(scb_regs, SHPR, 0x18);
REGISTER_AT(scb_regs, SHCSR, 0x24);
REGISTER_AT(scb_regs, CFSR, 0x28);
REGISTER_AT(scb_regs, HFSR, 0x2c);
REGISTER_AT(scb_regs, BFAR, 0x38);
REGISTER_AT(scb_regs, CPACR, 0x88);

enum {
    SCB_ICSR_VECTACTIVE = 0x1ff,
    SCB_ICSR_PENDSVSET = 1 << 28,
    SCB_SHPR_PENDSV = 10,
    SCB_SHPR_SYSTICK = 11,
    SCB_CPACR_FPU = 0xf << 20
};

typedef struct {
    reg CTRL, LOAD, VAL, CALIB;
} systick_regs;
REGISTER_AT(systick_regs, CTRL, 0x00);
REGISTER_AT(systick_regs, LOAD, 0x04);
REGISTER_AT(systick_regs, VAL, 0x08);
REGISTER_AT(systick_regs, CALIB, 0x0c);

enum { SYSTICK_CTRL_ENABLE = 1 << 0, SYSTICK_CTRL_TICKINT = 1 << 1, SYSTICK_CTRL_CORE_CLOCK = 1 << 2 };

typedef struct {
    reg ISER[8], unused0[24], ICER[8], unused1[24], ISPR[8], unused2[24], ICPR[8], unused3[24], IABR[8], unused4[56];
    volatile uint8_t IPR[240];
} nvic_regs;
REGISTER_AT(nvic_regs, ISER, 0x000);
REGISTER_AT(nvic_regs, ICER, 0x080);
REGISTER_AT(nvic_regs, ISPR, 0x100);
REGISTER_AT(nvic_regs, ICPR, 0x180);
REGISTER_AT(nvic_regs, IABR, 0x200);
REGISTER_AT(nvic_regs, IPR, 0x300);

typedef struct {
    reg CTRL, CYCCNT;
} dwt_regs;
REGISTER_AT(dwt_regs, CTRL, 0x00);
REGISTER_AT(dwt_regs, CYCCNT, 0x04);

enum { DWT_CTRL_CYCCNTENA = 1 << 0, DEMCR_TRCENA = 1 << 24 };

#define RCC ((rcc_regs *)0x40023800u)
#define PWR ((pwr_regs *)0x40007000u)
#define FLASH ((flash_regs *)0x40023c00u)
#define GPIOA ((gpio_regs *)0x40020000u)
#define GPIOB ((gpio_regs *)0x40020400u)
#define GPIOC ((gpio_regs *)0x40020800u)
#define TIM2 ((tim_regs *)0x40000000u)
#define TIM1 ((tim_regs *)0x40010000u)
#define TIM8 ((tim_regs *)0x40010400u)
#define ADC1 ((adc_regs *)0x40012000u)
#define ADC_COMMON ((adc_common_regs *)0x40012300u)
#define DAC ((dac_regs *)0x40007400u)
#define USART2 ((usart_regs *)0x40004400u)
#define BACKUP 0x40024000u /* RAM of BACKUP_BYTES */
#define DMA1 ((dma_regs *)0x40026000u)
#define DMA2 ((dma_regs *)0x40026400u)
#define IWDG ((iwdg_regs *)0x40003000u)
#define DBGMCU ((dbgmcu_regs *)0xe0042000u)
#define SYSTICK ((systick_regs *)0xe000e010u)
#define SCB ((scb_regs *)0xe000ed00u)
#define NVIC ((nvic_regs *)0xe000e100u)
#define DWT ((dwt_regs *)0xe0001000u)
#define DEMCR (*(reg *)0xe000edfcu)

enum { BACKUP_BYTES = 4096 };

enum { ADC_IRQ = 18, TIM1_BRK_IRQ = 24, TIM8_BRK_IRQ = 43, DMA2_STREAM0_IRQ = 56, INTERRUPTS = 97 };

/* The fast interrupt and all interrupts that can trip it share one priority, so that none preempts another. */
enum { PRIORITY_FAST = 0x00, PRIORITY_SLOW = 0x20 };

/* Update the longest duration with the time since begin. */
static inline void note_cycles(uint32_t *worst, uint32_t begin)
{
    const uint32_t cycles = DWT->CYCCNT - begin;
    *worst = cycles > *worst ? cycles : *worst;
}

static inline void nvic_enable(uint32_t line)
{
    NVIC->IPR[line] = PRIORITY_FAST;
    NVIC->ISER[line / 32u] |= 1u << line % 32u;
}

#endif
