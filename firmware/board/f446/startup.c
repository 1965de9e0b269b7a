/* From reset to main, and what happens to an interrupt nobody expects. */
#include "board.h"
#include "registers.h"

extern uint32_t data_start[], data_end[], bss_start[], bss_end[], stack_top[];
extern const uint32_t data_load[];

void Reset_Handler(void);
void Unexpected_Handler(void);
int main(void);

/* Each build defines those it uses. */
#define UNEXPECTED __attribute__((weak, alias("Unexpected_Handler")))
void PendSV_Handler(void) UNEXPECTED;
void ADC_IRQHandler(void) UNEXPECTED;
void DMA2_Stream0_IRQHandler(void) UNEXPECTED;

typedef void (*vector)(void);

typedef struct {
    const uint32_t *stack;
    vector system[15];
    vector interrupt[INTERRUPTS];
} vector_table;

__attribute__((section(".vectors"), used)) static const vector_table vectors = {
    .stack = stack_top,
    .system =
        {
            [0] = Reset_Handler,
            [1 ... 5] = Unexpected_Handler, /* NMI (lost crystal), hard, memory, bus, usage fault */
            [10] = Unexpected_Handler,      /* SVC */
            [11] = Unexpected_Handler,      /* debug monitor */
            [13] = PendSV_Handler,
            [14] = Unexpected_Handler, /* SysTick */
        },
    .interrupt =
        {
            [0 ... ADC_IRQ - 1] = Unexpected_Handler,
            [ADC_IRQ] = ADC_IRQHandler,
            [ADC_IRQ + 1 ... DMA2_STREAM0_IRQ - 1] = Unexpected_Handler,
            [DMA2_STREAM0_IRQ] = DMA2_Stream0_IRQHandler,
            [DMA2_STREAM0_IRQ + 1 ... INTERRUPTS - 1] = Unexpected_Handler,
        },
};

/* Outputs to rest, then silence: the watchdog resets the chip and the fault is reported after that. */
void Unexpected_Handler(void)
{
    board_outputs_safe();
    for (;;) {
    }
}

void Reset_Handler(void)
{
    SCB->CPACR |= 0xfu << 20; /* the floating-point unit, before the first floating-point instruction */
    __asm volatile("dsb\n isb" ::: "memory");
    const uint32_t *from = data_load;
    for (uint32_t *to = data_start; to != data_end; to++) {
        *to = *from++;
    }
    for (uint32_t *to = bss_start; to != bss_end; to++) {
        *to = 0u;
    }
    main();
    Unexpected_Handler();
}
