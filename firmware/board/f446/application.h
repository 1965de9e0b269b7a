/* Interface of each build to the main loop, the guard and the serial line common to both. */
#ifndef APPLICATION_H
#define APPLICATION_H

#include <stdbool.h>
#include <stdint.h>

#include "an_application.h"
#include "an_capture.h"

/* State of the build's application, and its interface. */
an_application *application_state(void);
extern const an_build *const application_build;

/* Read a table and start at rest; faults were found before. */
void application_boot(const uint8_t *table, uint32_t length, uint32_t faults);

/* Converters and timers: initialise, start, and stop with every output in its safe state. */
void application_init(void);
void application_start_sampling(void);
void application_stop_sampling(void);

/* Restart sampling after it has stalled. */
void application_revive(void);

/* Service this build's outputs, once per main-loop pass. */
void application_serve_outputs(void);

/* Report a fault from an interrupt of PRIORITY_FAST; the outputs are in their safe state on return. */
void application_trip(uint32_t fault);

/* Check the state that the interrupts rely on. Returns faults. */
uint32_t application_check(void);

/* Start, as requested by the button. */
void application_start(void);

an_record application_record(void);

/* Prepare a capture for this build's channels; the fast interrupt fills it. */
void application_capture(an_capture *capture);

/* Longest slow interrupt so far, in cycles. */
uint32_t application_slow_cycles(void);

/* Counters that change with every sample, every window, and every answer to a window. */
uint32_t application_samples(void);
uint32_t application_windows(void);
uint32_t application_answers(void);

#endif
