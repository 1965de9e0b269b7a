#include "an_button.h"

void an_button_init(an_button *button, uint32_t looks_per_s)
{
    button->raw = true;
    button->held = true;
    button->quiet = false;
    button->since = 0u;
    button->cleared = 0u;
    button->steady = looks_per_s / 50u;
    button->pause = looks_per_s / 2u;
}

/* True once per debounced press. */
static bool is_new_press(an_button *button, bool pressed, uint32_t now)
{
    if (pressed != button->raw) {
        button->raw = pressed;
        button->since = now;
    }
    if (button->raw == button->held || now - button->since < button->steady) {
        return false;
    }
    button->held = button->raw;
    return button->held;
}

an_order an_button_order(an_button *button, bool pressed, uint32_t now, an_state state)
{
    button->quiet = button->quiet && now - button->cleared < button->pause;
    if (!is_new_press(button, pressed, now)) {
        return AN_ORDER_NONE;
    }
    if (state == AN_STATE_FAULT) {
        button->quiet = true;
        button->cleared = now;
        return AN_ORDER_CLEAR;
    }
    if (state == AN_STATE_IDLE) {
        return button->quiet ? AN_ORDER_NONE : AN_ORDER_START;
    }
    return AN_ORDER_STOP;
}
