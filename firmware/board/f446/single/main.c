/* One mode by DAC and ADC: the composition of core and board. */
#include "an_faults.h"
#include "an_single.h"
#include "board.h"
#include "converters.h"
#include "line.h"
#include "registers.h"

static an_single app;
static an_link line;

void ADC_IRQHandler(void);
void PendSV_Handler(void);
int main(void);

void ADC_IRQHandler(void)
{
    const uint32_t begin = DWT->CYCCNT;
    if (converters_lost_one()) {
        app.fast.faults |= AN_FAULT_FAST_LATE;
    }
    converters_drive(an_fast_tick(&app.fast, converters_sample()));
    if (app.fast.tick == 0u) {
        SCB->ICSR = BIT(28); /* PendSV: the slow step, as soon as nothing more urgent runs */
    }
    const uint32_t cycles = DWT->CYCCNT - begin;
    app.worst_cycles = cycles > app.worst_cycles ? cycles : app.worst_cycles;
}

void PendSV_Handler(void)
{
    an_single_slow(&app);
}

static void boot(uint32_t faults)
{
    an_single_boot(&app, store_table(), store_bytes(), CONVERTERS_RATE_HZ, faults);
}

/* Starts, stops, or clears a fault, once for each press. */
static void obey_button(void)
{
    static bool held;
    const bool pressed = button_pressed();
    if (pressed && !held) {
        if (app.state == AN_STATE_IDLE) {
            an_single_start(&app, 0.0f, 0.0f);
        } else if (app.state == AN_STATE_FAULT) {
            an_single_clear(&app);
        } else {
            an_single_stop(&app);
        }
    }
    held = pressed;
}

static void store_staged(void)
{
    converters_stop();
    const bool done = store_write(line.staged, line.staged_length);
    boot(done ? 0u : AN_FAULT_FLASH);
    converters_start();
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
    if (app.fast.command.count != logged) {
        logged = app.fast.command.count;
        an_single_record(&app, record);
        an_link_log(&line, logged, record);
    }
}

int main(void)
{
    const uint32_t watchdog = clock_reset_by_watchdog() ? AN_FAULT_WATCHDOG : 0u;
    const uint32_t clock = clock_start() ? 0u : AN_FAULT_CLOCK;
    clock_count_cycles();
    boot(watchdog | clock);
    an_link_init(&line, an_single_obey, &app);
    converters_init();
    uart_init();
    watchdog_start();
    converters_start();
    for (;;) {
        an_single_poll(&app);
        serve_line();
        obey_button();
        if (clock_supply_is_low()) {
            an_single_trip(&app, AN_FAULT_SUPPLY);
        }
        watchdog_feed(app.fast.window.count, app.fast.command.count);
        __asm volatile("wfi" ::: "memory");
    }
}
