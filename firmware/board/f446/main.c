/* Main loop of both builds. */
#include "an_button.h"
#include "an_wire.h"
#include "an_link.h"
#include "application.h"
#include "board.h"
#include "guard.h"
#include "line.h"
#include "registers.h"

enum { HEALTHY = GUARD_RATE_HZ }; /* checks of the guard in one second */

static an_link line;
static an_capture capture;
static an_keeping keeping;
static uint8_t *backup;

int main(void);

/* After three consecutive watchdog resets the stored table is ignored, so that another one can be uploaded. */
static void boot(uint32_t faults)
{
    const bool suspect = record_get()->watchdog_resets >= RECORD_RESETS_MAX;
    application_boot(store_table(), suspect ? 0u : store_bytes(), faults);
}

/* Store the staged table and restart. A new table clears the faults of the old table only. */
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
    line_serve(&line);
    if (line.store_target) {
        store_staged();
    }
    if (application_answers() != logged) {
        logged = application_answers();
        const an_record record = application_record();
        an_link_log(&line, &record);
    }
}

static void update_health(uint32_t main_cycles)
{
    const board_record *record = record_get();
    an_health *health = &line.health;
    health->watchdog_resets = record->watchdog_resets;
    health->exception = record->exception;
    health->pc = record->pc;
    health->lr = record->lr;
    health->cfsr = record->cfsr;
    health->core_hz = clock_core_hz();
    health->fast_cycles = application_state()->worst_cycles;
    health->slow_cycles = application_slow_cycles();
    health->main_cycles = main_cycles;
    health->kept = keeping.state;
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
        line.health.stack_unused = stack_unused();
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
        update_health(main_cycles);
        note_cycles(&main_cycles, begin);
        __asm volatile("wfi" ::: "memory");
    }
}
