/* One tick of the six-channel build, from any state and any samples. */
#include "an_any.h"
#include "an_six_fast.h"

static an_six_fast fast;
static uint16_t adc[AN_SIX];
static uint16_t duty[AN_SIX];

void main(void)
{
    AN_ANY(fast);
    for (uint32_t i = 0u; i < AN_SIX; i++) {
        adc[i] = (uint16_t)AN_FROM(0u, 4095u);
        for (uint32_t bank = 0u; bank < 3u; bank++) {
            fast.drive[bank][i].re = AN_LEVEL();
            fast.drive[bank][i].im = AN_LEVEL();
        }
    }
    an_six_tick(&fast, adc, duty);
    for (uint32_t i = 0u; i < AN_SIX; i++) {
        //@ assert the_low_side_keeps_its_time: duty[i] <= AN_SIX_DUTY_MIDDLE + AN_SIX_DUTY_SWING;
        //@ assert the_duty_is_not_negative: AN_SIX_DUTY_MIDDLE - AN_SIX_DUTY_SWING <= duty[i];
    }
}
