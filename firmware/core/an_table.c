#include "an_table.h"

#include "an_assert.h"
#include "an_bytes.h"
#include "an_crc.h"

/* Offsets within the header, a mode and a shape. */
enum { AT_VERSION = 4, AT_HEADER_BYTES = 6, AT_TOTAL = 8, AT_MODES = 12, AT_MODE_BYTES = 14 };
enum { AT_SHAPES = 16, AT_SHAPE_BYTES = 18, AT_ACTUATORS = 20, AT_SENSORS = 21, AT_TARGET = 22, AT_RATE = 24 };
enum { AT_FLAGS = 28 };
enum { MODE_FREQUENCY = 0, MODE_TAU = 4, MODE_GAIN = 8, MODE_DELAY = 16, MODE_DRIVE = 20, MODE_AMPLITUDE = 24 };
enum { MODE_FLAGS = 28, MODE_ACTUATORS = 32, MODE_SENSORS = 80 };
enum { SHAPE_FREQUENCY = 0, SHAPE_TAU = 4, SHAPE_DRIVE = 8, SHAPE_FLAGS = 12, SHAPE_COUNT = 14, SHAPE_NAMES = 16 };
enum { SHAPE_MATRIX = 80, SHAPE_TARGETS = 368 };
enum { COMPLEX_BYTES = 8, ROW_BYTES = AN_CHANNELS * COMPLEX_BYTES };

_Static_assert(MODE_SENSORS + ROW_BYTES == AN_TABLE_MODE_BYTES, "a mode ends with its sensor weights");
_Static_assert(SHAPE_MATRIX + AN_CHANNELS * ROW_BYTES == SHAPE_TARGETS, "the targets follow the matrix");
_Static_assert(SHAPE_TARGETS + AN_PATTERNS * ROW_BYTES == AN_TABLE_SHAPE_BYTES, "a shape ends with its targets");

/* False for a NaN. */
static bool within(const uint8_t *at, float low, float high)
{
    const float value = an_get_float(at);
    return value >= low && value <= high;
}

/* Complex numbers in use have parts of at most high, those beyond are zero. */
static bool row_within(const uint8_t *at, uint32_t in_use, float high)
{
    for (uint32_t i = 0u; i < 2u * AN_CHANNELS; i++) {
        const float limit = i < 2u * in_use ? high : 0.0f;
        if (!within(at + 4u * i, -limit, limit)) {
            return false;
        }
    }
    return true;
}

static float larger_part(an_complex z)
{
    const float re = z.re < 0.0f ? -z.re : z.re;
    const float im = z.im < 0.0f ? -z.im : z.im;
    return re > im ? re : im;
}

static bool gain_in_range(const uint8_t *mode)
{
    const an_complex gain = an_get_complex(mode + MODE_GAIN);
    if (!within(mode + MODE_GAIN, -1e3f, 1e3f) || !within(mode + MODE_GAIN + 4, -1e3f, 1e3f)) {
        return false;
    }
    const bool identified = (an_get32(mode + MODE_FLAGS) & AN_GAIN_IDENTIFIED) != 0u;
    return identified ? larger_part(gain) >= 1e-6f : larger_part(gain) == 0.0f;
}

static bool frequency_in_range(const an_table *table, const uint8_t *at)
{
    return within(at, 20.0f, 0.4f * table->sample_rate_hz);
}

static bool mode_in_range(const an_table *table, const uint8_t *mode)
{
    return frequency_in_range(table, mode + MODE_FREQUENCY) && within(mode + MODE_TAU, 1e-6f, 10.0f) &&
           within(mode + MODE_DELAY, 0.0f, 1e-3f) && within(mode + MODE_DRIVE, 1e-3f, 1.0f) &&
           within(mode + MODE_AMPLITUDE, 1e-3f, 1.0f) && an_get32(mode + MODE_FLAGS) <= 7u && gain_in_range(mode) &&
           row_within(mode + MODE_ACTUATORS, table->actuator_count, 1.0f) &&
           row_within(mode + MODE_SENSORS, table->sensor_count, 1.0f);
}

