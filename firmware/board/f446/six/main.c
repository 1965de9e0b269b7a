/* Six channels by PWM: the composition of core and board. */
#include "an_faults.h"
#include "an_six.h"
#include "board.h"
#include "bridges.h"
#include "line.h"
#include "registers.h"
#include "scan.h"

_Static_assert((int)AN_SIX_DUTY_MIDDLE * 2 == (int)BRIDGES_TOP, "the core's middle is half of the timer's range");
_Static_assert((int)AN_SIX == (int)BRIDGES && (int)AN_SIX == (int)SCAN_CHANNELS, "one bridge and one sensor a channel");

static an_six app;
static an_link line;
static uint16_t duty[BRIDGES];

void DMA2_Stream0_IRQHandler(void);
void PendSV_Handler(void);
int main(void);

void DMA2_Stream0_IRQHandler(void)
{
    const uint32_t begin = DWT->CYCCNT;
    if (!scan_complete()) {
        app.fast.faults |= AN_FAULT_FAST_LATE;
    }
    an_six_tick(&app.fast, scan_samples, duty);
    bridges_set(duty);
    if (app.fast.faults != 0u) {
        bridges_off();
    }
    if (app.fast.tick == 0u) {
        SCB->ICSR = BIT(28); /* PendSV: the slow step, as soon as nothing more urgent runs */
    }
    const uint32_t cycles = DWT->CYCCNT - begin;
    app.worst_cycles = cycles > app.worst_cycles ? cycles : app.worst_cycles;
}

void PendSV_Handler(void)
{
    an_six_window_end(&app);
    if (app.slow.trips != 0u) {
        bridges_off();
    }
}

static void boot(uint32_t faults)
{
    an_six_boot(&app, store_table(), store_bytes(), BRIDGES_RATE_HZ, faults);
}

/* Starts the first pattern, stops, or clears a fault, once for each press. */
static void obey_button(void)
{
    static bool held;
    const bool pressed = button_pressed();
    if (pressed && !held) {
        if (app.state == AN_STATE_IDLE) {
            an_six_start(&app, 0u, 0.0f);
        } else if (app.state == AN_STATE_FAULT) {
            an_six_clear(&app);
        } else {
            an_six_stop(&app);
        }
    }
    held = pressed;
}

/* No fault may be found between the last look for one and the closing of the gates. */
static void close_gates(void)
{
    __asm volatile("cpsid i" ::: "memory");
    if (app.fast.faults == 0u && app.slow.trips == 0u) {
        bridges_on();
    }
    __asm volatile("cpsie i" ::: "memory");
}

/* The switches work only while there is something to drive and nothing wrong. */
static void serve_bridges(void)
{
    if (bridges_broken()) {
        an_six_trip(&app, AN_FAULT_BREAK);
    }
    if (clock_supply_is_low()) {
        an_six_trip(&app, AN_FAULT_SUPPLY);
    }
    if (app.state == AN_STATE_IDENTIFY || app.state == AN_STATE_RUN) {
        close_gates();
    } else {
        bridges_off();
    }
}

/* Only when idle or in a fault: serve_bridges has left the gates open. */
static void store_staged(void)
{
    NVIC->ICER[DMA2_STREAM0_IRQ / 32] = BIT(DMA2_STREAM0_IRQ % 32);
    const bool done = store_write(line.staged, line.staged_length);
    boot(done ? 0u : AN_FAULT_FLASH);
    scan_complete();
    NVIC->ISER[DMA2_STREAM0_IRQ / 32] = BIT(DMA2_STREAM0_IRQ % 32);
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
        an_six_record(&app, record);
        an_link_log(&line, logged, record);
    }
}

int main(void)
{
    const uint32_t watchdog = clock_reset_by_watchdog() ? AN_FAULT_WATCHDOG : 0u;
    const uint32_t clock = clock_start() ? 0u : AN_FAULT_CLOCK;
    clock_count_cycles();
    boot(watchdog | clock);
    an_link_init(&line, an_six_obey, &app);
    bridges_init();
    scan_init();
    uart_init();
    watchdog_start();
    bridges_start();
    for (;;) {
        an_six_poll(&app);
        serve_bridges();
        serve_line();
        obey_button();
        watchdog_feed(app.fast.window.count, app.fast.command.count);
        __asm volatile("wfi" ::: "memory");
    }
}
