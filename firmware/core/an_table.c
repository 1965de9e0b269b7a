#include "an_table.h"

#include "an_assert.h"
#include "an_bytes.h"
#include "an_crc.h"

enum { COMPLEX_BYTES = sizeof(an_complex), ROW_BYTES = AN_CHANNELS * COMPLEX_BYTES };

/* Offset of a member in the header, a mode or a shape. */
#define HEADER_AT(member) offsetof(an_header_row, member)
#define MODE_AT(member) offsetof(an_mode_row, member)
#define SHAPE_AT(member) offsetof(an_shape_row, member)

/* Allowed range of a number. */
typedef struct {
    size_t at;
    float low;
    float high;
} a_bound;

static const a_bound header_bounds[] = {AN_HEADER_BOUNDS};
static const a_bound mode_bounds[] = {AN_MODE_BOUNDS};
static const a_bound shape_bounds[] = {AN_SHAPE_BOUNDS};

#define AN_SHARED __attribute__((noinline)) /* called often: inlined, 300 bytes more */

/* Check the bounds of a float; false for a NaN. */
static AN_SHARED bool within(const uint8_t *at, float low, float high)
{
    const float value = an_get_float(at);
    return value >= low && value <= high;
}

static bool all_within(const uint8_t *row, const a_bound *bounds, size_t count)
{
    for (size_t i = 0u; i < count; i++) {
        if (!within(row + bounds[i].at, bounds[i].low, bounds[i].high)) {
            return false;
        }
    }
    return true;
}

#define ALL_WITHIN(row, bounds) all_within((row), (bounds), sizeof(bounds) / sizeof *(bounds))

/* Check a row of complex numbers: real and imaginary parts up to high in magnitude where in use, zero elsewhere. */
static AN_SHARED bool row_within(const uint8_t *at, uint32_t in_use, float high)
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
    const uint8_t *gain = mode + MODE_AT(gain);
    if (!within(gain, -AN_GAIN_HIGH, AN_GAIN_HIGH) || !within(gain + sizeof(float), -AN_GAIN_HIGH, AN_GAIN_HIGH)) {
        return false;
    }
    const float larger = larger_part(an_get_complex(gain));
    const bool identified = (an_get32(mode + MODE_AT(flags)) & AN_GAIN_IDENTIFIED) != 0u;
    return identified ? larger >= AN_GAIN_LOW : larger == 0.0f;
}

static bool frequency_in_range(const an_table *table, const uint8_t *at)
{
    return within(at, AN_FREQUENCY_LOW_HZ, AN_FREQUENCY_HIGH * table->sample_rate_hz);
}

static bool mode_in_range(const an_table *table, const uint8_t *mode)
{
    const uint32_t known = AN_GAIN_IDENTIFIED | AN_TAU_IDENTIFIED | AN_FREQUENCY_IDENTIFIED;
    return frequency_in_range(table, mode + MODE_AT(frequency_hz)) && ALL_WITHIN(mode, mode_bounds) &&
           an_get32(mode + MODE_AT(flags)) <= known && gain_in_range(mode) &&
           row_within(mode + MODE_AT(actuator_weights), table->actuator_count, AN_WEIGHT_HIGH) &&
           row_within(mode + MODE_AT(sensor_weights), table->sensor_count, AN_WEIGHT_HIGH);
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
        const uint8_t *name = shape + SHAPE_AT(names) + AN_NAME_BYTES * i;
        if (i < count ? !name_in_range(name) : an_get32(name) != 0u || an_get32(name + 4) != 0u) {
            return false;
        }
        if (!row_within(shape + SHAPE_AT(targets) + ROW_BYTES * i, i < count ? table->sensor_count : 0u, AN_WEIGHT_HIGH)) {
            return false;
        }
    }
    return true;
}

static bool matrix_in_range(const an_table *table, const uint8_t *shape)
{
    const bool identified = (an_get16(shape + SHAPE_AT(flags)) & AN_MATRIX_IDENTIFIED) != 0u;
    const uint32_t columns = identified ? table->actuator_count : 0u;
    for (uint32_t i = 0u; i < AN_CHANNELS; i++) {
        if (!row_within(shape + SHAPE_AT(matrix) + ROW_BYTES * i, i < table->sensor_count ? columns : 0u, AN_MATRIX_HIGH)) {
            return false;
        }
    }
    return true;
}

static bool shape_in_range(const an_table *table, const uint8_t *shape)
{
    const uint32_t count = an_get16(shape + SHAPE_AT(pattern_count));
    return frequency_in_range(table, shape + SHAPE_AT(frequency_hz)) && ALL_WITHIN(shape, shape_bounds) &&
           an_get16(shape + SHAPE_AT(flags)) <= AN_MATRIX_IDENTIFIED &&
           count >= 1u && count <= AN_PATTERNS && table->actuator_count == table->sensor_count &&
           matrix_in_range(table, shape) && targets_in_range(table, shape, count);
}

