#include "an_shaping.h"

#include "an_assert.h"
#include "an_bytes.h"
#include "an_complex.h"
#include "an_linear.h"

#define AN_CONDITION_MAX 100.0f /* 0.5 % of error in T then gives 50 % in V, which the integrals still correct */

void an_shaping_init(an_shaping *shaping, uint32_t channels)
{
    an_clear(shaping, sizeof *shaping);
    shaping->channels = channels;
}

void an_shaping_set(an_shaping *shaping, uint32_t actuator, const an_complex *responses, float scale)
{
    AN_ASSERT(actuator < shaping->channels && shaping->channels <= AN_SHAPING_MAX);
    for (uint32_t i = 0u; i < shaping->channels; i++) {
        shaping->matrix[i * AN_SHAPING_MAX + actuator] = an_scale(responses[i], scale);
    }
}

static float frobenius2(const an_complex *matrix, uint32_t n)
{
    float sum = 0.0f;
    for (uint32_t i = 0u; i < n; i++) {
        for (uint32_t j = 0u; j < n; j++) {
            sum += an_abs2(matrix[i * AN_SHAPING_MAX + j]);
        }
    }
    return sum;
}

bool an_shaping_invert(an_shaping *shaping)
{
    an_complex rows[AN_SHAPING_MAX * 2 * AN_SHAPING_MAX];
    const uint32_t n = shaping->channels;
    for (uint32_t i = 0u; i < n; i++) {
        for (uint32_t j = 0u; j < n; j++) {
            rows[i * 2u * n + j] = shaping->matrix[i * AN_SHAPING_MAX + j];
            rows[i * 2u * n + n + j] = an_cplx(i == j ? 1.0f : 0.0f, 0.0f);
        }
    }
    if (!an_solve(rows, n, n)) {
        return false;
    }
    for (uint32_t i = 0u; i < n; i++) {
        for (uint32_t j = 0u; j < n; j++) {
            shaping->inverse[i * AN_SHAPING_MAX + j] = rows[i * 2u * n + n + j];
        }
    }
    shaping->condition = __builtin_sqrtf(frobenius2(shaping->matrix, n) * frobenius2(shaping->inverse, n));
    return shaping->condition <= AN_CONDITION_MAX;
}

float an_shaping_effort(const an_shaping *shaping, const an_complex *targets)
{
    float largest2 = 0.0f;
    for (uint32_t i = 0u; i < shaping->channels; i++) {
        an_complex drive = an_cplx(0.0f, 0.0f);
        for (uint32_t j = 0u; j < shaping->channels; j++) {
            drive = an_add(drive, an_mul(shaping->inverse[i * AN_SHAPING_MAX + j], targets[j]));
        }
        largest2 = an_abs2(drive) > largest2 ? an_abs2(drive) : largest2;
    }
    return __builtin_sqrtf(largest2);
}
