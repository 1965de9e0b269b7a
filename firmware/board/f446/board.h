/* What both builds share of the board: a NUCLEO-F446RE or anything wired like it. */
#ifndef BOARD_H
#define BOARD_H

#include <stdbool.h>
#include <stdint.h>

/* 180 MHz from the 8 MHz crystal or clock input, by the PLL and in overdrive. False when any part did not start. */
bool clock_start(void);

/* Why the chip was reset last: true when it was the watchdog. Clears the record. */
bool clock_reset_by_watchdog(void);

/* DWT->CYCCNT counts core cycles from now on. */
void clock_count_cycles(void);

/* True while the supply is below 2.9 V. */
bool clock_supply_is_low(void);

/* Every output into its safe state, from any context; each build has its own. */
void board_outputs_safe(void);

/* 921600 baud, eight bits, on the connector of the debugger; both directions by DMA, never blocking. */
enum { UART_SEND_MAX = 256, UART_RECEIVE_ROOM = 1024 };
void uart_init(void);
bool uart_send(const uint8_t *data, uint32_t length); /* copied; false while the last is on its way, or too long */
uint32_t uart_receive(uint8_t *data, uint32_t room);

/* Independent watchdog, 12 ms (8.5 to 24 ms by its own oscillator's tolerance). */
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
