/* Six channels by PWM: the composition of core and board. */
#include "application.h"

#include "an_faults.h"
#include "an_six.h"
#include "board.h"
#include "bridges.h"
#include "registers.h"
#include "scan.h"

_Static_assert((int)AN_SIX_DUTY_MIDDLE * 2 == (int)BRIDGES_TOP, "the core's middle is half of the timer's range");
_Static_assert((int)AN_SIX == (int)BRIDGES && (int)AN_SIX == (int)SCAN_CHANNELS, "one bridge and one sensor a channel");

static an_six app;
static uint32_t slow_cycles;
static uint16_t duty[BRIDGES];
static an_capture *captured;

const an_build *const application_build = &an_six_build;

an_application *application_state(void)
{
    return &app.base;
}

void application_capture(an_capture *capture)
{
    an_capture_init(capture, BRIDGES);
    captured = capture;
}

void DMA2_Stream0_IRQHandler(void);
void PendSV_Handler(void);
void TIM1_BRK_TIM9_IRQHandler(void);
void TIM8_BRK_TIM12_IRQHandler(void);

void DMA2_Stream0_IRQHandler(void)
{
    const uint32_t begin = DWT->CYCCNT;
    const uint16_t *samples;
    if (!scan_complete(&samples)) {
        app.fast.faults |= AN_FAULT_FAST_LATE;
    }
    an_six_tick(&app.fast, samples, duty);
    bridges_set(duty);
    an_capture_take(captured, samples, duty);
    app.fast.faults |= an_six_check(&app) | an_six_look(&app, samples);
    if (app.fast.faults != 0u) {
        bridges_off();
    }
    if (app.fast.tick == 0u) {
        SCB->ICSR = SCB_ICSR_PENDSVSET; /* the slow step, as soon as nothing more urgent runs */
    }
    note_cycles(&app.base.worst_cycles, begin);
}

void PendSV_Handler(void)
{
    const uint32_t begin = DWT->CYCCNT;
    an_six_window_end(&app);
    if (app.slow.hand.trips != 0u) {
        bridges_off();
    }
    note_cycles(&slow_cycles, begin);
}

uint32_t application_slow_cycles(void)
{
    return slow_cycles;
}

/* One timer's line was pulled: the other timer opens as well, and no gate closes before somebody clears the fault. */
static void broken(void)
{
    bridges_deafen();
    application_trip(AN_FAULT_BREAK);
}

void TIM1_BRK_TIM9_IRQHandler(void)
{
    broken();
}

void TIM8_BRK_TIM12_IRQHandler(void)
{
    broken();
}

void application_boot(const uint8_t *table, uint32_t length, uint32_t faults)
{
    an_six_boot(&app, table, length, BRIDGES_RATE_HZ, faults);
}

void application_init(void)
{
    bridges_init();
    scan_init();
}

void application_start_sampling(void)
{
    scan_revive();
    NVIC->ISER[DMA2_STREAM0_IRQ / 32] |= 1u << DMA2_STREAM0_IRQ % 32;
    bridges_start();
}

/* The timers run on with their gates open. */
void application_stop_sampling(void)
{
    bridges_off();
    NVIC->ICER[DMA2_STREAM0_IRQ / 32] = 1u << DMA2_STREAM0_IRQ % 32;
}

void application_revive(void)
{
    scan_revive();
}

/* Gates close once, when a job begins, and only while nothing is wrong: no fault may be found between the last look for
 * one and the closing. */
static void close_gates(void)
{
    __asm volatile("cpsid i" ::: "memory");
    if ((app.fast.faults | app.slow.hand.trips) == 0u && !bridges_broken()) {
        bridges_on();
    }
    __asm volatile("cpsie i" ::: "memory");
}

void application_serve_outputs(void)
{
    static bool closed;
    static uint32_t cleared;
    if (app.base.supervisor.cleared != cleared) {
        cleared = app.base.supervisor.cleared;
        bridges_listen();
    }
    if (bridges_broken()) {
        bridges_off();
        an_six_build.trip(&app.base, AN_FAULT_BREAK);
    }
    if (!an_supervisor_drives(&app.base.supervisor)) {
        bridges_off();
        closed = false;
    } else if (!closed) {
        close_gates();
        closed = true;
    }
}

void application_trip(uint32_t fault)
{
    bridges_off();
    app.fast.faults |= fault;
}

uint32_t application_check(void)
{
    return an_six_check(&app);
}

void application_start(void)
{
    an_six_start(&app, 0u, 0.0f);
}

void application_record(float *record)
{
    an_six_record(&app, record);
}

/* Any two looks of the guard are two samples apart, any window is longer than that. */
uint32_t application_samples(void)
{
    return app.fast.phase + app.fast.tick;
}

uint32_t application_windows(void)
{
    return app.fast.window.count;
}

uint32_t application_answers(void)
{
    return app.fast.command.count;
}
