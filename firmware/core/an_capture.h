/* Recording of the raw converter codes, inputs and outputs, sample by sample: a tool for finding wiring faults.
 *
 * The same memory records the response to a chirp, step by step.
 */
#ifndef AN_CAPTURE_H
#define AN_CAPTURE_H

#include "an_types.h"

enum { AN_CAPTURE_ROOM = 2048, AN_CAPTURE_EVERY_MAX = 250000 }; /* words of 16 bits */

typedef struct {
    uint32_t row;     /* words per row: the inputs of all channels, then their outputs */
    uint32_t total;   /* words in the rows that fit */
    uint32_t used;    /* words recorded; written by the interrupt while a capture runs */
    uint32_t every;   /* samples per row; 0: no capture */
    uint32_t waited;  /* samples since the last row */
    uint32_t begun;   /* steps of a chirp begun when its next response is complete; 0: none is recorded */
    uint16_t words[AN_CAPTURE_ROOM];
} an_capture;

/* Prepare for a number of channels with one input and one output each. */
void an_capture_init(an_capture *capture, uint32_t channels);

/* Record one row every so many samples until the memory is full. Discards an earlier capture. Returns false unless
 * every is from 1 to AN_CAPTURE_EVERY_MAX. */
bool an_capture_begin(an_capture *capture, uint32_t every);

/* Number of words recorded in complete rows. */
uint32_t an_capture_used(const an_capture *capture);

/* Process one sample, one word per channel in each array; called from the interrupt. */
void an_capture_take(an_capture *capture, const uint16_t *inputs, const uint16_t *outputs);

/* Record the responses to the steps of a chirp, after those to settle, until the memory is full. Discards an earlier
 * capture. */
void an_capture_begin_chirp(an_capture *capture, uint32_t settle);

/* Process the end of a window in which a chirp has begun so many steps: one word per channel in each array; called from
 * the interrupt of the slow step. */
void an_capture_take_response(an_capture *capture, uint32_t begun, const uint16_t *re, const uint16_t *im);

#endif
