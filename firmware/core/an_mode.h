/* One resonance of the plate, as a table describes it or identification found it. */
#ifndef AN_MODE_H
#define AN_MODE_H

#include "an_types.h"

#define AN_IDENTIFY_MAX_S 60.0f /* all that an identification takes, whatever a table says of the decay */

typedef struct {
    float frequency_hz;
    float tau_s;
    an_complex gain; /* sensor over drive at resonance, the delay taken out */
    float delay_s;
    float drive_limit;
    float amplitude_limit;
} an_mode;

#endif
