/* A look 25 000 times a second, by an interrupt that depends on nothing but the core's clock: do samples still come, is
 * the supply still there? Without the PLL it comes as much later as the clock is slower: at 16 MHz the interrupts would leave
 * the main loop no time. */
#ifndef GUARD_H
#define GUARD_H

#include <stdbool.h>
#include <stdint.h>

enum { GUARD_RATE_HZ = 25000, GUARD_CYCLES = 7200, GUARD_LATER = 400 /* cycles */ };

/* Begins; sampling must be under way. */
void guard_start(void);

/* The chip will do nothing for a while. */
void guard_stop(void);

/* True when samples had stopped to come; forgets it. */
bool guard_found_standstill(void);

/* Looks so far. */
uint32_t guard_count(void);

#endif
