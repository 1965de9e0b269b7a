#include "board.h"
#include "registers.h"

enum { POLLS_MAX = 100000 };

/* Prescaler and reload value take five cycles of the watchdog's own clock to take effect. */
static void set(uint32_t prescaler, uint32_t reload)
{
    IWDG->KR = IWDG_KR_START;
    IWDG->KR = IWDG_KR_UNLOCK;
    IWDG->PR = prescaler;
    IWDG->RLR = reload;
    for (uint32_t i = 0u; i < POLLS_MAX && IWDG->SR != 0u; i++) {
    }
    IWDG->KR = IWDG_KR_FEED;
}

void watchdog_start(void)
{
    set(0u, 96u); /* 32 kHz / 4 */
}

void watchdog_lengthen(void)
{
    set(6u, 4095u); /* 32 kHz / 256 */
}

void watchdog_feed(uint32_t fast, uint32_t slow)
{
    static uint32_t fast_seen;
    static uint32_t slow_seen;
    if (fast != fast_seen && slow != slow_seen) {
        fast_seen = fast;
        slow_seen = slow;
        IWDG->KR = IWDG_KR_FEED;
    }
}
