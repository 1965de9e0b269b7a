/* Frames on a serial line: a message, its CRC-32, byte-stuffed so that a zero can only mean the end (COBS).
 *
 * Content: kind, sequence, payload, CRC-32 of these, little-endian. A reader that comes in the middle, or loses
 * bytes, is right again after the next zero.
 */
#ifndef AN_FRAME_H
#define AN_FRAME_H

#include "an_types.h"

enum {
    AN_PAYLOAD_MAX = 120,
    AN_FRAME_CONTENT = AN_PAYLOAD_MAX + 6,
    AN_FRAME_BYTES = AN_FRAME_CONTENT + 2 /* encoded, with its zero */
};

typedef struct {
    uint8_t kind;
    uint8_t sequence;
    uint8_t payload[AN_PAYLOAD_MAX];
    uint32_t length; /* of the payload */
} an_message;

typedef struct {
    uint8_t bytes[AN_FRAME_BYTES];
    uint32_t used;
    uint32_t refused; /* frames so far */
} an_frame_reader;

void an_frame_reader_init(an_frame_reader *reader);

/* Takes one byte; true when it completed a sound frame, which then stands in message. */
bool an_frame_feed(an_frame_reader *reader, uint8_t byte, an_message *message);

/* Encodes a message of at most AN_PAYLOAD_MAX; returns how many of the AN_FRAME_BYTES are used, 0 when it is too
 * long. */
uint32_t an_frame_write(uint8_t *frame, const an_message *message);

#endif
