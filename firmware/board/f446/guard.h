/* Guard: a check of sampling and supply 25 000 times per second, in an interrupt that depends only on the core clock.
 * Without the PLL its rate falls with the clock, because at 16 MHz the full rate would leave the main loop no time. */
#ifndef GUARD_H
#define GUARD_H

#include <stdbool.h>
#include <stdint.h>

enum { GUARD_RATE_HZ = 25000, GUARD_CYCLES = 7200, GUARD_LATER = 400 /* cycles */ };

/* Start the guard; sampling must already run. */
void guard_start(void);

/* Stop the guard before an operation that stalls the chip. */
void guard_stop(void);

/* True if sampling had stalled since the last call. */
bool guard_found_standstill(void);

/* Number of checks so far. */
uint32_t guard_count(void);

#endif
