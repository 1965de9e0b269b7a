/* The envelope of the amplitude: a factor from 0 to 1 a window, a sine or samples sent by the host. */
#ifndef AN_TEXTURE_H
#define AN_TEXTURE_H

#include "an_types.h"

typedef enum { AN_TEXTURE_PLAIN, AN_TEXTURE_SINE, AN_TEXTURE_STREAM } an_texture_kind;
enum { AN_TEXTURE_ROOM = 256 }; /* samples; a power of two */

typedef struct {
    an_texture_kind kind;
    uint32_t phase;
    uint32_t step; /* sine: phase a window */
    float depth;   /* sine: from 1 down to 1 - depth */
    uint32_t every; /* stream: windows a sample lasts */
    uint32_t waited;
    uint32_t taken;
    uint32_t given;
    uint32_t underruns; /* stream: samples that were not there in time; the last one stayed */
    float factor;
    uint16_t samples[AN_TEXTURE_ROOM]; /* 65535 = 1 */
} an_texture;

void an_texture_init(an_texture *texture);

/* rate_hz from 0 to a tenth of the window rate, depth from 0 to 1. False, and nothing changed, otherwise. */
bool an_texture_sine(an_texture *texture, float rate_hz, float depth, float window_hz);

/* Samples follow, each for so many windows (1 to 50000). */
bool an_texture_stream(an_texture *texture, uint32_t every);

/* The job that it was for is over: the next one begins with the whole amplitude. */
void an_texture_end_stream(an_texture *texture);

/* Adds one sample; false when there is no room. Main loop. */
bool an_texture_give(an_texture *texture, uint32_t sample);

/* The factor of the next window. Called once a window, in the slow step's interrupt. */
float an_texture_step(an_texture *texture);

#endif
