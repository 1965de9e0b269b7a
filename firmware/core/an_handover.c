#include "an_handover.h"

#include "an_assert.h"

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
    AN_ASSERT(hand->active == hand->posted); /* otherwise the active job would be overwritten */
    atomic_signal_fence(memory_order_release);
    hand->posted = ~hand->posted;
}

static bool is_one_of_two(uint32_t job)
{
    return job == 0u || job == UINT32_MAX;
}

bool an_handover_is_sound(const an_handover *hand)
{
    return is_one_of_two(hand->active) && is_one_of_two(hand->posted);
}

/* If an interrupt intervenes, the exclusive store fails and is retried. */
void an_handover_trip(uint32_t *faults, uint32_t found)
{
    __atomic_fetch_or(faults, found, __ATOMIC_RELAXED);
}
