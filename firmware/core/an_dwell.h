/* Windows of a dwell: first the plate settles, then its motion is averaged. */
#ifndef AN_DWELL_H
#define AN_DWELL_H

#include "an_types.h"

typedef struct {
    uint32_t waited;   /* windows so far */
    uint32_t finished; /* set when the average is complete */
} an_dwell;

/* True if the average is complete and may be read. */
bool an_dwell_finished(const an_dwell *dwell);

#endif
