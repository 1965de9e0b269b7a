/* Demodulation at the excitation frequency by least squares with three unknowns: cosine, sine and offset.
 *
 * The N samples of a window are modelled as x = a cos(p) - b sin(p) + c, where p is the phase of each sample. The sums
 * of x cos p, x sin p and x determine a, b and c exactly at any frequency: the offset does not leak into the amplitude,
 * and a window need not hold a whole number of periods. With the phase measured from the middle of the window, sine
 * decouples from cosine and offset. The remaining entries of the normal equations are Dirichlet kernels of the phase
 * step, so an_demod_plan inverts them once per frequency.
 */
#ifndef AN_DEMOD_H
#define AN_DEMOD_H

#include "an_types.h"

typedef struct {
    float cosine; /* sum of x cos p */
    float sine;   /* sum of x sin p */
    float offset; /* sum of x */
} an_sums;

typedef struct {
    uint32_t back; /* phase from the middle of the window to the last sample */
    float cosine_cosine; /* entries of the inverse normal matrix, scaled; cosine_offset with its sign reversed */
    float cosine_offset;
    float offset_offset;
    float sine_sine;
} an_demod;

typedef struct {
    an_complex tone; /* a + j b */
    float offset;    /* c */
} an_phasor;

/* Prepare the fit for a phase step and window length; scale multiplies every result (1 / full scale in counts). Returns
 * false if the window is too short, or the step too close to 0 or half a turn, to separate the three unknowns. */
bool an_demod_plan(an_demod *demod, uint32_t step, uint32_t window, float scale);

/* Fit one window; last_phase is the phase of its last sample. */
an_phasor an_demod_fit(const an_demod *demod, const an_sums *sums, uint32_t last_phase);

#endif
