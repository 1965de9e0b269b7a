/* Application layer common to both builds: supervisor, texture and host requests.
 *
 * Each build supplies its own part, from measurement to control, as an an_build.
 */
#ifndef AN_APPLICATION_H
#define AN_APPLICATION_H

#include "an_handover.h"
#include "an_keep.h"
#include "an_protocol.h"
#include "an_retry.h"
#include "an_supervisor.h"
#include "an_table.h"
#include "an_texture.h"
#include "an_types.h"

/* State common to both builds; the first member of each build's own state. */
typedef struct {
    an_supervisor supervisor;
    an_texture texture;
    an_retry retry;
    uint32_t looked; /* window of the last main-loop pass */
    float fade_s;    /* time left for the drives to fade out after a stop, 0: no stop is due */
    float full_s;    /* time of hard drive, minus the time below it, at least 0 */
    bool eased;      /* hard drive has lasted too long: the drive is limited to AN_EASED of its limit */
    uint32_t worst_cycles; /* longest fast interrupt so far; written by the board */
    uint32_t slot;         /* selected set of measured values: 0, or the index of the shape */
    uint32_t chosen;       /* number of selections so far */
    uint32_t measured;     /* number of successful measurements so far */
    bool confirmed;        /* the values in use have been measured, or agreed with the plate, since the start */
    float sample_rate_hz;
} an_application;

#define AN_EASED 0.5f /* of the drive limit, and a quarter of its power */
#define AN_HARD2 0.9f /* of the drive limit squared: a drive above it has nine tenths of the full power */

enum { AN_SLOTS = 2 };
_Static_assert((int)AN_SLOTS >= (int)AN_TABLE_SHAPES, "each shape has its slot");

/* Snapshot of the interrupts' progress, taken by the main loop. */
typedef struct {
    bool vacant;     /* the last posted job is active, so another may be prepared */
    bool limited;    /* the closed loop drives at its limit */
    bool hard;       /* it drives above AN_HARD2 */
    an_job_kind job; /* active job */
    uint32_t faults; /* found by the interrupts */
    uint32_t window; /* number of the current window */
    float window_hz;
} an_moment;

/* Counts that an_application_keep has already handled, and what became of the values. */
typedef struct {
    uint32_t chosen;
    uint32_t measured;
    an_keep_state state;
} an_keeping;

/* Interface of a build; app points to the build's own state. */
typedef struct an_build {
    uint8_t number; /* reported to the host */
    an_moment (*moment)(const an_application *app);
    const an_table *(*table)(const an_application *app);
    uint32_t (*entries)(const an_table *table);
    an_table_result (*accepts)(const an_table *table, float sample_rate_hz); /* does a valid table suit this build? */
    bool (*post_rest)(an_application *app, bool clear); /* post a rest job; clear: and clear the interrupts' faults */
    void (*trip)(an_application *app, uint32_t faults); /* set the outputs to rest at once */
    void (*begin_identify)(an_application *app);
    void (*identify)(an_application *app); /* next step of the measurement */
    void (*follow)(an_application *app);   /* supervise the closed loop */
    bool (*fades)(an_application *app); /* fade the drives out; true until they have (NULL: they rest at once) */
    bool (*restart)(an_application *app); /* start again as last requested; false unless idle */
    void (*set_reference)(an_application *app, float reference);
    uint8_t *(*put_status)(const an_application *app, uint8_t *at);
    uint8_t *(*put_values)(const an_application *app, uint8_t *at); /* write the measured values (AN_KEEP_VALUES_MAX) */
    bool (*take_values)(an_application *app, const uint8_t *values, uint32_t length); /* restore them */
    an_result (*handle_request)(an_application *app, const an_message *request, an_message *reply); /* this build's own */
} an_build;

/* Start at rest, or in the fault state if any faults were found before. */
void an_application_boot(an_application *app, float sample_rate_hz, uint32_t faults);

/* One pass of the main loop. Decisions are postponed while a posted job has not been taken over; the slow step acts on
 * faults by itself, and acts first. A damaged state sets the outputs to rest in between. */
void an_application_poll(an_application *app, const an_build *build);

/* True if a start would be accepted. */
bool an_application_is_ready(const an_application *app, const an_build *build);

/* Measure the plate, even if it has been measured before, and then rest. Returns false unless idle. */
bool an_application_identify(an_application *app, const an_build *build);

/* Record a successful measurement of the selected slot. If only a measurement was requested, go to rest and return
 * true. */
bool an_application_is_measured(an_application *app, const an_build *build);

/* Rest and return true if the job was only a measurement. */
bool an_application_ends_measurement(an_application *app, const an_build *build);

/* Request a return to rest; the drives fade out first. */
void an_application_stop(an_application *app);

/* Latch a fault found by the main loop and set the outputs to rest at once. */
void an_application_fail(an_application *app, const an_build *build, an_fault fault);

/* Leave the fault state, unless a fault of the board or the table remains. */
bool an_application_clear(an_application *app, const an_build *build);

/* Handle a host request passed on by an_link. */
an_result an_application_handle_request(an_application *app, const an_build *build, const an_message *request,
                                        const an_table *staged, an_message *reply);

/* Fill in a status as far as both builds share it, with the build's own flags; not choice, frequency and metres. */
void an_application_status(const an_application *app, const an_build *build, uint32_t flags, an_status *status);

/* True for a reference from 0 to 1. */
bool an_application_may_refer(float reference);

/* Save the values measured since the last call to memory (AN_SLOTS times AN_KEEP_BYTES, or NULL). If another slot has
 * been selected since, restore its saved values as soon as the outputs are at rest. */
void an_application_keep(an_application *app, const an_build *build, uint8_t *memory, an_keeping *keeping);

/* Result of a start requested by the host, which must stay in contact from now on if it succeeded. */
an_result an_application_started(an_application *app, const an_build *build, bool done);

#endif
