/* The host's end of the line: requests in, replies and a log out, a new mode table on the way to its flash sector.
 *
 * A request is answered by the same kind with its top bit set, the same sequence, and a payload that begins with a
 * result. What concerns the application is passed on to it; a table is staged in RAM, checked there, and only then
 * handed to the board to be stored.
 */
#ifndef AN_LINK_H
#define AN_LINK_H

#include "an_application.h"
#include "an_capture.h"
#include "an_frame.h"
#include "an_protocol.h"
#include "an_types.h"

/* The last request that changed something, and its answer: a host that lost the answer asks again, with the same
 * sequence, and must neither be refused nor done twice. It is forgotten when another sequence is heard, for then the answer
 * had come, or nobody waits for it. What changes nothing, and a stop, is done and answered anew each time. */
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
    an_application *app;
    const an_build *build;
    an_capture *capture;
    uint8_t out[AN_FRAME_BYTES];
    uint32_t out_length; /* bytes the board shall send next; it sets 0 when it took them */
    uint8_t staged[AN_TABLE_MAX_BYTES];
    uint32_t staged_length;
    uint32_t staged_target;
    an_last_request last;
    uint32_t health[AN_HEALTH_WORDS];
    bool store_target; /* the board shall store staged, then call an_link_stored */
    uint8_t store_sequence;
    uint32_t log_every; /* windows a record; 0: none */
    uint32_t log_waited;
    an_message log;
} an_link;

void an_link_init(an_link *link, an_application *app, const an_build *build, an_capture *capture);

/* Takes a byte from the line. Not to be called while out_length is not zero. */
void an_link_feed(an_link *link, uint8_t byte);

/* The outcome of storing the staged table. */
void an_link_stored(an_link *link, bool done);

/* Once a window: a record for the log, AN_LOG_FLOATS numbers. */
void an_link_log(an_link *link, uint32_t window, const float *record);

#endif
