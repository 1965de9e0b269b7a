/* Complex arithmetic in single precision. */
#ifndef AN_COMPLEX_H
#define AN_COMPLEX_H

#include "an_types.h"

static inline an_complex an_cplx(float re, float im)
{
    an_complex z = {re, im};
    return z;
}

static inline an_complex an_add(an_complex a, an_complex b)
{
    return an_cplx(a.re + b.re, a.im + b.im);
}

static inline an_complex an_sub(an_complex a, an_complex b)
{
    return an_cplx(a.re - b.re, a.im - b.im);
}

static inline an_complex an_mul(an_complex a, an_complex b)
{
    return an_cplx(a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re);
}

static inline an_complex an_conj(an_complex a)
{
    return an_cplx(a.re, -a.im);
}

static inline an_complex an_scale(an_complex a, float factor)
{
    return an_cplx(a.re * factor, a.im * factor);
}

static inline float an_abs2(an_complex a)
{
    return a.re * a.re + a.im * a.im;
}

static inline float an_abs(an_complex a)
{
    return __builtin_sqrtf(an_abs2(a));
}

/* a / b, or zero if b is zero, so that a division never yields an infinity. */
static inline an_complex an_div(an_complex a, an_complex b)
{
    const float size = an_abs2(b);
    if (!(size > 0.0f)) {
        return an_cplx(0.0f, 0.0f);
    }
    return an_scale(an_mul(a, an_conj(b)), 1.0f / size);
}

/* True unless x is an infinity or a NaN: x - x is zero for every finite x. */
static inline bool an_is_finite(float x)
{
    return x - x == 0.0f;
}

#endif
