#include "board.h"
#include "registers.h"

/* USART2 on PA2 and PA3; DMA1 stream 5 receives into a ring, stream 6 sends. */
enum { RECEIVE = 5, SEND = 6, CHANNEL = 4, CLEAR_SEND = 0x3d << 16 };

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
    GPIOA->MODER |= 2u << 4 | 2u << 6;
    USART2->BRR = 49u; /* 45 MHz / 921600, 0.4 % slow */
    USART2->CR3 = BIT(6) | BIT(7);
    USART2->CR1 = BIT(2) | BIT(3) | BIT(13);
    receive->PAR = address_of(&USART2->DR);
    receive->M0AR = address_of(ring);
    receive->NDTR = UART_RECEIVE_ROOM;
    receive->CR = (uint32_t)CHANNEL << 25 | BIT(10) | BIT(8) | BIT(0);
}

bool uart_send(const uint8_t *data, uint32_t length)
{
    dma_stream_regs *send = &DMA1->stream[SEND];
    if ((send->CR & BIT(0)) != 0u || length == 0u || length > UART_SEND_MAX) {
        return false;
    }
    for (uint32_t i = 0u; i < length; i++) {
        outgoing[i] = data[i];
    }
    DMA1->HIFCR = CLEAR_SEND;
    send->PAR = address_of(&USART2->DR);
    send->M0AR = address_of(outgoing);
    send->NDTR = length;
    send->CR = (uint32_t)CHANNEL << 25 | BIT(10) | 1u << 6 | BIT(0);
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
