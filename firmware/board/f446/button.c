#include "board.h"
#include "registers.h"

enum { BUTTON = 1 << 13 };

/* PC13 is an input after reset. */
bool button_pressed(void)
{
    return (GPIOC->IDR & BUTTON) == 0u;
}
