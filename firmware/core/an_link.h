/* The host's end of the line: requests in, replies and a log out, a new mode table on the way to its flash sector.
 *
 * A request is answered by the same kind with its top bit set, the same sequence, and a payload that begins with a
 * result. What concerns the application is passed on to it; a table is staged in RAM, checked there, and only then
 * handed to the board to be stored.
 */
#ifndef AN_LINK_H
#define AN_LINK_H

#include "an_frame.h"
#include "an_table.h"
#include "an_types.h"

enum {
    AN_IDENTITY = 1,
    AN_STATUS = 2,
    AN_START = 3,
    AN_STOP = 4,
    AN_CLEAR = 5,
    AN_REFERENCE = 6,
    AN_SINE = 7,
    AN_STREAM = 8,
    AN_SAMPLES = 9,
    AN_LOG = 10,
    AN_UPLOAD_BEGIN = 11,
    AN_UPLOAD_DATA = 12,
    AN_UPLOAD_END = 13,
    AN_PATTERN = 14,
    AN_IDENTIFY = 15,
    AN_HEALTH = 16,
    AN_REPLY = 0x80,
    AN_LOG_RECORDS = 0xc0
};

enum {
    AN_OK,
    AN_UNKNOWN,       /* this image does not know the request */
    AN_BAD_VALUE,     /* wrong length, or a value out of range */
    AN_NOT_NOW,       /* refused in this state */
    AN_TABLE_REFUSED, /* followed by the reason, AN_TABLE_... */
    AN_STORE_FAILED
};

enum { AN_PROTOCOL = 1, AN_LOG_FLOATS = 5, AN_LOG_PER_FRAME = 4 };

/* The application's answer to a request: a result; more may be put into reply->payload from byte 1 on, with
 * reply->length set. For AN_UPLOAD_END it only says whether a table may be stored now. */
typedef uint32_t (*an_obey)(void *app, const an_message *request, an_message *reply);

typedef struct {
    an_frame_reader reader;
    an_obey obey;
    void *app;
    uint8_t out[AN_FRAME_BYTES];
    uint32_t out_length; /* bytes the board shall send next; it sets 0 when it took them */
    uint32_t heard;      /* sound frames so far */
    uint8_t staged[AN_TABLE_MAX_BYTES];
    uint32_t staged_length;
    uint32_t staged_wanted;
    bool store_wanted; /* the board shall store staged, then call an_link_stored */
    uint8_t store_sequence;
    uint32_t log_every; /* windows a record; 0: none */
    uint32_t log_waited;
    an_message log;
} an_link;

void an_link_init(an_link *link, an_obey obey, void *app);

/* Takes a byte from the line. Not to be called while out_length is not zero. */
void an_link_feed(an_link *link, uint8_t byte);

/* The outcome of storing the staged table. */
void an_link_stored(an_link *link, bool done);

/* Once a window: a record for the log, AN_LOG_FLOATS numbers. */
void an_link_log(an_link *link, uint32_t window, const float *record);

#endif
