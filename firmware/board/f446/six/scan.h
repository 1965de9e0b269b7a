/* Six sensors, converted one after the other at every trigger and carried to memory by DMA. */
#ifndef SCAN_H
#define SCAN_H

#include <stdbool.h>
#include <stdint.h>

enum { SCAN_CHANNELS = 6 };

/* Written by the DMA controller, before each call of the handler. */
extern uint16_t scan_samples[SCAN_CHANNELS];

/* DMA2_Stream0_IRQHandler follows each complete scan. */
void scan_init(void);

/* Sets a scan going anew that has stopped: after an overrun ADC and DMA take no more triggers (RM0390, ADC, "Using the
 * DMA"). */
void scan_revive(void);

/* To be called there; false when samples were lost. */
bool scan_complete(void);

#endif
