/* Zero an object byte by byte: the core does not depend on a C library, not even through calls that the compiler
 * inserts. */
#ifndef AN_CLEAR_H
#define AN_CLEAR_H

#include "an_types.h"

static inline void an_clear(void *object, size_t bytes)
{
    uint8_t *at = object;
    for (size_t i = 0u; i < bytes; i++) {
        at[i] = 0u;
    }
}

#endif
