/* Connection between the serial line and the protocol. */
#ifndef LINE_H
#define LINE_H

#include "an_link.h"

/* Send pending output and process received bytes, as far as possible without waiting. */
void line_serve(an_link *link);

#endif