static bool name_in_range(const uint8_t *name)
{
    bool ended = false;
    for (uint32_t i = 0u; i < AN_NAME_BYTES; i++) {
        ended = ended || name[i] == 0u;
        if (ended ? name[i] != 0u : name[i] < 0x20u || name[i] > 0x7eu) {
            return false;
        }
    }
    return name[0] != 0u;
}

static bool targets_in_range(const an_table *table, const uint8_t *shape, uint32_t count)
{
    for (uint32_t i = 0u; i < AN_PATTERNS; i++) {
        const uint8_t *name = shape + SHAPE_NAMES + AN_NAME_BYTES * i;
        if (i < count ? !name_in_range(name) : an_get32(name) != 0u || an_get32(name + 4) != 0u) {
            return false;
        }
        if (!row_within(shape + SHAPE_TARGETS + ROW_BYTES * i, i < count ? table->sensor_count : 0u, 1.0f)) {
            return false;
        }
    }
    return true;
}

static bool matrix_in_range(const an_table *table, const uint8_t *shape)
{
    const bool identified = (an_get16(shape + SHAPE_FLAGS) & AN_MATRIX_IDENTIFIED) != 0u;
    const uint32_t columns = identified ? table->actuator_count : 0u;
    for (uint32_t i = 0u; i < AN_CHANNELS; i++) {
        if (!row_within(shape + SHAPE_MATRIX + ROW_BYTES * i, i < table->sensor_count ? columns : 0u, 1e3f)) {
            return false;
        }
    }
    return true;
}

static bool shape_in_range(const an_table *table, const uint8_t *shape)
{
    const uint32_t count = an_get16(shape + SHAPE_COUNT);
    return frequency_in_range(table, shape + SHAPE_FREQUENCY) && within(shape + SHAPE_TAU, 1e-6f, 10.0f) &&
           within(shape + SHAPE_DRIVE, 1e-3f, 1.0f) && an_get16(shape + SHAPE_FLAGS) <= AN_MATRIX_IDENTIFIED &&
           count >= 1u && count <= AN_PATTERNS && table->actuator_count == table->sensor_count &&
           matrix_in_range(table, shape) && targets_in_range(table, shape, count);
}

static const uint8_t *mode_at(const an_table *table, uint32_t index)
{
    return table->data + AN_TABLE_HEADER_BYTES + index * AN_TABLE_MODE_BYTES;
}

static const uint8_t *shape_at(const an_table *table, uint32_t index)
{
    return mode_at(table, table->mode_count) + index * AN_TABLE_SHAPE_BYTES;
}

static bool all_in_range(const an_table *table)
{
    for (uint32_t i = 0u; i < table->mode_count; i++) {
        if (!mode_in_range(table, mode_at(table, i))) {
            return false;
        }
    }
    for (uint32_t i = 0u; i < table->shape_count; i++) {
        if (!shape_in_range(table, shape_at(table, i))) {
            return false;
        }
    }
    return true;
}

static void read_header(an_table *table, const uint8_t *data)
{
    table->data = data;
    table->length = an_get32(data + AT_TOTAL);
    table->mode_count = an_get16(data + AT_MODES);
    table->shape_count = an_get16(data + AT_SHAPES);
    table->actuator_count = data[AT_ACTUATORS];
    table->sensor_count = data[AT_SENSORS];
    table->target = an_get16(data + AT_TARGET);
    table->flags = an_get32(data + AT_FLAGS);
    table->sample_rate_hz = an_get_float(data + AT_RATE);
}

static bool header_in_range(const an_table *table)
{
    const uint32_t entries = table->mode_count > 0u ? table->mode_count : 1u;
    return table->actuator_count >= 1u && table->actuator_count <= AN_CHANNELS && table->sensor_count >= 1u &&
           table->sensor_count <= AN_CHANNELS && table->target < entries && table->flags <= AN_SENSES_DISPLACEMENT &&
           table->mode_count + table->shape_count > 0u && within(table->data + AT_RATE, 1e3f, 1e6f);
}

