/* Between the serial line and the protocol. */
#ifndef LINE_H
#define LINE_H

#include "an_link.h"

/* Sends what is to be sent, and passes on what came, as far as neither has to wait. */
void line_serve(an_link *link);

#endif
