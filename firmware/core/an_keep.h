/* Values that outlive a reset, in memory that the board keeps: sealed by a CRC-32 and bound to the table and the build that
 * they were measured with.
 */
#ifndef AN_KEEP_H
#define AN_KEEP_H

#include "an_table.h"
#include "an_types.h"

enum { AN_KEEP_VALUES_MAX = 300, AN_KEEP_HEADER_BYTES = 16, AN_KEEP_BYTES = AN_KEEP_HEADER_BYTES + AN_KEEP_VALUES_MAX };

typedef enum {
    AN_KEEP_NONE,    /* the board has no such memory */
    AN_KEEP_EMPTY,   /* nothing sound in it, as after a loss of power */
    AN_KEEP_REFUSED, /* what is there was measured with another table or build */
    AN_KEEP_READ,    /* what was measured before the reset is in use */
    AN_KEEP_WRITTEN  /* what was measured since is kept */
} an_keep_state;

/* Values of at most AN_KEEP_VALUES_MAX bytes into memory of AN_KEEP_BYTES. */
void an_keep_write(uint8_t *memory, uint32_t build, const an_table *table, const uint8_t *values, uint32_t length);

/* The length of the values, which then stand in values, and the state; 0 unless AN_KEEP_READ. */
uint32_t an_keep_read(const uint8_t *memory, uint32_t build, const an_table *table, uint8_t *values, an_keep_state *state);

#endif
