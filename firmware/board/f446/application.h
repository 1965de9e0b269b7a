/* What each build gives to the loop, the guard and the line that both share. */
#ifndef APPLICATION_H
#define APPLICATION_H

#include <stdbool.h>
#include <stdint.h>

#include "an_application.h"
#include "an_capture.h"

/* Its state, and what it gives to what both builds share. */
an_application *application_state(void);
extern const an_build *const application_build;

/* Reads a table and rests; faults are those found before. */
void application_boot(const uint8_t *table, uint32_t length, uint32_t faults);

/* Converters and timers: prepared, set going, halted with every output safe. */
void application_init(void);
void application_start_sampling(void);
void application_stop_sampling(void);

/* Samples have stopped to come: gets them going again. */
void application_revive(void);

/* What a pass of the main loop has to do for this build's outputs. */
void application_serve_outputs(void);

/* A fault found in an interrupt of PRIORITY_FAST: the outputs are safe on return. */
void application_trip(uint32_t fault);

/* Faults that a look from outside finds in what the interrupts rely on. */
uint32_t application_check(void);

/* As the button orders it. */
void application_start(void);

void application_record(float *record);

/* What the converters of so many channels see and are told goes into it. */
void application_capture(an_capture *capture);

/* Longest slow interrupt so far, cycles. */
uint32_t application_slow_cycles(void);

/* Moves with every sample; moves with every window; moves with every answer to a window. */
uint32_t application_samples(void);
uint32_t application_windows(void);
uint32_t application_answers(void);

#endif
