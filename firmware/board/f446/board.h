/* Board support common to both builds, for a NUCLEO-F446RE or a compatible board. */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stdint.h>

/* Start the clock: 180 MHz from the 8 MHz crystal or clock input, through the PLL and in overdrive mode. Returns false
 * if any part failed to start. The chip then runs from its internal oscillator, through the PLL (1 %) or, if that also
 * fails, at 16 MHz; this suffices to report the fault. */
bool clock_start(void);

/* Present frequencies of the core and of the serial line's bus. */
uint32_t clock_core_hz(void);
uint32_t clock_apb1_hz(void);

/* Start DWT->CYCCNT, which counts core cycles. */
void clock_count_cycles(void);

/* True while the supply is below 2.9 V. */
bool clock_supply_is_low(void);

/* Stop watchdog and timers while a debugger halts the core, and keep the debugger connected during sleep. */
void debug_init(void);

/* Set every output to its safe state, from any context; each build defines its own. */
void board_outputs_safe(void);

/* Number of stack bytes never used. */
uint32_t stack_unused(void);

/* Record that survives a reset, in RAM that start-up does not touch. */
typedef struct {
    uint32_t watchdog_resets; /* consecutive */
    uint32_t exception;       /* number of the last unexpected exception, 0: none */
    uint32_t pc;
    uint32_t lr;
    uint32_t cfsr;
} board_record;

enum { RECORD_RESETS_MAX = 3 }; /* consecutive watchdog resets after which the mode table is ignored */

/* Read the cause of the last reset, once; true if it was the watchdog. */
bool record_boot(void);

/* Reset the count of consecutive watchdog resets, after a period without trouble. */
void record_healthy(void);
void record_exception(uint32_t exception, uint32_t pc, uint32_t lr, uint32_t cfsr);
const board_record *record_get(void);

/* Enable the backup RAM, which keeps its contents through any reset and, while VBAT is supplied, without supply.
 * Returns NULL if there is none. */
uint8_t *backup_start(void);

/* Serial line: 921600 baud, eight bits, on the debugger's connector; DMA in both directions, never blocking. */
enum { UART_SEND_MAX = 256, UART_RECEIVE_ROOM = 1024 };
void uart_init(void);
bool uart_send(const uint8_t *data, uint32_t length); /* copies data; false if busy or too long */
uint32_t uart_receive(uint8_t *data, uint32_t room);

/* Start the independent watchdog: 12 ms (8.26 to 22.8 ms over the tolerance of its oscillator, 47 to 17 kHz). */
void watchdog_start(void);

/* Feed the watchdog if both counts have changed since it was last fed. Called from the main loop, so that fast
 * interrupt, slow interrupt and main loop must all be running. */
void watchdog_feed(uint32_t fast, uint32_t slow);

/* Extend the watchdog to 32 s for operations that stall the chip; watchdog_start shortens it again. */
void watchdog_lengthen(void);

/* State of the blue button, whose pin is low when pressed. */
bool button_pressed(void);

/* Flash sector of the mode table: address and size. */
const uint8_t *store_table(void);
uint32_t store_bytes(void);

/* Erase the sector and write a table. This stalls the chip for half a second, so outputs must be safe and interrupts
 * off. Returns false if the flash controller reports an error or the data does not read back. */
bool store_write(const uint8_t *data, uint32_t length);

#endif
