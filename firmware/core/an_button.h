/* One button: start, stop, clear. What a press orders follows from the state at that moment. */
#ifndef AN_BUTTON_H
#define AN_BUTTON_H

#include "an_supervisor.h"
#include "an_types.h"

typedef enum { AN_ORDER_NONE, AN_ORDER_START, AN_ORDER_STOP, AN_ORDER_CLEAR } an_order;

typedef struct {
    bool raw;        /* as read last */
    bool held;       /* without the contact's bouncing */
    bool quiet;      /* just cleared: nothing starts */
    uint32_t since;  /* raw is what it is since then */
    uint32_t cleared; /* when */
    uint32_t steady; /* looks that a contact takes to settle: 20 ms */
    uint32_t pause;  /* looks between a clear and a start: 0.5 s */
} an_button;

/* Held, until it is seen open: a button that is pressed at power-up orders nothing. */
void an_button_init(an_button *button, uint32_t looks_per_s);

/* The order of a press, once each; now counts looks. */
an_order an_button_order(an_button *button, bool pressed, uint32_t now, an_state state);

#endif
