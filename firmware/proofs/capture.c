/* One row of a capture, from any state of its counters. */
#include "an_any.h"
#include "an_capture.h"

static an_capture capture;
static uint16_t inputs[6];
static uint16_t outputs[6];

void main(void)
{
    an_capture_init(&capture, Frama_C_nondet(1, 6));
    capture.used = AN_FROM(0u, 0xFFFFFFFFu);
    capture.every = AN_FROM(0u, 0xFFFFFFFFu);
    capture.waited = AN_FROM(0u, 0xFFFFFFFFu);
    an_capture_take(&capture, inputs, outputs);
}
