/* Sine and cosine of a 32-bit phase with 2^32 counts per turn. */
#ifndef AN_SINE_H
#define AN_SINE_H

#include "an_types.h"

/* Cosine and sine at 256 equally spaced angles, starting at 0. */
typedef struct {
    float cosine;
    float sine;
} an_sine_entry;

extern const an_sine_entry an_sine_table[256];

/* exp(j phase), for callers outside the fast tick. */
an_complex an_turn(uint32_t phase);

/* Phase of a complex number, the inverse of an_turn; 0 for zero and for values that are not finite. */
uint32_t an_phase_of(an_complex z);

#endif
