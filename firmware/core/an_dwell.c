#include "an_dwell.h"

#include <stdatomic.h>

bool an_dwell_finished(const an_dwell *dwell)
{
    const volatile uint32_t *finished = &dwell->finished;
    const bool complete = *finished != 0u;
    atomic_signal_fence(memory_order_acquire);
    return complete;
}
