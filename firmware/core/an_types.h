/* Types used throughout the core. */
#ifndef AN_TYPES_H
#define AN_TYPES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
    float re;
    float im;
} an_complex;

#endif
