/* What both builds share of the board: a NUCLEO-F446RE or anything wired like it. */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stdint.h>

/* 180 MHz from the 8 MHz crystal or clock input, by the PLL and in overdrive. False when any part did not start: the chip
 * then runs from its own oscillator, by the PLL (1 %) or, when that fails too, at 16 MHz; enough to tell what is wrong. */
bool clock_start(void);

/* Of the core, and of the bus that the serial line is on, as they are now. */
uint32_t clock_core_hz(void);
uint32_t clock_apb1_hz(void);

/* DWT->CYCCNT counts core cycles from now on. */
void clock_count_cycles(void);

/* True while the supply is below 2.9 V. */
bool clock_supply_is_low(void);

/* A halted core stops watchdog and timers, and a debugger reaches it while it sleeps. */
void debug_init(void);

/* Every output into its safe state, from any context; each build has its own. */
void board_outputs_safe(void);

/* Bytes at the stack's end that were never written. */
uint32_t stack_unused(void);

/* What outlives a reset, in RAM that start-up leaves alone. */
typedef struct {
    uint32_t watchdog_resets; /* in a row */
    uint32_t exception;       /* number of the last unexpected one, 0: none */
    uint32_t pc;
    uint32_t lr;
    uint32_t cfsr;
} board_record;

enum { RECORD_RESETS_MAX = 3 }; /* in a row, after which the mode table is left alone */

/* Reads why the chip was reset last, once; true when it was the watchdog. */
bool record_boot(void);

/* The chip has been well for a while: the next watchdog reset is the first. */
void record_healthy(void);
void record_exception(uint32_t exception, uint32_t pc, uint32_t lr, uint32_t cfsr);
const board_record *record_get(void);

/* RAM that keeps what is in it through any reset, and without supply as long as VBAT has one; NULL when there is none. */
uint8_t *backup_start(void);

/* 921600 baud, eight bits, on the connector of the debugger; both directions by DMA, never blocking. */
enum { UART_SEND_MAX = 256, UART_RECEIVE_ROOM = 1024 };
void uart_init(void);
bool uart_send(const uint8_t *data, uint32_t length); /* copied; false while the last is on its way, or too long */
uint32_t uart_receive(uint8_t *data, uint32_t room);

/* Independent watchdog, 12 ms (8.26 to 22.8 ms by its own oscillator's tolerance, 47 to 17 kHz). */
void watchdog_start(void);

/* Feeds it when both counts have moved since it was fed last; called by the main loop, so that all three must live. */
void watchdog_feed(uint32_t fast, uint32_t slow);

/* 32 s, for what stalls the chip; watchdog_start shortens it again. */
void watchdog_lengthen(void);

/* The blue button, low when pressed. */
bool button_pressed(void);

/* The mode table's flash sector. */
const uint8_t *store_table(void);
uint32_t store_bytes(void);

/* Erases the sector and writes a table there: half a second in which the chip does nothing else, so outputs must
 * be safe and interrupts off. False when the controller refused or what was written does not read back. */
bool store_write(const uint8_t *data, uint32_t length);

#endif
