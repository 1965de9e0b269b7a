/* Little-endian numbers in byte arrays of any alignment, and objects as bytes. */
#ifndef AN_BYTES_H
#define AN_BYTES_H

#include "an_types.h"

static inline uint32_t an_get16(const uint8_t *at)
{
    return (uint32_t)at[0] | (uint32_t)at[1] << 8;
}

static inline uint32_t an_get32(const uint8_t *at)
{
    return an_get16(at) | an_get16(at + 2) << 16;
}

static inline float an_get_float(const uint8_t *at)
{
    const union {
        uint32_t bits;
        float value;
    } number = {an_get32(at)};
    return number.value;
}

static inline an_complex an_get_complex(const uint8_t *at)
{
    an_complex z = {an_get_float(at), an_get_float(at + 4)};
    return z;
}

/* Each an_put function returns the position after the bytes it wrote. */
static inline uint8_t *an_put8(uint8_t *at, uint32_t value)
{
    at[0] = (uint8_t)value;
    return at + 1;
}

static inline uint8_t *an_put16(uint8_t *at, uint32_t value)
{
    return an_put8(an_put8(at, value), value >> 8);
}

static inline uint8_t *an_put32(uint8_t *at, uint32_t value)
{
    for (uint32_t i = 0u; i < 4u; i++) {
        at[i] = (uint8_t)(value >> (8u * i));
    }
    return at + 4;
}

/* Copy an object whose layout is that of the bytes (an_wire.h), of any alignment. */
uint8_t *an_put_object(uint8_t *at, const void *object, size_t bytes);
void an_get_object(void *object, const uint8_t *at, size_t bytes);

void an_clear(void *object, size_t bytes);

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "objects are copied as they are");

#endif
