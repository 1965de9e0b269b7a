/* Single-mode build with DAC and ADC: connects core and board. */
#include "application.h"

#include "an_wire.h"
#include "an_single.h"
#include "board.h"
#include "converters.h"
#include "guard.h"
#include "registers.h"

_Static_assert((int)AN_WATCH_TICKS * (int)GUARD_RATE_HZ == (int)CONVERTERS_RATE_HZ, "one check of the guard per fit");

static an_single app;
static uint32_t slow_cycles;
static an_capture *captured;

const an_build *const application_build = &an_single_build;

an_application *application_state(void)
{
    return &app.base;
}

void application_capture(an_capture *capture)
{
    an_capture_init(capture, 1u);
    captured = capture;
}

void ADC_IRQHandler(void);
void PendSV_Handler(void);

void ADC_IRQHandler(void)
{
    const uint32_t begin = DWT->CYCCNT;
    if (converters_overran()) {
        app.fast.faults |= AN_FAULT_FAST_LATE;
    }
    const uint16_t sample = (uint16_t)converters_sample();
    const uint16_t code = (uint16_t)an_fast_tick(&app.fast, sample);
    converters_drive(code);
    an_capture_take(captured, &sample, &code);
    if (app.fast.tick == 0u) {
        SCB->ICSR = SCB_ICSR_PENDSVSET; /* run the slow step as soon as no higher priority is active */
    }
    note_cycles(&app.base.worst_cycles, begin);
}

void PendSV_Handler(void)
{
    const uint32_t begin = DWT->CYCCNT;
    an_single_slow(&app);
    an_single_capture(&app, captured);
    if (app.slow.hand.trips != 0u) {
        converters_enable(false);
    }
    note_cycles(&slow_cycles, begin);
}

uint32_t application_slow_cycles(void)
{
    return slow_cycles;
}

void application_boot(const uint8_t *table, uint32_t length, uint32_t faults)
{
    an_single_boot(&app, table, length, CONVERTERS_RATE_HZ, faults);
}

void application_init(void)
{
    converters_init();
}

void application_start_sampling(void)
{
    converters_start();
}

void application_stop_sampling(void)
{
    converters_stop();
}

void application_revive(void)
{
    converters_revive();
}

/* Enable the amplifier while a job drives. Interrupts are disabled, so that no fault can occur in between. */
void application_serve_outputs(void)
{
    __asm volatile("cpsid i" ::: "memory");
    converters_enable(an_supervisor_drives(&app.base.supervisor) && (app.fast.faults | app.slow.hand.trips) == 0u);
    __asm volatile("cpsie i" ::: "memory");
}

void application_trip(uint32_t fault)
{
    app.fast.faults |= fault;
    board_outputs_safe();
}

uint32_t application_check(void)
{
    return an_single_check(&app);
}

void application_start(void)
{
    an_single_start(&app, 0.0f, 0.0f);
}

an_record application_record(void)
{
    return an_single_record(&app);
}

uint32_t application_samples(void)
{
    return app.fast.window.count * AN_PERIOD + app.fast.tick;
}

uint32_t application_windows(void)
{
    return app.fast.window.count;
}

uint32_t application_answers(void)
{
    return app.fast.command.count;
}
