/* Six sensors, converted one after the other at every trigger and carried to memory by DMA. */
#ifndef SCAN_H
#define SCAN_H

#include <stdbool.h>
#include <stdint.h>

enum { SCAN_CHANNELS = 6 };

/* DMA2_Stream0_IRQHandler follows each complete scan. */
void scan_init(void);

/* Sets a scan going anew that has stopped: after an overrun ADC and DMA take no more triggers (RM0390, ADC, "Using the
 * DMA"). */
void scan_revive(void);

/* To be called there: the samples of the last scan, valid until the one after the next begins. False when samples were lost, or
 * the handler was not called for a scan. */
bool scan_complete(const uint16_t **samples);

#endif
