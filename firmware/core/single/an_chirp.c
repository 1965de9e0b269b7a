#include "an_chirp.h"

#include "an_complex.h"
#include "an_sine.h"

static void begin_step(an_chirp *chirp, const an_chirp_request *plan)
{
    chirp->waited = 0u;
    chirp->index++;
    if (chirp->begun++ == 0u || chirp->index >= plan->steps) {
        chirp->index = 0u;
        chirp->phase = 0u;
        chirp->advance = plan->advance;
    } else {
        chirp->phase += chirp->advance;
        chirp->advance += plan->growth;
    }
}

an_complex an_chirp_step(an_chirp *chirp, const an_chirp_request *plan, an_complex drive)
{
    chirp->waited++;
    if (chirp->begun == 0u || chirp->waited >= plan->every) {
        begin_step(chirp, plan);
    }
    const bool ended = chirp->begun > plan->settle + (uint32_t)AN_CHIRP_ROWS;
    return ended ? an_cplx(0.0f, 0.0f) : an_mul(drive, an_turn(chirp->phase));
}
