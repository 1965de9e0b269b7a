/* Chirp: a periodic sweep of the drive about a fixed carrier, which the host evaluates.
 *
 * The drive keeps its amplitude and changes its phase every few windows, by an advance that grows with each step. The
 * response to a period is recorded step by step once the plate has settled, and the drive ends by itself.
 */
#ifndef AN_CHIRP_H
#define AN_CHIRP_H

#include "an_capture.h"
#include "an_types.h"
#include "an_wire.h"

_Static_assert(2 * (int)AN_CHIRP_ROWS == (int)AN_CAPTURE_ROOM, "a row of two words per step");

typedef struct {
    uint32_t phase;   /* of the drive, relative to the carrier */
    uint32_t advance; /* of the phase, at the next step */
    uint32_t index;   /* step within the period */
    uint32_t waited;  /* windows since the last step */
    uint32_t begun;   /* steps begun so far; the other members count from the first one */
} an_chirp;

/* One window: return the next drive. With no step begun it is the first one; it is zero once AN_CHIRP_ROWS steps have
 * followed those to settle. */
an_complex an_chirp_step(an_chirp *chirp, const an_chirp_request *plan, an_complex drive);

#endif
