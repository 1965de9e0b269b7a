/* One tick of the single-mode build, from any state and any sample. */
#include "an_any.h"
#include "an_fast.h"

static an_fast fast;

void main(void)
{
    AN_ANY(fast);
    fast.tick = AN_FROM(0u, AN_PERIOD - 1u);
    fast.drive.re = AN_LEVEL();
    fast.drive.im = AN_LEVEL();
    const uint32_t code = an_fast_tick(&fast, AN_FROM(0u, 4095u));
    //@ assert the_code_is_one_of_the_converter: 1 <= code <= 4095;
    //@ assert the_tick_stays_in_its_period: fast.tick < AN_PERIOD;
}
