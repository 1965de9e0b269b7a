#include "an_capture.h"

#include <stdatomic.h>

void an_capture_init(an_capture *capture, uint32_t channels)
{
    capture->row = 2u * channels;
    capture->total = AN_CAPTURE_ROOM / capture->row * capture->row;
    capture->used = 0u;
    capture->every = 0u;
}

bool an_capture_begin(an_capture *capture, uint32_t every)
{
    if (every == 0u || every > AN_CAPTURE_EVERY_MAX) {
        return false;
    }
    volatile uint32_t *requested = &capture->every;
    *requested = 0u;
    atomic_signal_fence(memory_order_seq_cst);
    capture->used = 0u;
    capture->waited = every - 1u;
    atomic_signal_fence(memory_order_seq_cst);
    *requested = every;
    return true;
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

/* Asked before a row is written as well: a damaged word leads nowhere else. */
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
