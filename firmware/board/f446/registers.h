/* The registers of the STM32F446 that this firmware touches (RM0390; PM0214 for those of the core). */
#ifndef REGISTERS_H
#define REGISTERS_H

#include <stddef.h>
#include <stdint.h>

typedef volatile uint32_t reg;

#define AT(type, member, offset) _Static_assert(offsetof(type, member) == (offset), #type "." #member)

typedef struct {
    reg CR, PLLCFGR, CFGR, CIR, AHB1RSTR, AHB2RSTR, AHB3RSTR, unused0, APB1RSTR, APB2RSTR, unused1[2];
    reg AHB1ENR, AHB2ENR, AHB3ENR, unused2, APB1ENR, APB2ENR, unused3[10], BDCR, CSR;
} rcc_regs;
AT(rcc_regs, AHB1ENR, 0x30);
AT(rcc_regs, APB1ENR, 0x40);
AT(rcc_regs, CSR, 0x74);

typedef struct {
    reg CR, CSR;
} pwr_regs;
AT(pwr_regs, CSR, 0x04);

typedef struct {
    reg ACR, KEYR, OPTKEYR, SR, CR, OPTCR;
} flash_regs;
AT(flash_regs, CR, 0x10);

typedef struct {
    reg MODER, OTYPER, OSPEEDR, PUPDR, IDR, ODR, BSRR, LCKR, AFRL, AFRH;
} gpio_regs;
AT(gpio_regs, IDR, 0x10);
AT(gpio_regs, AFRH, 0x24);

typedef struct {
    reg CR1, CR2, SMCR, DIER, SR, EGR, CCMR1, CCMR2, CCER, CNT, PSC, ARR, RCR, CCR1, CCR2, CCR3, CCR4, BDTR;
} tim_regs;
AT(tim_regs, ARR, 0x2c);
AT(tim_regs, CCR1, 0x34);
AT(tim_regs, BDTR, 0x44);

typedef struct {
    reg SR, CR1, CR2, SMPR1, SMPR2, JOFR[4], HTR, LTR, SQR1, SQR2, SQR3, JSQR, JDR[4], DR;
} adc_regs;
AT(adc_regs, SQR3, 0x34);
AT(adc_regs, DR, 0x4c);

typedef struct {
    reg CSR, CCR, CDR;
} adc_common_regs;
AT(adc_common_regs, CCR, 0x04);

typedef struct {
    reg CR, SWTRIGR, DHR12R1, DHR12L1, DHR8R1, DHR12R2, DHR12L2, DHR8R2, DHR12RD, DHR12LD, DHR8RD, DOR1, DOR2, SR;
} dac_regs;
AT(dac_regs, DHR12RD, 0x20);
AT(dac_regs, SR, 0x34);

typedef struct {
    reg SR, DR, BRR, CR1, CR2, CR3, GTPR;
} usart_regs;
AT(usart_regs, CR3, 0x14);

typedef struct {
    reg CR, NDTR, PAR, M0AR, M1AR, FCR;
} dma_stream_regs;

typedef struct {
    reg LISR, HISR, LIFCR, HIFCR;
    dma_stream_regs stream[8];
} dma_regs;
AT(dma_regs, stream[5].CR, 0x88);
AT(dma_regs, stream[6].M0AR, 0xac);

typedef struct {
    reg KR, PR, RLR, SR;
} iwdg_regs;
AT(iwdg_regs, SR, 0x0c);

typedef struct {
    reg CPUID, ICSR, VTOR, AIRCR, SCR, CCR;
    volatile uint8_t SHPR[12];
    reg unused[25];
    reg CPACR;
} scb_regs;
AT(scb_regs, SHPR, 0x18);
AT(scb_regs, CPACR, 0x88);

typedef struct {
    reg ISER[8], unused0[24], ICER[8], unused1[24], ISPR[8], unused2[24], ICPR[8], unused3[24], IABR[8], unused4[56];
    volatile uint8_t IPR[240];
} nvic_regs;
AT(nvic_regs, IPR, 0x300);

typedef struct {
    reg CTRL, CYCCNT;
} dwt_regs;

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
#define ADC2 ((adc_regs *)0x40012100u)
#define ADC3 ((adc_regs *)0x40012200u)
#define ADC_COMMON ((adc_common_regs *)0x40012300u)
#define DAC ((dac_regs *)0x40007400u)
#define USART2 ((usart_regs *)0x40004400u)
#define DMA1 ((dma_regs *)0x40026000u)
#define DMA2 ((dma_regs *)0x40026400u)
#define IWDG ((iwdg_regs *)0x40003000u)
#define SCB ((scb_regs *)0xe000ed00u)
#define NVIC ((nvic_regs *)0xe000e100u)
#define DWT ((dwt_regs *)0xe0001000u)
#define DEMCR (*(reg *)0xe000edfcu)

enum { ADC_IRQ = 18, DMA2_STREAM0_IRQ = 56, INTERRUPTS = 97, PENDSV_PRIORITY_BYTE = 10 };

#define BIT(n) (1u << (n))

#endif
