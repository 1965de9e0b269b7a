#include "an_bytes.h"
#include "board.h"
#include "registers.h"

enum { MAGIC = 0x41524543 };

typedef struct {
    uint32_t magic;
    board_record record;
} kept;

/* Not initialised by start-up; undefined after power-on. */
__attribute__((section(".noinit"))) static kept memory;

bool record_boot(void)
{
    const bool watchdog = (RCC->CSR & RCC_CSR_IWDGRSTF) != 0u;
    const bool power = (RCC->CSR & RCC_CSR_PORRSTF) != 0u;
    RCC->CSR |= RCC_CSR_RMVF;
    if (power || memory.magic != MAGIC) {
        an_clear(&memory, sizeof memory);
        memory.magic = MAGIC;
    }
    memory.record.watchdog_resets = watchdog ? memory.record.watchdog_resets + 1u : 0u;
    return watchdog;
}

void record_healthy(void)
{
    memory.record.watchdog_resets = 0u;
}

void record_exception(uint32_t exception, uint32_t pc, uint32_t lr, uint32_t cfsr)
{
    memory.record.exception = exception;
    memory.record.pc = pc;
    memory.record.lr = lr;
    memory.record.cfsr = cfsr;
}

const board_record *record_get(void)
{
    return &memory.record;
}
