/* Scan of six sensors, converted one after another at every trigger and transferred to memory by DMA. */
#ifndef SCAN_H
#define SCAN_H

#include <stdbool.h>
#include <stdint.h>

enum { SCAN_CHANNELS = 6 };

/* Prepare the scan. DMA2_Stream0_IRQHandler runs after each complete scan. */
void scan_init(void);

/* Restart a stalled scan: after an overrun, ADC and DMA ignore triggers (RM0390, ADC, "Using the DMA"). */
void scan_revive(void);

/* Return the samples of the last scan, which are valid until the scan after next begins; call from that handler.
 * Returns false if samples were lost or a scan was missed. */
bool scan_complete(const uint16_t **samples);

#endif
