#include "an_capture.h"

#include <stdatomic.h>

void an_capture_init(an_capture *capture, uint32_t channels)
{
    capture->row = 2u * channels;
    capture->total = AN_CAPTURE_ROOM / capture->row * capture->row;
    capture->used = 0u;
    capture->every = 0u;
    capture->begun = 0u;
}

/* End a running capture; the interrupts record nothing from here on. */
static void discard(an_capture *capture)
{
    volatile uint32_t *every = &capture->every;
    volatile uint32_t *begun = &capture->begun;
    *every = 0u;
    *begun = 0u;
    atomic_signal_fence(memory_order_seq_cst);
    capture->used = 0u;
}

static void request(uint32_t *wanted, uint32_t value)
{
    volatile uint32_t *requested = wanted;
    atomic_signal_fence(memory_order_seq_cst);
    *requested = value;
}

bool an_capture_begin(an_capture *capture, uint32_t every)
{
    if (every == 0u || every > AN_CAPTURE_EVERY_MAX) {
        return false;
    }
    discard(capture);
    capture->waited = every - 1u;
    request(&capture->every, every);
    return true;
}

/* The response to a step is complete when the next one has begun. */
void an_capture_begin_chirp(an_capture *capture, uint32_t settle)
{
    discard(capture);
    request(&capture->begun, settle + 2u);
}

uint32_t an_capture_used(const an_capture *capture)
{
    const volatile uint32_t *used = &capture->used;
    const uint32_t complete = *used;
    atomic_signal_fence(memory_order_acquire);
    return complete;
}

static void take_row(an_capture *capture, const uint16_t *inputs, const uint16_t *outputs)
{
    const uint32_t channels = capture->row / 2u;
    uint16_t *to = capture->words + capture->used;
    for (uint32_t i = 0u; i < channels; i++) {
        to[i] = inputs[i];
        to[channels + i] = outputs[i];
    }
    atomic_signal_fence(memory_order_release);
    capture->used += capture->row;
}

/* Also checked before a row is written, so that a corrupted counter cannot lead outside the array. */
static bool has_room(const an_capture *capture)
{
    return capture->row <= (uint32_t)AN_CAPTURE_ROOM && capture->used <= (uint32_t)AN_CAPTURE_ROOM - capture->row;
}

void an_capture_take(an_capture *capture, const uint16_t *inputs, const uint16_t *outputs)
{
    if (capture->every == 0u || ++capture->waited < capture->every) {
        return;
    }
    capture->waited = 0u;
    if (has_room(capture)) {
        take_row(capture, inputs, outputs);
    }
    if (!has_room(capture)) {
        capture->every = 0u;
    }
}

void an_capture_take_response(an_capture *capture, uint32_t begun, const uint16_t *re, const uint16_t *im)
{
    if (capture->begun == 0u || capture->begun != begun) {
        return;
    }
    capture->begun++;
    if (has_room(capture)) {
        take_row(capture, re, im);
    }
    if (!has_room(capture)) {
        capture->begun = 0u;
    }
}
