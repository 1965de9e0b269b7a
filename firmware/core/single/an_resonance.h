/* Fit of one resonance on a smooth background to a measured frequency response.
 *
 *     H(x) = (p0 + p1 x + p2 x^2) / (1 + q x),    x = (f - centre) / span in [-1, 1].
 *
 * The pole gives frequency and time constant, its residue the gain; the rest of the numerator absorbs neighbouring
 * modes and feedthrough. The coefficients solve a linear least-squares problem, weighted with the denominator of the
 * previous iteration (sanathanan1963, docs/references.bib).
 */
#ifndef AN_RESONANCE_H
#define AN_RESONANCE_H

#include "an_types.h"

enum { AN_RESONANCE_POINTS = 33 };

typedef struct {
    float offset_hz;   /* from the centre to the resonance */
    float tau_s;
    an_complex gain;
    float misfit;      /* rms of the residual over rms of the response */
} an_resonance;

/* Fit points responses (6 to AN_RESONANCE_POINTS) at equally spaced frequencies from centre - span to centre + span.
 * Returns false if the system is singular or the pole does not belong to a decaying motion. */
bool an_resonance_fit(an_resonance *fit, const an_complex *response, uint32_t points, float span_hz);

#endif
