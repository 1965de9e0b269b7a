/* Reader of the mode table that the design computes: little-endian, versioned, CRC-32 behind.
 *
 * A table is read where it lies, byte by byte: no alignment and no byte order is assumed. Once an_table_open has
 * accepted it, every value in it is finite and in range.
 */
#ifndef AN_TABLE_H
#define AN_TABLE_H

#include "an_mode.h"
#include "an_types.h"

enum {
    AN_TABLE_VERSION = 1,
    AN_CHANNELS = 6,
    AN_PATTERNS = 8,
    AN_TABLE_MODES = 16,
    AN_TABLE_SHAPES = 2,
    AN_NAME_BYTES = 8,
    AN_TABLE_HEADER_BYTES = 48,
    AN_TABLE_MODE_BYTES = 128,
    AN_TABLE_SHAPE_BYTES = 752,
    AN_TABLE_CRC_BYTES = 4,
    AN_TABLE_MAX_BYTES = AN_TABLE_HEADER_BYTES + AN_TABLE_MODES * AN_TABLE_MODE_BYTES +
                         AN_TABLE_SHAPES * AN_TABLE_SHAPE_BYTES + AN_TABLE_CRC_BYTES
};

typedef enum {
    AN_TABLE_OK,
    AN_TABLE_TRUNCATED,
    AN_TABLE_MAGIC,
    AN_TABLE_WRONG_VERSION,
    AN_TABLE_LENGTH,
    AN_TABLE_DAMAGED,
    AN_TABLE_RANGE,
    AN_TABLE_OTHER_BUILD /* sound, but for the other build or another sample rate */
} an_table_result;

enum { AN_GAIN_IDENTIFIED = 1, AN_TAU_IDENTIFIED = 2, AN_FREQUENCY_IDENTIFIED = 4 };
enum { AN_MATRIX_IDENTIFIED = 1 };
enum { AN_SENSES_DISPLACEMENT = 1 };

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
} an_table;

typedef struct {
    float frequency_hz;
    float tau_s;
    float drive_limit;
    uint32_t flags;
    uint32_t pattern_count;
} an_shape_head;

/* AN_TABLE_OK or why not; length may exceed the table's own (the rest of its flash sector). */
uint32_t an_table_open(an_table *table, const uint8_t *data, uint32_t length);

/* A mode of an accepted table and its flags; index below mode_count. */
uint32_t an_table_mode(const an_table *table, uint32_t index, an_mode *mode);

/* Of an accepted table, index below shape_count. */
void an_table_shape(const an_table *table, uint32_t index, an_shape_head *head);

/* One element of its matrix, sensor over actuator. */
an_complex an_table_matrix(const an_table *table, uint32_t index, uint32_t sensor, uint32_t actuator);

/* One element of a pattern. */
an_complex an_table_target(const an_table *table, uint32_t index, uint32_t pattern, uint32_t sensor);

#endif
