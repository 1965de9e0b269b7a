/* Six-channel build with PWM: connects core and board. */
#include "application.h"

#include "an_wire.h"
#include "an_six.h"
#include "board.h"
#include "bridges.h"
#include "registers.h"
#include "scan.h"

_Static_assert((int)AN_SIX_DUTY_MIDDLE * 2 == (int)BRIDGES_TOP, "the core's mid-scale is half the timer's range");
_Static_assert((int)AN_SIX == (int)BRIDGES && (int)AN_SIX == (int)SCAN_CHANNELS, "one bridge and sensor per channel");

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
        SCB->ICSR = SCB_ICSR_PENDSVSET; /* run the slow step as soon as no higher priority is active */
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

/* The break line of one timer was asserted: open the gates of both. They stay open until the fault is cleared. */
static void on_break(void)
{
    bridges_mask_break();
    application_trip(AN_FAULT_BREAK);
}

void TIM1_BRK_TIM9_IRQHandler(void)
{
    on_break();
}

void TIM8_BRK_TIM12_IRQHandler(void)
{
    on_break();
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

/* The timers continue to run, with their gates open. */
void application_stop_sampling(void)
{
    bridges_off();
    NVIC->ICER[DMA2_STREAM0_IRQ / 32] = 1u << DMA2_STREAM0_IRQ % 32;
}

void application_revive(void)
{
    scan_revive();
}

/* Close the gates at the start of a job, unless there is a fault. Interrupts are disabled, so that no fault can occur
 * between the last check and the closing. */
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
        bridges_arm_break();
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

an_record application_record(void)
{
    return an_six_record(&app);
}

/* Phase plus tick changes with every sample. The guard's checks are less than two samples apart, and windows are
 * longer, so that the sum cannot return to an earlier value in between. */
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
