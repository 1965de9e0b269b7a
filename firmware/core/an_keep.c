#include "an_keep.h"

#include "an_assert.h"
#include "an_bytes.h"
#include "an_crc.h"

/* Layout: CRC-32 of everything after it, the table's own CRC-32, build and slot, length of the values, values. */
enum { TABLE_AT = 4, BUILD_AT = 8, LENGTH_AT = 12 };

static uint32_t table_crc(const an_table *table)
{
    return an_get32(table->data + table->length - AN_TABLE_CRC_BYTES);
}

static uint32_t content_crc(const uint8_t *memory, uint32_t length)
{
    return an_crc32(memory + TABLE_AT, AN_KEEP_HEADER_BYTES - TABLE_AT + length);
}

void an_keep_write(uint8_t *memory, uint32_t build, const an_table *table, const uint8_t *values, uint32_t length)
{
    AN_ASSERT(length <= AN_KEEP_VALUES_MAX);
    an_put32(memory + TABLE_AT, table_crc(table));
    an_put32(memory + BUILD_AT, build);
    an_put32(memory + LENGTH_AT, length);
    for (uint32_t i = 0u; i < length; i++) {
        memory[AN_KEEP_HEADER_BYTES + i] = values[i];
    }
    an_put32(memory, content_crc(memory, length));
}

uint32_t an_keep_read(const uint8_t *memory, uint32_t build, const an_table *table, uint8_t *values, an_keep_state *state)
{
    const uint32_t length = an_get32(memory + LENGTH_AT);
    *state = AN_KEEP_EMPTY;
    if (length > AN_KEEP_VALUES_MAX || an_get32(memory) != content_crc(memory, length)) {
        return 0u;
    }
    *state = AN_KEEP_REFUSED;
    if (an_get32(memory + TABLE_AT) != table_crc(table) || an_get32(memory + BUILD_AT) != build) {
        return 0u;
    }
    for (uint32_t i = 0u; i < length; i++) {
        values[i] = memory[AN_KEEP_HEADER_BYTES + i];
    }
    *state = AN_KEEP_READ;
    return length;
}
