#include "an_sine.h"

#include "an_complex.h"
#include "an_sincos.h"

const an_sine_entry an_sine_table[256] = {
#include "an_sine_table.inc"
};

an_complex an_turn(uint32_t phase)
{
    return an_sincos(phase);
}

/* Arctangent of a ratio in [0, 1] as a phase, accurate to 0.004 rad. an_phase_of rotates back by it and takes the sine
 * of the remaining angle for the angle itself, an error of 1e-8. */
static uint32_t coarse_phase(float ratio)
{
    const float angle = ratio * (0.7853982f + 0.273f * (1.0f - ratio));
    return (uint32_t)(angle / AN_TURN_PER_LSB);
}

static uint32_t octant_phase(an_complex z)
{
    const float x = z.re < 0.0f ? -z.re : z.re;
    const float y = z.im < 0.0f ? -z.im : z.im;
    uint32_t phase = y > x ? 0x40000000u - coarse_phase(x / y) : coarse_phase(y / x);
    if (z.re < 0.0f) {
        phase = 0x80000000u - phase;
    }
    return z.im < 0.0f ? 0u - phase : phase;
}

uint32_t an_phase_of(an_complex z)
{
    const float size = an_abs(z);
    if (!(size > 0.0f) || !an_is_finite(size)) {
        return 0u;
    }
    const uint32_t guess = octant_phase(z);
    const an_complex left = an_mul(z, an_conj(an_turn(guess)));
    return guess + (uint32_t)(int32_t)(left.im / size / AN_TURN_PER_LSB);
}
