/* Fast tick of the single-mode build: one sample in, one sample out.
 *
 * Time is divided into periods of AN_PERIOD ticks. The slow step computes its command during the first AN_GAP ticks. At
 * the end of this gap the command takes effect, the sums are cleared and the measurement window begins, so that phase
 * step and drive are constant over a window.
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
    AN_ADC_MARGIN = 8, /* codes at each end of the range that count as clipped */
    AN_DAC_MIDDLE = 2048,
    AN_DAC_SWING = 2047,
    AN_RECENT = 64, /* a power of two above AN_PERIOD, so that the index can be masked */
    AN_RECENT_MASK = AN_RECENT - 1
};

/* Results that the fast tick hands to the slow step at the end of a window. */
typedef struct {
    an_sums sums;
    uint32_t last_phase;
    uint32_t clipped; /* samples near an end of the ADC's range, including those of the preceding gap */
    uint32_t count;   /* windows so far */
} an_window;

/* Command that the slow step hands back. */
typedef struct {
    an_complex drive; /* phasor in DAC codes, phase relative to the sample's */
    uint32_t step;
    uint32_t count; /* the window that this command answers */
} an_command;

typedef struct {
    uint32_t phase;
    uint32_t step;
    an_complex drive;
    an_sums sums;
    uint32_t tick;
    uint32_t clipped;
    uint32_t faults; /* set at the fast tick's priority, cleared by the slow step; nonzero: output at rest */
    an_window window;
    an_command command;
    float recent[AN_RECENT]; /* samples by tick, codes from mid-scale: this period's, then those left from the last */
} an_fast;

void an_fast_init(an_fast *fast, uint32_t step);

/* Process an ADC code and return a DAC code (1 to 4095). A window has ended when fast->window.count has changed. */
uint32_t an_fast_tick(an_fast *fast, uint32_t adc);

#endif
