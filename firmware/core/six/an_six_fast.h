/* The fast tick of the six-channel build: six samples in, six duty cycles out, one carrier for all.
 *
 * Periods as in an_fast.h, but of a length that fits the frequency: a gap in which the slow step answers, then a
 * window.
 */
#ifndef AN_SIX_FAST_H
#define AN_SIX_FAST_H

#include "an_demod.h"
#include "an_types.h"

enum {
    AN_SIX = 6,
    AN_SIX_GAP = 4,
    AN_SIX_GAP_BANK = 2,  /* of the sums; nobody reads it */
    AN_SIX_REST_BANK = 2, /* of the drives; nobody writes it */
    AN_SIX_ADC_MIDDLE = 2048,
    AN_SIX_ADC_MARGIN = 8,    /* so many codes at each end count as clipped */
    AN_SIX_CLIPPED_MAX = 2,   /* samples of two windows */
    AN_SIX_DUTY_MIDDLE = 1125, /* half of the timer's range */
    AN_SIX_DUTY_SWING = 1080   /* leaves every half-bridge's lower switch some time to recharge its driver */
};

typedef struct {
    uint32_t bank; /* which of the sums */
    uint32_t last_phase;
    uint32_t clipped; /* samples near an end of the converter, all channels, those of the gap before among them */
    uint32_t count;
} an_six_window;

typedef struct {
    uint32_t bank; /* which of the drives */
    uint32_t step;
    uint32_t window; /* ticks */
    uint32_t count;
} an_six_command;

typedef struct {
    uint32_t phase;
    uint32_t step;
    an_complex drive[3][AN_SIX]; /* one acts, one is being prepared, one is zero */
    an_sums sums[3][AN_SIX];     /* one grows, one is read and cleared by the slow step, one takes the gap's samples */
    uint32_t acting;
    uint32_t growing;
    uint32_t tick;
    uint32_t end; /* the tick that ends the window */
    uint32_t clipped;
    uint32_t faults;
    an_six_window window;
    an_six_command command;
} an_six_fast;

void an_six_fast_init(an_six_fast *fast, uint32_t step, uint32_t window);

/* A window has ended when fast->window.count has moved; fast->tick is 0 then. */
void an_six_tick(an_six_fast *fast, const uint16_t *adc, uint16_t *duty);

#endif
