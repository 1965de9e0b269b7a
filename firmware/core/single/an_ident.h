/* Identification of the target mode by a sweep: frequency, time constant, gain, delay.
 *
 * A coarse sweep at a low level runs outwards from the guess, to 4 % on either side, until it has passed a peak well
 * above the noise and above the median response. While only noise is seen, the drive stays below a sixth of its limit.
 * At the peak, the level is raised in steps, and the response must rise in proportion. A resonance is fitted to a fine
 * sweep around the peak; the sweep is repeated until frequency and time constant agree with those it was planned for.
 * If no resonance fits, because the plate's resonance shifts with its amplitude, or if the gain is clearly below that of
 * the coarse sweep, because the amplifier clips, the sweep is repeated at a quarter of the level, at most
 * AN_IDENT_REPEATS times.
 * Finally, a survey of the neighbouring frequencies finds the strongest response that the target mode does not explain,
 * which limits the loop gain. Identification runs in the main loop and requests one steady-state measurement at a time.
 */
#ifndef AN_IDENT_H
#define AN_IDENT_H

#include "an_pi.h"
#include "an_resonance.h"
#include "an_types.h"

typedef enum {
    AN_IDENT_COARSE,
    AN_IDENT_RAISE,
    AN_IDENT_FINE,
    AN_IDENT_SURVEY,
    AN_IDENT_CHECK,
    AN_IDENT_DONE,
    AN_IDENT_FAILED,
    AN_IDENT_AGREES, /* after a check */
    AN_IDENT_DIFFERS
} an_ident_stage;

enum { AN_IDENT_BINS = 48, AN_IDENT_REPEATS = 2 };

/* One measurement: drive at a constant level and phase step, wait for the response to settle, then average. */
typedef struct {
    uint32_t step;
    float level;
    float settle_s;
    uint32_t average; /* windows */
} an_probe;

typedef struct {
    an_mode mode; /* first the guess, then the result */
    float sample_rate_hz;
    uint32_t quarter_turns; /* phase lag of the sensor signal behind velocity: 1 for displacement */
    an_ident_stage stage;
    uint32_t rounds;
    uint32_t centre; /* phase step */
    float guess_tau_s;
    float elapsed_s;
    float spacing_hz; /* coarse */
    float span_hz;    /* fine and survey, to either side */
    float level;
    bool lowered; /* the response was too strong before, so the level must not be raised again */
    uint32_t points;
    uint32_t index;
    uint32_t best;
    float best_size;
    float last_size[2]; /* coarse: outermost responses below and above the guess */
    float noise2; /* coarse and survey: variance of a mean due to noise, summed over the points */
    uint16_t sizes[AN_IDENT_BINS]; /* coarse: histogram of responses in half octaves */
    float coarse_gain; /* largest response of the coarse sweep over its drive */
    uint32_t repeats; /* fine sweeps at a lower level so far */
    float motion;     /* largest response in the last fine sweep, fraction of full scale */
    float misfit;
    float neighbour; /* largest response not due to the target mode, sensor over drive */
    an_complex response[AN_RESONANCE_POINTS];
} an_ident;

/* Start from a guess; its gain is not used. */
void an_ident_init(an_ident *ident, const an_mode *guess, bool senses_displacement, float sample_rate_hz);

/* Start a check of a known mode instead: one measurement at its resonance, at a low level. Another plate, or the same
 * plate far from its known resonance, responds differently. */
void an_ident_check(an_ident *ident, const an_mode *known, uint32_t centre, float sample_rate_hz);

/* Return the next measurement; valid until the stage is AN_IDENT_DONE or beyond. */
void an_ident_probe(const an_ident *ident, an_probe *probe);

/* Process the result of a measurement: the mean phasor, and its variance due to noise. */
void an_ident_answer(an_ident *ident, an_complex measured, float noise2);

#endif
