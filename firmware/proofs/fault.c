/* One tick of the single-mode build in which a fault is known, from any state and any sample. */
#include "an_any.h"
#include "an_fast.h"

static an_fast fast;

void main(void)
{
    AN_ANY(fast);
    fast.tick = AN_FROM(0u, AN_PERIOD - 1u);
    fast.faults = AN_FROM(1u, 0xFFFFFFFFu);
    fast.drive.re = AN_LEVEL();
    fast.drive.im = AN_LEVEL();
    const uint32_t code = an_fast_tick(&fast, AN_FROM(0u, 4095u));
    //@ assert a_fault_sets_the_output_to_rest: code == AN_DAC_MIDDLE;
}
