/* Identification of the target mode by a sweep: frequency, time constant, gain, delay.
 *
 * A coarse sweep at a low level goes outward from the guess, to 4 % on either side, until it has passed a peak well above
 * its own noise and the median of all it saw; noise alone is never driven at more than a sixth of the drive limit. At the
 * peak the level is raised in steps, each of which must answer in proportion. A fine sweep about it is fitted, and
 * repeated while it shows that it was planned with a wrong frequency or time constant. A survey of the surroundings then tells how
 * strongly the plate answers other than by the target mode, which bounds the gain of the loop. Runs in the main
 * loop: it asks for one steady measurement at a time.
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
    AN_IDENT_DONE,
    AN_IDENT_FAILED
} an_ident_stage;

enum { AN_IDENT_BINS = 48 };

/* A measurement to be made: constant drive at a step, wait, then average. */
typedef struct {
    uint32_t step;
    float level;
    float settle_s;
    uint32_t average; /* windows */
} an_probe;

typedef struct {
    an_mode mode; /* as guessed, then as found */
    float sample_rate_hz;
    uint32_t quarter_turns; /* of the sensor behind velocity: 1 for displacement */
    an_ident_stage stage;
    uint32_t rounds;
    uint32_t centre; /* phase step */
    float guess_tau_s;
    float elapsed_s;
    float spacing_hz; /* coarse */
    float span_hz;    /* fine, survey: to either side */
    float level;
    bool lowered; /* the plate answered too strongly before: not to be driven harder again */
    uint32_t points;
    uint32_t index;
    uint32_t best;
    float best_size;
    float last_size[2]; /* coarse: outermost below, above the guess */
    float noise2; /* coarse: sum over the points of the noise's square in a mean */
    uint16_t sizes[AN_IDENT_BINS]; /* coarse: responses by size, in half octaves */
    float misfit;
    float neighbour; /* largest response beside the target mode's, sensor over drive */
    an_complex response[AN_RESONANCE_POINTS];
} an_ident;

/* Begins from a guess whose gain is not used. */
void an_ident_init(an_ident *ident, const an_mode *guess, bool senses_displacement, float sample_rate_hz);

/* The next measurement; meaningful until the stage is done or failed. */
void an_ident_probe(const an_ident *ident, an_probe *probe);

/* Takes its result: the mean measured phasor, and the square that noise has in it. */
void an_ident_answer(an_ident *ident, an_complex measured, float noise2);

#endif
