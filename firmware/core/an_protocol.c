#include "an_protocol.h"

an_result an_protocol_refuse(an_message *reply, an_table_result reason)
{
    reply->payload[1] = (uint8_t)reason;
    reply->length = 2u;
    return AN_TABLE_REFUSED;
}
