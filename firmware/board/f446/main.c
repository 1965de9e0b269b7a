/* The main loop of both builds. */
#include "an_button.h"
#include "an_faults.h"
#include "application.h"
#include "board.h"
#include "guard.h"
#include "line.h"
#include "registers.h"

enum { HEALTHY = GUARD_RATE_HZ }; /* looks of the guard: a second */

static an_link line;

int main(void);

/* A table that was there at three watchdog resets in a row is left alone: another one can then be uploaded. */
static void boot(uint32_t faults)
{
    const bool suspect = record_get()->watchdog_resets >= RECORD_RESETS_MAX;
    application_boot(store_table(), suspect ? 0u : store_bytes(), faults);
}

/* A new table answers for the old one's faults, and for no other. */
static void store_staged(void)
{
    const uint32_t kept = application_supervisor()->faults & ~(uint32_t)(AN_FAULT_TABLE | AN_FAULT_FLASH);
    guard_stop();
    application_stop_sampling();
    const bool done = store_write(line.staged, line.staged_length);
    if (done) {
        record_healthy();
    }
    boot(kept | (done ? 0u : AN_FAULT_FLASH));
    application_start_sampling();
    guard_start();
    an_link_stored(&line, done);
}

static void serve_line(void)
{
    static uint32_t logged;
    float record[AN_LOG_FLOATS];
    line_serve(&line);
    if (line.store_wanted) {
        store_staged();
    }
    if (application_answers() != logged) {
        logged = application_answers();
        application_record(record);
        an_link_log(&line, logged, record);
    }
}

static void tell_health(uint32_t main_cycles)
{
    const board_record *record = record_get();
    uint32_t *health = line.health;
    health[AN_HEALTH_RESETS] = record->watchdog_resets;
    health[AN_HEALTH_EXCEPTION] = record->exception;
    health[AN_HEALTH_PC] = record->pc;
    health[AN_HEALTH_LR] = record->lr;
    health[AN_HEALTH_CFSR] = record->cfsr;
    health[AN_HEALTH_CORE_HZ] = clock_core_hz();
    health[AN_HEALTH_FAST_CYCLES] = application_fast_cycles();
    health[AN_HEALTH_SLOW_CYCLES] = application_slow_cycles();
    health[AN_HEALTH_MAIN_CYCLES] = main_cycles;
}

static void serve_button(an_button *button)
{
    const an_order order = an_button_order(button, button_pressed(), guard_count(), application_supervisor()->state);
    application_obey(order);
}

static void serve_guard(void)
{
    if (guard_found_standstill()) {
        application_revive();
    }
    if (guard_count() % HEALTHY == 0u && guard_count() != 0u) {
        record_healthy();
        line.health[AN_HEALTH_STACK_UNUSED] = stack_unused();
    }
}

int main(void)
{
    an_button button;
    uint32_t main_cycles = 0u;
    const uint32_t watchdog = record_boot() ? AN_FAULT_WATCHDOG : 0u;
    const uint32_t clock = clock_start() ? 0u : AN_FAULT_CLOCK;
    debug_init();
    clock_count_cycles();
    boot(watchdog | clock);
    an_button_init(&button, GUARD_RATE_HZ);
    application_link(&line);
    application_init();
    uart_init();
    watchdog_start();
    application_start_sampling();
    guard_start();
    for (;;) {
        const uint32_t begin = DWT->CYCCNT;
        application_poll();
        serve_line();
        serve_button(&button);
        serve_guard();
        watchdog_feed(application_windows(), application_answers());
        tell_health(main_cycles);
        note_cycles(&main_cycles, begin);
        __asm volatile("wfi" ::: "memory");
    }
}
