/* Fast tick of the six-channel build: six samples in, six duty cycles out, one carrier for all channels.
 *
 * A period consists of a gap, in which the slow step computes its command, and a measurement window, as in an_fast.h;
 * the length of the window depends on the frequency.
 */
#ifndef AN_SIX_FAST_H
#define AN_SIX_FAST_H

#include "an_demod.h"
#include "an_types.h"

enum {
    AN_SIX = 6,
    AN_SIX_GAP = 4,
    AN_SIX_GAP_BANK = 2,  /* bank of sums for samples of the gap, never read */
    AN_SIX_REST_BANK = 2, /* bank of drives at zero, never written */
    AN_SIX_ADC_MIDDLE = 2048,
    AN_SIX_ADC_MARGIN = 8,    /* codes at each end of the range that count as clipped */
    AN_SIX_CLIPPED_MAX = 2,   /* samples in two windows */
    AN_SIX_DUTY_MIDDLE = 1125, /* half of the timer's range */
    AN_SIX_DUTY_SWING = 1080   /* leaves each low-side switch enough on-time to recharge the bootstrap driver */
};

typedef struct {
    uint32_t bank; /* index of the sums */
    uint32_t last_phase;
    uint32_t clipped; /* samples near an end of the ADC's range, all channels, including the preceding gap */
    uint32_t count;
} an_six_window;

typedef struct {
    uint32_t bank; /* index of the drives */
    uint32_t step;
    uint32_t window; /* ticks */
    uint32_t count;
} an_six_command;

typedef struct {
    uint32_t phase;
    uint32_t step;
    an_complex drive[3][AN_SIX]; /* banks: one acting, one in preparation, one zero */
    an_sums sums[3][AN_SIX];     /* banks: one growing, one read and cleared by the slow step, one for the gap */
    uint32_t acting;
    uint32_t growing;
    uint32_t tick;
    uint32_t end; /* tick at the end of the window */
    uint32_t clipped;
    uint32_t faults;
    an_six_window window;
    an_six_command command;
} an_six_fast;

void an_six_fast_init(an_six_fast *fast, uint32_t step, uint32_t window);

/* Process six samples and return six duty cycles. A window has ended when fast->window.count has changed; fast->tick is
 * then 0. */
void an_six_tick(an_six_fast *fast, const uint16_t *adc, uint16_t *duty);

#endif
