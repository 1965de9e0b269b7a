#include "an_frame.h"

#include "an_bytes.h"
#include "an_crc.h"

enum { HEAD = 2, CRC = 4 };

void an_frame_reader_init(an_frame_reader *reader)
{
    reader->used = 0u;
    reader->refused = 0u;
}

/* Decode in place. Each code byte gives the distance to the next one; all but the first replace a zero of the content.
 * Returns the length of the content, or 0 if the last code does not end with the last byte. */
static uint32_t cobs_decode(uint8_t *bytes, uint32_t length)
{
    uint32_t from = 0u;
    uint32_t to = 0u;
    while (from < length) {
        const uint32_t code = bytes[from];
        if (code == 0u || from + code > length) {
            return 0u;
        }
        for (uint32_t i = 1u; i < code; i++) {
            bytes[to++] = bytes[from + i];
        }
        from += code;
        if (from < length) {
            bytes[to++] = 0u;
        }
    }
    return to;
}

static bool parse(an_frame_reader *reader, an_message *message)
{
    const uint32_t content = cobs_decode(reader->bytes, reader->used);
    if (content < HEAD + CRC || content > AN_FRAME_CONTENT) {
        return false;
    }
    const uint32_t body = content - CRC;
    if (an_crc32(reader->bytes, body) != an_get32(reader->bytes + body)) {
        return false;
    }
    message->kind = reader->bytes[0];
    message->sequence = reader->bytes[1];
    message->length = body - HEAD;
    for (uint32_t i = 0u; i < message->length; i++) {
        message->payload[i] = reader->bytes[HEAD + i];
    }
    return true;
}

bool an_frame_feed(an_frame_reader *reader, uint8_t byte, an_message *message)
{
    if (byte != 0u) {
        if (reader->used < AN_FRAME_BYTES) {
            reader->bytes[reader->used] = byte;
        }
        reader->used += reader->used <= AN_FRAME_BYTES ? 1u : 0u;
        return false;
    }
    const bool fits = reader->used <= AN_FRAME_BYTES;
    const bool sound = fits && reader->used > 0u && parse(reader, message);
    reader->refused += !sound && reader->used > 0u ? 1u : 0u;
    reader->used = 0u;
    return sound;
}

static uint32_t cobs_encode(uint8_t *frame, const uint8_t *content, uint32_t length)
{
    uint32_t code_at = 0u;
    uint32_t to = 1u;
    for (uint32_t i = 0u; i < length; i++) {
        if (content[i] == 0u) {
            frame[code_at] = (uint8_t)(to - code_at);
            code_at = to++;
        } else {
            frame[to++] = content[i];
        }
    }
    frame[code_at] = (uint8_t)(to - code_at);
    frame[to++] = 0u;
    return to;
}

uint32_t an_frame_write(uint8_t *frame, const an_message *message)
{
    uint8_t content[AN_FRAME_CONTENT];
    if (message->length > AN_PAYLOAD_MAX) {
        return 0u;
    }
    content[0] = message->kind;
    content[1] = message->sequence;
    for (uint32_t i = 0u; i < message->length; i++) {
        content[HEAD + i] = message->payload[i];
    }
    const uint32_t body = HEAD + message->length;
    an_put32(content + body, an_crc32(content, body));
    return cobs_encode(frame, content, body + CRC);
}
