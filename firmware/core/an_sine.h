/* Sine and cosine of a 32-bit phase: 2^32 is one turn. */
#ifndef AN_SINE_H
#define AN_SINE_H

#include "an_types.h"

/* The unit circle at 256 evenly spaced angles, from 0. */
typedef struct {
    float cosine;
    float sine;
} an_sine_entry;

extern const an_sine_entry an_sine_table[256];

/* exp(j phase), for callers that are not in a hurry. */
an_complex an_turn(uint32_t phase);

/* The 32-bit phase of a vector, the inverse of an_turn; 0 for the zero vector. */
uint32_t an_phase_of(an_complex z);

#endif
