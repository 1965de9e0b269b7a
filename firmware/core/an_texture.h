/* Envelope of the vibration amplitude: a factor from 0 to 1 per window, from a sine or from samples sent by the
 * host. */
#ifndef AN_TEXTURE_H
#define AN_TEXTURE_H

#include "an_types.h"

typedef enum { AN_TEXTURE_PLAIN, AN_TEXTURE_SINE, AN_TEXTURE_STREAM } an_texture_kind;
enum { AN_TEXTURE_ROOM = 256 }; /* samples; a power of two */

typedef struct {
    an_texture_kind kind;
    uint32_t phase;
    uint32_t step; /* sine: phase per window */
    float depth;   /* sine: the factor varies between 1 and 1 - depth */
    uint32_t every; /* stream: windows per sample */
    uint32_t waited; /* stream: windows since the last sample */
    uint32_t taken; /* stream: samples used by the slow step */
    uint32_t given; /* stream: samples added by the main loop */
    uint32_t underruns; /* stream: late samples; the previous one was held */
    float factor;
    uint16_t samples[AN_TEXTURE_ROOM]; /* 65535 = 1 */
} an_texture;

void an_texture_init(an_texture *texture);

/* Select a sine; rate_hz from 0 to a tenth of the window rate, depth from 0 to 1. Otherwise returns false, with no
 * change. */
bool an_texture_sine(an_texture *texture, float rate_hz, float depth, float window_hz);

/* Select a stream of samples that follow; each lasts every windows (1 to 50000). */
bool an_texture_stream(an_texture *texture, uint32_t every);

/* End a stream with its job: the next job starts at full amplitude. */
void an_texture_end_stream(an_texture *texture);

/* Add one sample, from the main loop. Returns false if there is no room. */
bool an_texture_give(an_texture *texture, uint32_t sample);

/* Return the factor of the next window; called once per window from the slow interrupt. */
float an_texture_step(an_texture *texture);

#endif
