/* One step of a texture that a host has set, after any number of steps. */
#include "an_any.h"
#include "an_texture.h"

static an_texture texture;

void main(void)
{
    an_texture_init(&texture);
    if (Frama_C_nondet(0, 1)) {
        an_texture_sine(&texture, AN_LEVEL(), AN_LEVEL(), 5000.0f);
    } else {
        an_texture_stream(&texture, AN_FROM(0u, 0xFFFFFFFFu));
    }
    texture.phase = AN_FROM(0u, 0xFFFFFFFFu);
    texture.taken = AN_FROM(0u, 0xFFFFFFFFu);
    texture.given = AN_FROM(0u, 0xFFFFFFFFu);
    texture.waited = AN_FROM(0u, 0xFFFFFFFFu);
    AN_ANY(texture.samples);
    an_texture_give(&texture, AN_FROM(0u, 0xFFFFFFFFu));
    const float factor = an_texture_step(&texture);
    //@ assert nothing_beyond_the_reference: -0.01f <= factor <= 1.01f;
}
