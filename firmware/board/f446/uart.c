#include "board.h"
#include "registers.h"

/* USART2 on PA2 and PA3; DMA1 stream 5 receives into a ring, stream 6 sends. */
enum { RECEIVE = 5, SEND = 6, CHANNEL = 4, BAUD = 921600 };

static uint8_t ring[UART_RECEIVE_ROOM];
static uint8_t outgoing[UART_SEND_MAX];
static uint32_t taken;

static uint32_t address_of(const volatile void *object)
{
    return (uint32_t)(uintptr_t)object;
}

void uart_init(void)
{
    dma_stream_regs *receive = &DMA1->stream[RECEIVE];
    GPIOA->AFRL |= 7u << 8 | 7u << 12;
    GPIOA->MODER |= (uint32_t)GPIO_MODE_ALTERNATE << 4 | (uint32_t)GPIO_MODE_ALTERNATE << 6;
    USART2->BRR = (clock_apb1_hz() + BAUD / 2u) / BAUD; /* 45 MHz / 49: 0.4 % slow; 16 MHz / 17: 2.1 % fast */
    USART2->CR3 = USART_CR3_DMAR | USART_CR3_DMAT;
    USART2->CR1 = USART_CR1_RE | USART_CR1_TE | USART_CR1_UE;
    receive->PAR = address_of(&USART2->DR);
    receive->M0AR = address_of(ring);
    receive->NDTR = UART_RECEIVE_ROOM;
    receive->CR = (uint32_t)CHANNEL << DMA_CR_CHSEL_POS | DMA_CR_MINC | DMA_CR_CIRC | DMA_CR_EN;
}

bool uart_send(const uint8_t *data, uint32_t length)
{
    dma_stream_regs *send = &DMA1->stream[SEND];
    if ((send->CR & DMA_CR_EN) != 0u || length == 0u || length > UART_SEND_MAX) {
        return false;
    }
    for (uint32_t i = 0u; i < length; i++) {
        outgoing[i] = data[i];
    }
    DMA1->HIFCR = DMA_FLAGS_STREAM6;
    send->PAR = address_of(&USART2->DR);
    send->M0AR = address_of(outgoing);
    send->NDTR = length;
    send->CR = (uint32_t)CHANNEL << DMA_CR_CHSEL_POS | DMA_CR_MINC | DMA_CR_TO_PERIPHERAL | DMA_CR_EN;
    return true;
}

uint32_t uart_receive(uint8_t *data, uint32_t room)
{
    uint32_t count = 0u;
    const uint32_t written = (UART_RECEIVE_ROOM - DMA1->stream[RECEIVE].NDTR) % UART_RECEIVE_ROOM;
    while (taken != written && count < room) {
        data[count++] = *(const volatile uint8_t *)&ring[taken];
        taken = (taken + 1u) % UART_RECEIVE_ROOM;
    }
    return count;
}
