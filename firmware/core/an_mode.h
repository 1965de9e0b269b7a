/* One resonance of the plate, from the mode table or from identification. */
#ifndef AN_MODE_H
#define AN_MODE_H

#include "an_types.h"

#define AN_IDENTIFY_MAX_S 60.0f /* longest identification, whatever time constant the table gives */

typedef struct {
    float frequency_hz;
    float tau_s;
    an_complex gain; /* G: sensor over drive at resonance, corrected for the delay */
    float delay_s;
    float drive_limit;
    float amplitude_limit;
    float metres; /* at full scale of the sensor, 0: unknown */
} an_mode;

#endif
