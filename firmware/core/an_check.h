/* What the slow steps of both builds do alike in every window, inline because their time is bounded. */
#ifndef AN_CHECK_H
#define AN_CHECK_H

#include "an_complex.h"
#include "an_dwell.h"
#include "an_handover.h"
#include "an_wire.h"

#define AN_OFFSET_MAX 0.25f /* of full scale */

/* Faults of a measured phasor. The comparisons are negated so that a NaN also trips. */
static inline uint32_t an_check(an_complex tone, float offset, float amplitude_limit2)
{
    uint32_t trips = 0u;
    if (!(an_abs2(tone) <= amplitude_limit2)) {
        trips |= AN_FAULT_AMPLITUDE;
    }
    if (!(__builtin_fabsf(offset) <= AN_OFFSET_MAX)) {
        trips |= AN_FAULT_SENSOR_OFFSET;
    }
    return trips;
}

/* Clear earlier faults if the job says so. */
static inline void an_clear_trips(an_handover *hand, uint32_t clear, uint32_t *faults)
{
    if (clear != 0u) {
        hand->trips = 0u;
        *faults = 0u;
    }
}

/* Count a window of a dwell; true if it belongs to the average. */
static inline bool an_dwell_counts(an_dwell *dwell, uint32_t settle, uint32_t average)
{
    if (dwell->finished != 0u) {
        return false;
    }
    dwell->waited++;
    dwell->finished = dwell->waited >= settle + average;
    return dwell->waited > settle;
}

#endif
