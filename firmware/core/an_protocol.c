#include "an_protocol.h"

static const uint8_t request_bytes[AN_COLUMN + 1] = {AN_REQUEST_BYTES};

/* Samples and pieces of an upload come in any number. */
bool an_protocol_has_its_length(const an_message *request)
{
    if (request->kind == AN_SAMPLES) {
        return request->length > 0u && request->length % 2u == 0u;
    }
    if (request->kind == AN_UPLOAD_DATA) {
        return request->length > sizeof(uint32_t);
    }
    return request->length == (request->kind < sizeof request_bytes ? request_bytes[request->kind] : 0u);
}

an_result an_protocol_refuse(an_message *reply, an_table_result reason)
{
    reply->payload[1] = (uint8_t)reason;
    reply->length = 2u;
    return AN_TABLE_REFUSED;
}
