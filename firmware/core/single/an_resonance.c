#include "an_resonance.h"

#include "an_bytes.h"
#include "an_complex.h"
#include "an_linear.h"

#define AN_TWO_PI 6.2831853f

enum { UNKNOWNS = 4, WIDTH = UNKNOWNS + 1, ROUNDS = 6 };

typedef struct {
    an_complex p0, p1, p2, q;
} an_rational;

static float abscissa(uint32_t index, uint32_t points)
{
    return 2.0f * (float)index / (float)(points - 1u) - 1.0f;
}

static an_complex denominator(const an_rational *model, float x)
{
    return an_add(an_cplx(1.0f, 0.0f), an_scale(model->q, x));
}

static an_complex numerator(const an_rational *model, an_complex x)
{
    return an_add(model->p0, an_mul(x, an_add(model->p1, an_mul(x, model->p2))));
}

/* Position of a point on the normalised frequency axis, from -1 to 1. */
static void accumulate(an_complex *normal, const an_complex *row, float weight)
{
    for (uint32_t i = 0u; i < UNKNOWNS; i++) {
        const an_complex left = an_scale(an_conj(row[i]), weight);
        for (uint32_t j = 0u; j < WIDTH; j++) {
            normal[i * WIDTH + j] = an_add(normal[i * WIDTH + j], an_mul(left, row[j]));
        }
    }
}

/* One iteration: minimise the sum of |p0 + p1 x + p2 x^2 - h (1 + q x)|^2 / |1 + q' x|^2, with q' from the last
 * iteration. */
static bool refine(an_rational *model, const an_complex *response, uint32_t points, float scale)
{
    an_complex normal[UNKNOWNS * WIDTH];
    an_clear(normal, sizeof normal);
    for (uint32_t i = 0u; i < points; i++) {
        const float x = abscissa(i, points);
        const an_complex h = an_scale(response[i], scale);
        const float size2 = an_abs2(denominator(model, x));
        const an_complex row[WIDTH] = {{1.0f, 0.0f}, {x, 0.0f}, {x * x, 0.0f}, an_scale(h, -x), h};
        if (size2 > 0.0f) {
            accumulate(normal, row, 1.0f / size2);
        }
    }
    if (!an_solve(normal, UNKNOWNS, 1u)) {
        return false;
    }
    model->p0 = normal[0 * WIDTH + UNKNOWNS];
    model->p1 = normal[1 * WIDTH + UNKNOWNS];
    model->p2 = normal[2 * WIDTH + UNKNOWNS];
    model->q = normal[3 * WIDTH + UNKNOWNS];
    return true;
}

static float largest(const an_complex *response, uint32_t points)
{
    float size2 = 0.0f;
    for (uint32_t i = 0u; i < points; i++) {
        size2 = an_abs2(response[i]) > size2 ? an_abs2(response[i]) : size2;
    }
    return __builtin_sqrtf(size2);
}

static float misfit(const an_rational *model, const an_complex *response, uint32_t points, float scale)
{
    float wrong = 0.0f;
    float all = 0.0f;
    for (uint32_t i = 0u; i < points; i++) {
        const float x = abscissa(i, points);
        const an_complex h = an_scale(response[i], scale);
        wrong += an_abs2(an_sub(h, an_div(numerator(model, an_cplx(x, 0.0f)), denominator(model, x))));
        all += an_abs2(h);
    }
    return __builtin_sqrtf(wrong / all);
}

/* A mode H = G / (1 + j tau (w - w0)) has its pole at x = x0 + j / (2 pi span tau), where its residue is -j G
 * Im(pole). */
bool an_resonance_fit(an_resonance *fit, const an_complex *response, uint32_t points, float span_hz)
{
    an_rational model;
    an_clear(&model, sizeof model);
    const float peak = largest(response, points);
    if (!(peak > 0.0f) || !an_is_finite(peak)) {
        return false;
    }
    for (uint32_t i = 0u; i < ROUNDS; i++) {
        if (!refine(&model, response, points, 1.0f / peak)) {
            return false;
        }
    }
    const an_complex pole = an_div(an_cplx(-1.0f, 0.0f), model.q);
    if (!(pole.im > 0.0f)) {
        return false;
    }
    const an_complex residue = an_div(numerator(&model, pole), model.q);
    fit->offset_hz = span_hz * pole.re;
    fit->tau_s = 1.0f / (AN_TWO_PI * span_hz * pole.im);
    fit->gain = an_scale(an_cplx(-residue.im, residue.re), peak / pole.im);
    fit->misfit = misfit(&model, response, points, 1.0f / peak);
    return true;
}
