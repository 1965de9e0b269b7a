/* The matrix of shaping: sensors = T drives at one frequency, measured column by column, inverted once. */
#ifndef AN_SHAPING_H
#define AN_SHAPING_H

#include "an_types.h"

enum { AN_SHAPING_MAX = 6 };

typedef struct {
    uint32_t channels;
    an_complex matrix[AN_SHAPING_MAX * AN_SHAPING_MAX]; /* T, sensor by actuator */
    an_complex inverse[AN_SHAPING_MAX * AN_SHAPING_MAX];
    float condition; /* |T| |T^-1| in the Frobenius norm: at least the number of channels */
} an_shaping;

void an_shaping_init(an_shaping *shaping, uint32_t channels);

/* The responses of all sensors to one actuator. */
void an_shaping_set(an_shaping *shaping, uint32_t actuator, const an_complex *responses, float scale);

/* Fills inverse and condition; false when T cannot be inverted with any confidence. */
bool an_shaping_invert(an_shaping *shaping);

/* The largest |drive| that a pattern of sensor targets takes. */
float an_shaping_effort(const an_shaping *shaping, const an_complex *targets);

#endif
