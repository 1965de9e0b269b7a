/* Requests and their replies; numbers and layouts are in an_wire.h. */
#ifndef AN_PROTOCOL_H
#define AN_PROTOCOL_H

#include "an_frame.h"
#include "an_wire.h"

enum { AN_LOG_PER_FRAME = 4 };

/* Check the length of a request's payload. */
bool an_protocol_has_its_length(const an_message *request);

/* Write the reason for rejecting a table to the reply and return AN_TABLE_REFUSED. */
an_result an_protocol_refuse(an_message *reply, an_table_result reason);

#endif
