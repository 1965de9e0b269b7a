/* Frames on the serial line: a message and its CRC-32, byte-stuffed (COBS) so that a zero byte only ever ends a frame.
 *
 * Content: kind, sequence, payload and the CRC-32 of these, little-endian. A receiver that starts in mid-stream or
 * loses bytes resynchronises at the next zero.
 */
#ifndef AN_FRAME_H
#define AN_FRAME_H

#include "an_wire.h"

enum {
    AN_FRAME_CONTENT = AN_PAYLOAD_MAX + 6,
    AN_FRAME_BYTES = AN_FRAME_CONTENT + 2 /* encoded, including the final zero */
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
    uint32_t refused; /* damaged or oversized frames so far */
} an_frame_reader;

void an_frame_reader_init(an_frame_reader *reader);

/* Process one byte. Returns true if it completed a valid frame, which is then in message. */
bool an_frame_feed(an_frame_reader *reader, uint8_t byte, an_message *message);

/* Encode a message into frame (AN_FRAME_BYTES). Returns the number of bytes used, or 0 if the payload is longer than
 * AN_PAYLOAD_MAX. */
uint32_t an_frame_write(uint8_t *frame, const an_message *message);

#endif
