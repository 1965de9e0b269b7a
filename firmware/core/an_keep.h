/* Measured values that survive a reset in the board's backup memory. A CRC-32 protects them, and they are valid only
 * for the table and build they were measured with.
 */
#ifndef AN_KEEP_H
#define AN_KEEP_H

#include "an_table.h"
#include "an_types.h"

enum { AN_KEEP_VALUES_MAX = 300, AN_KEEP_HEADER_BYTES = 16, AN_KEEP_BYTES = AN_KEEP_HEADER_BYTES + AN_KEEP_VALUES_MAX };

/* Save at most AN_KEEP_VALUES_MAX bytes of values to memory (AN_KEEP_BYTES). */
void an_keep_write(uint8_t *memory, uint32_t build, const an_table *table, const uint8_t *values, uint32_t length);

/* Copy saved values to values and set state. Returns their length, or 0 unless state is AN_KEEP_READ. */
uint32_t an_keep_read(const uint8_t *memory, uint32_t build, const an_table *table, uint8_t *values, an_keep_state *state);

#endif
