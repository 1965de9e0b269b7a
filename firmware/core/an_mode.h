/* One resonance of the plate, as a table describes it or identification found it. */
#ifndef AN_MODE_H
#define AN_MODE_H

#include "an_types.h"

typedef struct {
    float frequency_hz;
    float tau_s;
    an_complex gain; /* sensor over drive at resonance, the delay taken out */
    float delay_s;
    float drive_limit;
    float amplitude_limit;
} an_mode;

#endif
