/* What the converters saw and were told, sample by sample, for a while: what finds a fault of the wiring. */
#ifndef AN_CAPTURE_H
#define AN_CAPTURE_H

#include "an_types.h"

enum { AN_CAPTURE_ROOM = 2048, AN_CAPTURE_EVERY_MAX = 250000 }; /* words of 16 bits */

typedef struct {
    uint32_t row;     /* words: the channels' inputs, then their outputs */
    uint32_t total;   /* words of all rows that there is room for */
    uint32_t used;    /* so far; written by the interrupt once it runs */
    uint32_t every;   /* samples a row, 0: no capture */
    uint32_t waited;
    uint16_t words[AN_CAPTURE_ROOM];
} an_capture;

/* For so many channels, one input and one output each. */
void an_capture_init(an_capture *capture, uint32_t channels);

/* Takes a row at each so many samples from now on, until there is no more room. Only while none is being taken or the one
 * before may be given up. False for 0 and beyond AN_CAPTURE_EVERY_MAX. */
bool an_capture_begin(an_capture *capture, uint32_t every);

/* Words that are complete. */
uint32_t an_capture_used(const an_capture *capture);

/* A sample, in the interrupt: so many words each as were channels. */
void an_capture_take(an_capture *capture, const uint16_t *inputs, const uint16_t *outputs);

#endif
