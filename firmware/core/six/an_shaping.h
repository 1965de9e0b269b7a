/* Transfer matrix T from drives to sensors at one frequency, measured column by column and inverted once. */
#ifndef AN_SHAPING_H
#define AN_SHAPING_H

#include "an_types.h"

enum { AN_SHAPING_MAX = 6 };

typedef struct {
    uint32_t channels;
    an_complex matrix[AN_SHAPING_MAX * AN_SHAPING_MAX]; /* T, sensor by actuator */
    an_complex inverse[AN_SHAPING_MAX * AN_SHAPING_MAX];
    float condition; /* |T| |T^-1| in the Frobenius norm, no less than the number of channels */
} an_shaping;

void an_shaping_init(an_shaping *shaping, uint32_t channels);

/* Set a column of T: the responses of all sensors to one actuator, times scale. */
void an_shaping_set(an_shaping *shaping, uint32_t actuator, const an_complex *responses, float scale);

/* Compute inverse and condition. Returns false if T is too ill-conditioned to invert. */
bool an_shaping_invert(an_shaping *shaping);

/* Largest |drive| needed for a pattern of sensor targets. */
float an_shaping_effort(const an_shaping *shaping, const an_complex *targets);

#endif
