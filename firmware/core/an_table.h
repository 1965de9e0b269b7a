/* Reader for the mode table exported from a design: little-endian, versioned, with a CRC-32 at the end.
 *
 * The table is read in place, byte by byte, without assumptions about alignment or byte order. Once an_table_open has
 * accepted it, every value is finite and in range.
 */
#ifndef AN_TABLE_H
#define AN_TABLE_H

#include "an_mode.h"
#include "an_types.h"
#include "an_wire.h"

typedef struct {
    const uint8_t *data;
    uint32_t length;
    uint32_t mode_count;
    uint32_t shape_count;
    uint32_t actuator_count;
    uint32_t sensor_count;
    uint32_t target;
    uint32_t flags;
    float sample_rate_hz;
    float sensor_volts;
} an_table;

typedef struct {
    float frequency_hz;
    float tau_s;
    float drive_limit;
    float metres; /* at full scale of a sensor, 0: unknown */
    uint32_t flags;
    uint32_t pattern_count;
} an_shape_head;

/* Open a table. Returns AN_TABLE_OK or the reason for rejecting it; length may exceed the table (the rest of its
 * sector). */
uint32_t an_table_open(an_table *table, const uint8_t *data, uint32_t length);

/* Read a mode of an accepted table and return its flags; index below mode_count. */
uint32_t an_table_mode(const an_table *table, uint32_t index, an_mode *mode);

/* Read the header of a shape of an accepted table; index below shape_count. */
void an_table_shape(const an_table *table, uint32_t index, an_shape_head *head);

/* One element of a shape's transfer matrix, sensor over actuator. */
an_complex an_table_matrix(const an_table *table, uint32_t index, uint32_t sensor, uint32_t actuator);

/* Target of one sensor in a pattern. */
an_complex an_table_target(const an_table *table, uint32_t index, uint32_t pattern, uint32_t sensor);

#endif
