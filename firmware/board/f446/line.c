#include "line.h"

#include "board.h"

_Static_assert((int)AN_FRAME_BYTES <= (int)UART_SEND_MAX, "a frame is sent in one piece");

void line_serve(an_link *link)
{
    uint8_t byte;
    if (link->out_length != 0u && uart_send(link->out, link->out_length)) {
        link->out_length = 0u;
    }
    while (link->out_length == 0u && !link->store_target && uart_receive(&byte, 1u) != 0u) {
        an_link_feed(link, byte);
    }
}
