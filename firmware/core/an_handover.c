#include "an_handover.h"

#include <stdatomic.h>

bool an_handover_vacant(const an_handover *hand)
{
    const volatile uint32_t *active = &hand->active;
    const bool vacant = *active == hand->posted;
    atomic_signal_fence(memory_order_acquire);
    return vacant;
}

void an_handover_post(an_handover *hand)
{
    atomic_signal_fence(memory_order_release);
    hand->posted ^= 1u;
}
