/* The fast tick of the single-mode build: one sample in, one sample out.
 *
 * Time is cut into periods of AN_PERIOD ticks. The first AN_GAP ticks belong to the slow step: at their end its
 * command is taken over, the sums are cleared, and the measured window begins. Phase step and drive are thus
 * constant over a window.
 */
#ifndef AN_FAST_H
#define AN_FAST_H

#include "an_demod.h"
#include "an_types.h"

enum {
    AN_PERIOD = 50,
    AN_GAP = 4,
    AN_WINDOW = AN_PERIOD - AN_GAP,
    AN_ADC_MIDDLE = 2048,
    AN_ADC_MARGIN = 8, /* so many codes at each end count as clipped */
    AN_DAC_MIDDLE = 2048,
    AN_DAC_SWING = 2047,
    AN_RECENT = 64, /* a power of two above AN_PERIOD: no damaged tick leads out of it */
    AN_RECENT_MASK = AN_RECENT - 1
};

/* What the fast tick hands to the slow step at the end of a window. */
typedef struct {
    an_sums sums;
    uint32_t last_phase;
    uint32_t clipped; /* samples near an end of the converter, those of the gap before among them */
    uint32_t count;   /* windows so far */
} an_window;

/* What the slow step hands back. */
typedef struct {
    an_complex drive; /* codes, phase relative to the sample's */
    uint32_t step;
    uint32_t count; /* the window this answers */
} an_command;

typedef struct {
    uint32_t phase;
    uint32_t step;
    an_complex drive;
    an_sums sums;
    uint32_t tick;
    uint32_t clipped;
    uint32_t faults; /* set by the fast tick and whatever else has its priority, cleared by the slow step; rests the output */
    an_window window;
    an_command command;
    float recent[AN_RECENT]; /* the period's samples by their tick, counts from the middle; behind them the last period's */
} an_fast;

void an_fast_init(an_fast *fast, uint32_t step);

/* ADC code in, DAC code out (1 to 4095). A window has ended when fast->window.count has moved. */
uint32_t an_fast_tick(an_fast *fast, uint32_t adc);

#endif
