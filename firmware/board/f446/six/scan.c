#include "scan.h"

#include "registers.h"

enum { STREAM = 0, CLEAR = 0x3d, OVERRUN = 1 << 5 };

uint16_t scan_samples[SCAN_CHANNELS];

static void pins_analog(void)
{
    GPIOA->MODER |= 3u << 0 | 3u << 2 | 3u << 8; /* PA0, PA1, PA4: channels 0, 1, 4 */
    GPIOC->MODER |= 3u << 0 | 3u << 2 | 3u << 4; /* PC0 to PC2: channels 10 to 12 */
}

static void dma_init(void)
{
    dma_stream_regs *stream = &DMA2->stream[STREAM];
    stream->PAR = (uint32_t)(uintptr_t)&ADC1->DR;
    stream->M0AR = (uint32_t)(uintptr_t)scan_samples;
    stream->NDTR = SCAN_CHANNELS;
    /* Channel 0, half-words, memory address grows, circular, interrupt when complete. */
    stream->CR = 1u << 13 | 1u << 11 | BIT(10) | BIT(8) | BIT(4) | BIT(0);
}

static void adc_init(void)
{
    ADC_COMMON->CCR = 1u << 16;                 /* 90 MHz / 4 = 22.5 MHz: 1.2 us a channel */
    ADC1->SMPR1 = 1u | 1u << 3 | 1u << 6;       /* 15 cycles each */
    ADC1->SMPR2 = 1u | 1u << 3 | 1u << 12;
    ADC1->SQR1 = (SCAN_CHANNELS - 1u) << 20;
    ADC1->SQR3 = 1u << 5 | 4u << 10 | 10u << 15 | 11u << 20 | 12u << 25;
    ADC1->CR1 = BIT(8);                                           /* scan */
    ADC1->CR2 = BIT(0) | BIT(8) | BIT(9) | 14u << 24 | 1u << 28; /* on, DMA for ever, TIM8's update */
}

void scan_init(void)
{
    pins_analog();
    dma_init();
    adc_init();
    NVIC->IPR[DMA2_STREAM0_IRQ] = 0x00;
    SCB->SHPR[PENDSV_PRIORITY_BYTE] = 0x20;
    NVIC->ISER[DMA2_STREAM0_IRQ / 32] = BIT(DMA2_STREAM0_IRQ % 32);
}

bool scan_complete(void)
{
    const bool sound = (ADC1->SR & OVERRUN) == 0u;
    DMA2->LIFCR = CLEAR;
    if (!sound) {
        ADC1->SR = 0u;
    }
    return sound;
}
