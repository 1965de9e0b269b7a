/* Link to the host: receives requests, sends replies and the log, and stages a new mode table for its flash sector.
 *
 * The reply to a request has the same kind with the top bit set, the same sequence number, and a payload that begins
 * with a result. Requests for the application are passed on to it. An uploaded table is staged and checked in RAM
 * before the board stores it.
 */
#ifndef AN_LINK_H
#define AN_LINK_H

#include "an_application.h"
#include "an_capture.h"
#include "an_frame.h"
#include "an_protocol.h"
#include "an_types.h"

/* The last request that changed anything, and its reply. A host that lost the reply repeats the request with the same
 * sequence number; the board then repeats the reply without executing the request again. The entry expires as soon as
 * another sequence number arrives, because the host then no longer waits for this reply. Requests that change nothing,
 * and stop, are executed every time. */
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
    uint32_t out_length; /* bytes to be sent next; the board sets it to 0 when it has accepted them */
    uint8_t staged[AN_TABLE_MAX_BYTES];
    uint32_t staged_length;
    uint32_t staged_target;
    an_last_request last;
    an_health health;
    bool store_target; /* asks the board to store the staged table and then to call an_link_stored */
    uint8_t store_sequence;
    uint32_t log_every; /* windows per record; 0: no log */
    uint32_t log_waited;
    an_message log;
} an_link;

void an_link_init(an_link *link, an_application *app, const an_build *build, an_capture *capture);

/* Process a received byte. Must not be called while out_length is nonzero. */
void an_link_feed(an_link *link, uint8_t byte);

/* Report whether the staged table was stored. */
void an_link_stored(an_link *link, bool done);

/* Add a record to the log; called once per window. */
void an_link_log(an_link *link, const an_record *record);

#endif
