/* Demodulation of one tone by least squares over three unknowns: cosine, sine and offset.
 *
 * Over a window of N samples x = a cos(p) - b sin(p) + c with p the phase of each sample, the sums of x cos p, x
 * sin p and x determine a, b, c exactly at any frequency: no leakage of the offset, no need for whole periods.
 * Turned to the middle of the window the normal equations split, and their entries are Dirichlet kernels, known
 * once the step is.
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
    uint32_t back; /* phase from the last sample back to the middle of the window */
    float cosine_cosine;
    float cosine_offset;
    float offset_offset;
    float sine_sine;
} an_demod;

typedef struct {
    an_complex tone; /* a + j b */
    float offset;    /* c */
} an_phasor;

/* Plans the fit of a phase step over a window; scale multiplies every result (1 / full scale in counts).
 * False when the window is too short or the step too near 0 or half a turn to tell the three apart. */
bool an_demod_plan(an_demod *demod, uint32_t step, uint32_t window, float scale);

/* The fit; last_phase is the phase of the window's last sample. */
an_phasor an_demod_fit(const an_demod *demod, const an_sums *sums, uint32_t last_phase);

#endif
