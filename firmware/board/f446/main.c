/* The main loop of both builds. */
#include "an_button.h"
#include "an_faults.h"
#include "an_link.h"
#include "application.h"
#include "board.h"
#include "guard.h"
#include "line.h"
#include "registers.h"

enum { HEALTHY = GUARD_RATE_HZ }; /* looks of the guard: a second */

static an_link line;
static an_capture capture;
static an_keeping keeping;
static uint8_t *backup;

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
    const uint32_t kept = application_state()->supervisor.faults & ~(uint32_t)(AN_FAULT_TABLE | AN_FAULT_FLASH);
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
    if (line.store_target) {
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
    health[AN_HEALTH_FAST_CYCLES] = application_state()->worst_cycles;
    health[AN_HEALTH_SLOW_CYCLES] = application_slow_cycles();
    health[AN_HEALTH_MAIN_CYCLES] = main_cycles;
    health[AN_HEALTH_KEPT] = keeping.state;
}

static void serve_button(an_button *button)
{
    an_application *app = application_state();
    switch (an_button_order(button, button_pressed(), guard_count(), app->supervisor.state)) {
    case AN_ORDER_START:
        application_start();
        break;
    case AN_ORDER_STOP:
        an_application_stop(app);
        break;
    case AN_ORDER_CLEAR:
        an_application_clear(app, application_build);
        break;
    case AN_ORDER_NONE:
    default:
        break;
    }
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
    backup = backup_start();
    clock_count_cycles();
    boot(watchdog | clock);
    an_button_init(&button, GUARD_RATE_HZ);
    application_capture(&capture);
    an_link_init(&line, application_state(), application_build, &capture);
    application_init();
    uart_init();
    watchdog_start();
    application_start_sampling();
    guard_start();
    for (;;) {
        const uint32_t begin = DWT->CYCCNT;
        an_application_poll(application_state(), application_build);
        application_serve_outputs();
        serve_line();
        an_application_keep(application_state(), application_build, backup, &keeping);
        serve_button(&button);
        serve_guard();
        watchdog_feed(application_windows(), application_answers());
        tell_health(main_cycles);
        note_cycles(&main_cycles, begin);
        __asm volatile("wfi" ::: "memory");
    }
}
