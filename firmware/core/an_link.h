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

typedef enum {
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
} an_kind;

typedef enum {
    AN_OK,
    AN_UNKNOWN,       /* this image does not know the request */
    AN_BAD_VALUE,     /* wrong length, or a value out of range */
    AN_NOT_NOW,       /* refused in this state */
    AN_TABLE_REFUSED, /* followed by the reason, AN_TABLE_... */
    AN_STORE_FAILED
} an_result;

enum { AN_STATUS_LIMITED = 8 }; /* in a status' fourth byte: the drive is at its limit, and the plate short of its reference */

enum { AN_PROTOCOL = 2, AN_LOG_FLOATS = 5, AN_LOG_PER_FRAME = 4 };

/* What the board tells of itself, in answer to AN_HEALTH: 32-bit words in this order. Exception, pc, lr and cfsr are those
 * of the last interrupt that nobody expected, zeros when there was none since power-on. */
typedef enum {
    AN_HEALTH_RESETS, /* by the watchdog, in a row */
    AN_HEALTH_EXCEPTION,
    AN_HEALTH_PC,
    AN_HEALTH_LR,
    AN_HEALTH_CFSR,
    AN_HEALTH_CORE_HZ,
    AN_HEALTH_FAST_CYCLES, /* longest so far: fast interrupt, slow interrupt, pass of the main loop */
    AN_HEALTH_SLOW_CYCLES,
    AN_HEALTH_MAIN_CYCLES,
    AN_HEALTH_STACK_UNUSED, /* bytes; 0 in the first second */
    AN_HEALTH_WORDS
} an_health;

/* The application's answer to a request: a result; more may be put into reply->payload from byte 1 on, with
 * reply->length set. For AN_UPLOAD_END, which comes with the sound staged table, it says whether that is one for this
 * build (else AN_TABLE_REFUSED with the reason) and may be stored now. */
typedef an_result (*an_obey)(void *app, const an_message *request, const an_table *staged, an_message *reply);

/* The last request that changed something, and its answer: a host that lost the answer asks again, with the same
 * sequence, and must neither be refused nor obeyed twice. Status and identity are answered anew each time. */
typedef struct {
    bool known;
    uint8_t kind;
    uint8_t sequence;
    uint32_t digest;
    uint8_t answer[2];
    uint32_t answer_length;
} an_last_request;

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
    an_last_request last;
    uint32_t health[AN_HEALTH_WORDS];
    bool store_wanted; /* the board shall store staged, then call an_link_stored */
    uint8_t store_sequence;
    uint32_t log_every; /* windows a record; 0: none */
    uint32_t log_waited;
    an_message log;
} an_link;

void an_link_init(an_link *link, an_obey obey, void *app);

/* A table that is refused, with the reason. */
an_result an_link_refuse(an_message *reply, an_table_result reason);

/* Takes a byte from the line. Not to be called while out_length is not zero. */
void an_link_feed(an_link *link, uint8_t byte);

/* The outcome of storing the staged table. */
void an_link_stored(an_link *link, bool done);

/* Once a window: a record for the log, AN_LOG_FLOATS numbers. */
void an_link_log(an_link *link, uint32_t window, const float *record);

#endif
