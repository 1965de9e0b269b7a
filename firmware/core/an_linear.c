#include "an_linear.h"

#include "an_complex.h"

#define AN_PIVOT_MIN2 1e-12f

static float largest2(const an_complex *rows, uint32_t n, uint32_t width)
{
    float largest = 0.0f;
    for (uint32_t i = 0u; i < n; i++) {
        for (uint32_t j = 0u; j < n; j++) {
            const float size = an_abs2(rows[i * width + j]);
            largest = size > largest ? size : largest;
        }
    }
    return largest;
}

static uint32_t pivot_row(const an_complex *rows, uint32_t n, uint32_t width, uint32_t column)
{
    uint32_t best = column;
    for (uint32_t i = column + 1u; i < n; i++) {
        if (an_abs2(rows[i * width + column]) > an_abs2(rows[best * width + column])) {
            best = i;
        }
    }
    return best;
}

static void swap_rows(an_complex *a, an_complex *b, uint32_t width)
{
    for (uint32_t j = 0u; j < width; j++) {
        const an_complex kept = a[j];
        a[j] = b[j];
        b[j] = kept;
    }
}

static void eliminate(an_complex *rows, uint32_t n, uint32_t width, uint32_t column)
{
    an_complex *pivot = rows + column * width;
    const an_complex inverse = an_div(an_cplx(1.0f, 0.0f), pivot[column]);
    for (uint32_t j = column; j < width; j++) {
        pivot[j] = an_mul(pivot[j], inverse);
    }
    for (uint32_t i = 0u; i < n; i++) {
        an_complex *row = rows + i * width;
        const an_complex factor = row[column];
        if (i == column) {
            continue;
        }
        for (uint32_t j = column; j < width; j++) {
            row[j] = an_sub(row[j], an_mul(factor, pivot[j]));
        }
    }
}

bool an_solve(an_complex *rows, uint32_t n, uint32_t columns)
{
    const uint32_t width = n + columns;
    const float least = AN_PIVOT_MIN2 * largest2(rows, n, width);
    for (uint32_t column = 0u; column < n; column++) {
        const uint32_t best = pivot_row(rows, n, width, column);
        if (!(an_abs2(rows[best * width + column]) > least)) {
            return false;
        }
        if (best != column) {
            swap_rows(rows + best * width, rows + column * width, width);
        }
        eliminate(rows, n, width, column);
    }
    return true;
}
