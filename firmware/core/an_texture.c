#include "an_texture.h"

#include <stdatomic.h>

#include "an_assert.h"
#include "an_bytes.h"
#include "an_dds.h"
#include "an_sine.h"

void an_texture_init(an_texture *texture)
{
    an_clear(texture, sizeof *texture);
    texture->factor = 1.0f;
}

bool an_texture_sine(an_texture *texture, float rate_hz, float depth, float window_hz)
{
    if (!(rate_hz >= 0.0f && rate_hz <= 0.1f * window_hz && depth >= 0.0f && depth <= 1.0f)) {
        return false;
    }
    texture->kind = AN_TEXTURE_PLAIN;
    atomic_signal_fence(memory_order_seq_cst);
    texture->phase = 0u;
    texture->step = an_dds_step(rate_hz, window_hz);
    texture->depth = depth;
    atomic_signal_fence(memory_order_seq_cst);
    texture->kind = AN_TEXTURE_SINE;
    return true;
}

bool an_texture_stream(an_texture *texture, uint32_t every)
{
    if (every < 1u || every > 50000u) {
        return false;
    }
    texture->kind = AN_TEXTURE_PLAIN;
    atomic_signal_fence(memory_order_seq_cst);
    texture->every = every;
    texture->waited = every - 1u;
    texture->taken = 0u;
    texture->given = 0u;
    texture->underruns = 0u;
    texture->factor = 0.0f;
    atomic_signal_fence(memory_order_seq_cst);
    texture->kind = AN_TEXTURE_STREAM;
    return true;
}

void an_texture_end_stream(an_texture *texture)
{
    if (texture->kind == AN_TEXTURE_STREAM) {
        texture->kind = AN_TEXTURE_PLAIN;
    }
}

bool an_texture_give(an_texture *texture, uint32_t sample)
{
    if (texture->kind != AN_TEXTURE_STREAM || texture->given - texture->taken >= AN_TEXTURE_ROOM) {
        return false;
    }
    texture->samples[texture->given % AN_TEXTURE_ROOM] = (uint16_t)sample;
    atomic_signal_fence(memory_order_release);
    texture->given++;
    return true;
}

static float sine_factor(an_texture *texture)
{
    texture->phase += texture->step;
    return 1.0f - texture->depth * (0.5f - 0.5f * an_turn(texture->phase).re);
}

static float stream_factor(an_texture *texture)
{
    texture->waited++;
    if (texture->waited < texture->every) {
        return texture->factor;
    }
    texture->waited = 0u;
    if (texture->taken == texture->given) {
        texture->underruns++;
        return texture->factor;
    }
    const float sample = (float)texture->samples[texture->taken % AN_TEXTURE_ROOM];
    texture->taken++;
    return sample * (1.0f / 65535.0f);
}

float an_texture_step(an_texture *texture)
{
    switch (texture->kind) {
    case AN_TEXTURE_SINE:
        texture->factor = sine_factor(texture);
        break;
    case AN_TEXTURE_STREAM:
        texture->factor = stream_factor(texture);
        break;
    default:
        texture->factor = 1.0f;
        break;
    }
    AN_ASSERT(texture->factor >= 0.0f && texture->factor <= 1.0f);
    return texture->factor;
}
