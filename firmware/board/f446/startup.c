/* Start-up from reset to main, and the handler of unexpected interrupts. */
#include "board.h"
#include "registers.h"

extern uint32_t data_start[], data_end[], bss_start[], bss_end[], stack_end[], stack_painted[], stack_top[];
extern const uint32_t data_load[];

enum { FRAME_LR = 5, FRAME_PC = 6, FRAME_WORDS = 8 };

#define STACK_PAINT 0xa5a5a5a5u

void Reset_Handler(void);
void Unexpected_Handler(void);
void unexpected(const uint32_t *frame);
int main(void);

/* Each build defines the handlers it uses. */
#define UNEXPECTED __attribute__((weak, alias("Unexpected_Handler")))
void PendSV_Handler(void) UNEXPECTED;
void SysTick_Handler(void) UNEXPECTED;
void ADC_IRQHandler(void) UNEXPECTED;
void TIM1_BRK_TIM9_IRQHandler(void) UNEXPECTED;
void TIM8_BRK_TIM12_IRQHandler(void) UNEXPECTED;
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
            [1 ... 5] = Unexpected_Handler, /* NMI (crystal failure), hard, memory, bus and usage fault */
            [10] = Unexpected_Handler,      /* SVC */
            [11] = Unexpected_Handler,      /* debug monitor */
            [13] = PendSV_Handler,
            [14] = SysTick_Handler,
        },
    .interrupt =
        {
            [0 ... ADC_IRQ - 1] = Unexpected_Handler,
            [ADC_IRQ] = ADC_IRQHandler,
            [ADC_IRQ + 1 ... TIM1_BRK_IRQ - 1] = Unexpected_Handler,
            [TIM1_BRK_IRQ] = TIM1_BRK_TIM9_IRQHandler,
            [TIM1_BRK_IRQ + 1 ... TIM8_BRK_IRQ - 1] = Unexpected_Handler,
            [TIM8_BRK_IRQ] = TIM8_BRK_TIM12_IRQHandler,
            [TIM8_BRK_IRQ + 1 ... DMA2_STREAM0_IRQ - 1] = Unexpected_Handler,
            [DMA2_STREAM0_IRQ] = DMA2_Stream0_IRQHandler,
            [DMA2_STREAM0_IRQ + 1 ... INTERRUPTS - 1] = Unexpected_Handler,
        },
};

/* Set the outputs to rest, record where the exception occurred, and wait for the watchdog to reset the chip; the fault
 * is reported after the reset. The stack frame is read only if it lies within the stack. */
__attribute__((used)) void unexpected(const uint32_t *frame)
{
    board_outputs_safe();
    const uint32_t exception = SCB->ICSR & SCB_ICSR_VECTACTIVE;
    const bool sound = frame >= stack_end && frame + FRAME_WORDS <= stack_top;
    record_exception(exception, sound ? frame[FRAME_PC] : 0u, sound ? frame[FRAME_LR] : 0u, SCB->CFSR);
    for (;;) {
    }
}

uint32_t stack_unused(void)
{
    const volatile uint32_t *at = stack_end;
    while (*at == STACK_PAINT) {
        at++;
    }
    return (uint32_t)((uintptr_t)at - (uintptr_t)stack_end);
}

__attribute__((naked)) void Unexpected_Handler(void)
{
    __asm volatile("mrs r0, msp\n b unexpected");
}

/* Enable the floating-point unit before the first floating-point instruction, and the watchdog before anything that
 * could hang. */
void Reset_Handler(void)
{
    SCB->CPACR |= SCB_CPACR_FPU;
    __asm volatile("dsb\n isb" ::: "memory");
    SCB->VTOR = (uint32_t)(uintptr_t)&vectors;
    watchdog_lengthen();
    const uint32_t *from = data_load;
    for (uint32_t *to = data_start; to != data_end; to++) {
        *to = *from++;
    }
    for (uint32_t *to = bss_start; to != bss_end; to++) {
        *to = 0u;
    }
    for (volatile uint32_t *to = stack_end; to != stack_painted; to++) {
        *to = STACK_PAINT;
    }
    main();
    Unexpected_Handler();
}