/* The counts are bounded before they are multiplied, the sum must meet the stated length exactly. */
static bool lengths_agree(const an_table *table)
{
    const uint8_t *data = table->data;
    return an_get16(data + AT_HEADER_BYTES) == AN_TABLE_HEADER_BYTES &&
           an_get16(data + AT_MODE_BYTES) == AN_TABLE_MODE_BYTES &&
           an_get16(data + AT_SHAPE_BYTES) == AN_TABLE_SHAPE_BYTES && table->mode_count <= AN_TABLE_MODES &&
           table->shape_count <= AN_TABLE_SHAPES &&
           table->length == AN_TABLE_HEADER_BYTES + table->mode_count * AN_TABLE_MODE_BYTES +
                                table->shape_count * AN_TABLE_SHAPE_BYTES + AN_TABLE_CRC_BYTES;
}

uint32_t an_table_open(an_table *table, const uint8_t *data, uint32_t length)
{
    if (length < AN_TABLE_HEADER_BYTES + AN_TABLE_CRC_BYTES) {
        return AN_TABLE_TRUNCATED;
    }
    if (data[0] != 'A' || data[1] != 'N' || data[2] != 'T' || data[3] != 'M') {
        return AN_TABLE_MAGIC;
    }
    if (an_get16(data + AT_VERSION) != AN_TABLE_VERSION) {
        return AN_TABLE_WRONG_VERSION;
    }
    read_header(table, data);
    if (!lengths_agree(table)) {
        return AN_TABLE_LENGTH;
    }
    if (table->length > length) {
        return AN_TABLE_TRUNCATED;
    }
    const uint32_t body = table->length - AN_TABLE_CRC_BYTES;
    if (an_crc32(data, body) != an_get32(data + body)) {
        return AN_TABLE_DAMAGED;
    }
    return header_in_range(table) && all_in_range(table) ? AN_TABLE_OK : AN_TABLE_RANGE;
}

uint32_t an_table_mode(const an_table *table, uint32_t index, an_mode *mode)
{
    AN_ASSERT(index < table->mode_count);
    const uint8_t *at = mode_at(table, index);
    mode->frequency_hz = an_get_float(at + MODE_FREQUENCY);
    mode->tau_s = an_get_float(at + MODE_TAU);
    mode->gain = an_get_complex(at + MODE_GAIN);
    mode->delay_s = an_get_float(at + MODE_DELAY);
    mode->drive_limit = an_get_float(at + MODE_DRIVE);
    mode->amplitude_limit = an_get_float(at + MODE_AMPLITUDE);
    return an_get32(at + MODE_FLAGS);
}

void an_table_shape(const an_table *table, uint32_t index, an_shape_head *head)
{
    AN_ASSERT(index < table->shape_count);
    const uint8_t *at = shape_at(table, index);
    head->frequency_hz = an_get_float(at + SHAPE_FREQUENCY);
    head->tau_s = an_get_float(at + SHAPE_TAU);
    head->drive_limit = an_get_float(at + SHAPE_DRIVE);
    head->flags = an_get16(at + SHAPE_FLAGS);
    head->pattern_count = an_get16(at + SHAPE_COUNT);
}

an_complex an_table_matrix(const an_table *table, uint32_t index, uint32_t sensor, uint32_t actuator)
{
    return an_get_complex(shape_at(table, index) + SHAPE_MATRIX + ROW_BYTES * sensor + COMPLEX_BYTES * actuator);
}

an_complex an_table_target(const an_table *table, uint32_t index, uint32_t pattern, uint32_t sensor)
{
    return an_get_complex(shape_at(table, index) + SHAPE_TARGETS + ROW_BYTES * pattern + COMPLEX_BYTES * sensor);
}
