#include "an_bytes.h"

uint8_t *an_put_object(uint8_t *at, const void *object, size_t bytes)
{
    const uint8_t *from = object;
    for (size_t i = 0u; i < bytes; i++) {
        at[i] = from[i];
    }
    return at + bytes;
}

void an_get_object(void *object, const uint8_t *at, size_t bytes)
{
    an_put_object(object, at, bytes);
}

/* Byte by byte: the core does not depend on a C library, not even through calls that the compiler inserts. */
void an_clear(void *object, size_t bytes)
{
    uint8_t *at = object;
    for (size_t i = 0u; i < bytes; i++) {
        at[i] = 0u;
    }
}
