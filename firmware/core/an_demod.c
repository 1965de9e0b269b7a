#include "an_demod.h"

#include "an_complex.h"
#include "an_sincos.h"

/* Dirichlet kernel: the sum of cos(n theta) over N samples centred on zero, sin(N theta / 2) / sin(theta / 2). */
static float dirichlet(uint32_t half_step, uint32_t window)
{
    const float low = an_turn(half_step).im;
    const float high = an_turn(half_step * window).im;
    const float floor = 1e-4f;
    return low > floor ? high / low : (float)window; /* a step above half a turn is refused */
}

/* With the phase measured from the middle, sum cos p sin p = sum sin p = 0. For cosine and offset the normal matrix is
 * (C, F; F, N), with C = sum cos^2 p = (N + D2) / 2 and F = sum cos p = D1; for the sine it is S = (N - D2) / 2. D1 and
 * D2 are the kernels of the step and of twice the step. */
bool an_demod_plan(an_demod *demod, uint32_t step, uint32_t window, float scale)
{
    const float count = (float)window;
    const float first = dirichlet(step >> 1, window);
    const float second = dirichlet(step, window);
    const float cosines = 0.5f * (count + second);
    const float sines = 0.5f * (count - second);
    const float determinant = count * cosines - first * first;
    if (window < 4u || window > 65536u || !(sines > 0.05f * count) || !(determinant > 0.02f * count * count)) {
        return false;
    }
    demod->back = (uint32_t)(((uint64_t)step * (window - 1u)) >> 1);
    demod->cosine_cosine = scale * count / determinant;
    demod->cosine_offset = scale * first / determinant;
    demod->offset_offset = scale * cosines / determinant;
    demod->sine_sine = scale / sines;
    return true;
}

an_phasor an_demod_fit(const an_demod *demod, const an_sums *sums, uint32_t last_phase)
{
    const an_complex to_middle = an_conj(an_sincos(last_phase - demod->back));
    const an_complex middle = an_mul(an_cplx(sums->cosine, sums->sine), to_middle);
    const an_complex fit = an_cplx(demod->cosine_cosine * middle.re - demod->cosine_offset * sums->offset,
                                   -demod->sine_sine * middle.im);
    an_phasor phasor;
    phasor.tone = an_mul(fit, to_middle);
    phasor.offset = demod->offset_offset * sums->offset - demod->cosine_offset * middle.re;
    return phasor;
}
