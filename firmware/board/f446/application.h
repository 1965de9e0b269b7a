/* What each build gives to the loop, the guard and the line that both share. */
#ifndef APPLICATION_H
#define APPLICATION_H

#include <stdbool.h>
#include <stdint.h>

#include "an_button.h"
#include "an_link.h"
#include "an_supervisor.h"

/* Reads a table and rests; faults are those found before. */
void application_boot(const uint8_t *table, uint32_t length, uint32_t faults);

/* Converters and timers: prepared, set going, halted with every output safe. */
void application_init(void);
void application_start_sampling(void);
void application_stop_sampling(void);

/* Samples have stopped to come: gets them going again. */
void application_revive(void);

/* One pass of the main loop. */
void application_poll(void);

/* A fault: found by the main loop, or in an interrupt of PRIORITY_FAST, where the outputs are safe on return. */
void application_trip(uint32_t fault);
void application_trip_now(uint32_t fault);

/* Faults that a look from outside finds in what the interrupts rely on. */
uint32_t application_check(void);

/* What a press of the button orders. */
void application_obey(an_order order);

const an_supervisor *application_supervisor(void);
void application_link(an_link *link);
void application_record(float *record);

/* Longest fast and slow interrupt so far, cycles. */
uint32_t application_fast_cycles(void);
uint32_t application_slow_cycles(void);

/* Moves with every sample; moves with every window; moves with every answer to a window. */
uint32_t application_samples(void);
uint32_t application_windows(void);
uint32_t application_answers(void);

#endif
