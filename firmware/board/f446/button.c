#include "board.h"
#include "registers.h"

/* PC13 is an input from reset on. */
bool button_pressed(void)
{
    return (GPIOC->IDR & BIT(13)) == 0u;
}
