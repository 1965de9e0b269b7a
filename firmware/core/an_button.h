/* A single push button for start, stop and clear: the state at the time of the press selects the order. */
#ifndef AN_BUTTON_H
#define AN_BUTTON_H

#include "an_supervisor.h"
#include "an_types.h"

typedef enum { AN_ORDER_NONE, AN_ORDER_START, AN_ORDER_STOP, AN_ORDER_CLEAR } an_order;

typedef struct {
    bool raw;        /* last reading */
    bool held;       /* debounced state */
    bool quiet;      /* just cleared: a press does not start */
    uint32_t since;  /* time of the last change of raw */
    uint32_t cleared; /* time of the last clear */
    uint32_t steady; /* debounce time in polls: 20 ms */
    uint32_t pause;  /* shortest time between clear and start, in polls: 0.5 s */
} an_button;

/* Start in the held state, so that a button pressed at power-up has no effect until it has been released. */
void an_button_init(an_button *button, uint32_t looks_per_s);

/* Return the order given by a press, once per press; now is the number of polls so far. */
an_order an_button_order(an_button *button, bool pressed, uint32_t now, an_state state);

#endif
