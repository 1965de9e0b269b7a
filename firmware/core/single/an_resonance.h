/* One resonance on a smooth background, fitted to a measured frequency response.
 *
 * H(x) = (p0 + p1 x + p2 x^2) / (1 + q x), x = (f - centre) / span in [-1, 1]: the pole gives frequency and time
 * constant, its residue the gain, and what neighbours and feed-through add stays in the numerator. Linear least
 * squares, weighted anew by the last denominator until it settles (Sanathanan and Koerner).
 */
#ifndef AN_RESONANCE_H
#define AN_RESONANCE_H

#include "an_types.h"

enum { AN_RESONANCE_POINTS = 33 };

typedef struct {
    float offset_hz;   /* of the resonance from the centre */
    float tau_s;
    an_complex gain;
    float misfit;      /* rms of the residual over rms of the response */
} an_resonance;

/* points responses at evenly spaced frequencies from centre - span to centre + span; 6 to AN_RESONANCE_POINTS of them.
 * False when the system is singular or the pole is not that of a decaying motion. */
bool an_resonance_fit(an_resonance *fit, const an_complex *response, uint32_t points, float span_hz);

#endif
