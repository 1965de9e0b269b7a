/* Inline version of an_turn for the fast tick. */
#ifndef AN_SINCOS_H
#define AN_SINCOS_H

#include "an_sine.h"

#define AN_TURN_PER_LSB 1.4629180792671596e-9f /* 2 pi / 2^32 */

/* Second-order expansion about the nearest tabulated angle. |d| <= pi/256, so the neglected d^3/6 is below 3.1e-7. d is
 * the signed low 24 bits of the phase, shifted to the top of the word here. */
static inline an_complex an_sincos(uint32_t phase)
{
    const uint32_t shifted = phase + 0x800000u;
    const an_sine_entry *near = &an_sine_table[shifted >> 24];
    const int32_t rest = (int32_t)(phase << 8);
    const float d = (float)rest * (AN_TURN_PER_LSB / 256.0f);
    const float h = 0.5f * d * d;
    an_complex z;
    z.re = near->cosine - (near->sine * d + near->cosine * h);
    z.im = near->sine + (near->cosine * d - near->sine * h);
    return z;
}

#endif