static const uint8_t *mode_at(const an_table *table, uint32_t index)
{
    return table->data + sizeof(an_header_row) + index * sizeof(an_mode_row);
}

static const uint8_t *shape_at(const an_table *table, uint32_t index)
{
    return mode_at(table, table->mode_count) + index * sizeof(an_shape_row);
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
    table->length = an_get32(data + HEADER_AT(total_bytes));
    table->mode_count = an_get16(data + HEADER_AT(mode_count));
    table->shape_count = an_get16(data + HEADER_AT(shape_count));
    table->actuator_count = data[HEADER_AT(actuator_count)];
    table->sensor_count = data[HEADER_AT(sensor_count)];
    table->target = an_get16(data + HEADER_AT(target));
    table->flags = an_get32(data + HEADER_AT(flags));
    table->sample_rate_hz = an_get_float(data + HEADER_AT(sample_rate_hz));
    table->sensor_volts = an_get_float(data + HEADER_AT(sensor_volts));
}

static bool header_in_range(const an_table *table)
{
    const uint32_t entries = table->mode_count > 0u ? table->mode_count : 1u;
    return table->actuator_count >= 1u && table->actuator_count <= AN_CHANNELS && table->sensor_count >= 1u &&
           table->sensor_count <= AN_CHANNELS && table->target < entries && table->flags <= AN_SENSES_DISPLACEMENT &&
           table->mode_count + table->shape_count > 0u && ALL_WITHIN(table->data, header_bounds);
}

/* Bound the counts before multiplying them; the total must equal the stated length. */
static bool lengths_agree(const an_table *table)
{
    const uint8_t *data = table->data;
    return an_get16(data + HEADER_AT(header_bytes)) == sizeof(an_header_row) &&
           an_get16(data + HEADER_AT(mode_bytes)) == sizeof(an_mode_row) &&
           an_get16(data + HEADER_AT(shape_bytes)) == sizeof(an_shape_row) && table->mode_count <= AN_TABLE_MODES &&
           table->shape_count <= AN_TABLE_SHAPES &&
           table->length == sizeof(an_header_row) + table->mode_count * sizeof(an_mode_row) +
                                table->shape_count * sizeof(an_shape_row) + AN_TABLE_CRC_BYTES;
}

uint32_t an_table_open(an_table *table, const uint8_t *data, uint32_t length)
{
    if (length < sizeof(an_header_row) + AN_TABLE_CRC_BYTES) {
        return AN_TABLE_TRUNCATED;
    }
    if (data[0] != 'A' || data[1] != 'N' || data[2] != 'T' || data[3] != 'M') {
        return AN_TABLE_MAGIC;
    }
    if (an_get16(data + HEADER_AT(version)) != AN_TABLE_VERSION) {
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
    mode->frequency_hz = an_get_float(at + MODE_AT(frequency_hz));
    mode->tau_s = an_get_float(at + MODE_AT(tau_s));
    mode->gain = an_get_complex(at + MODE_AT(gain));
    mode->delay_s = an_get_float(at + MODE_AT(delay_s));
    mode->drive_limit = an_get_float(at + MODE_AT(drive_limit));
    mode->amplitude_limit = an_get_float(at + MODE_AT(amplitude_limit));
    mode->metres = table->sensor_volts * an_get_float(at + MODE_AT(metres_per_volt));
    return an_get32(at + MODE_AT(flags));
}

void an_table_shape(const an_table *table, uint32_t index, an_shape_head *head)
{
    AN_ASSERT(index < table->shape_count);
    const uint8_t *at = shape_at(table, index);
    head->frequency_hz = an_get_float(at + SHAPE_AT(frequency_hz));
    head->tau_s = an_get_float(at + SHAPE_AT(tau_s));
    head->drive_limit = an_get_float(at + SHAPE_AT(drive_limit));
    head->metres = table->sensor_volts * an_get_float(at + SHAPE_AT(metres_per_volt));
    head->flags = an_get16(at + SHAPE_AT(flags));
    head->pattern_count = an_get16(at + SHAPE_AT(pattern_count));
}

an_complex an_table_matrix(const an_table *table, uint32_t index, uint32_t sensor, uint32_t actuator)
{
    return an_get_complex(shape_at(table, index) + SHAPE_AT(matrix) + ROW_BYTES * sensor + COMPLEX_BYTES * actuator);
}

an_complex an_table_target(const an_table *table, uint32_t index, uint32_t pattern, uint32_t sensor)
{
    return an_get_complex(shape_at(table, index) + SHAPE_AT(targets) + ROW_BYTES * pattern + COMPLEX_BYTES * sensor);
}
