/* What the two builds share above their loops: the supervisor with what it orders, the texture, and what a host may ask of
 * either. What only one of them can do it gives as an an_build.
 */
#ifndef AN_APPLICATION_H
#define AN_APPLICATION_H

#include "an_handover.h"
#include "an_keep.h"
#include "an_protocol.h"
#include "an_supervisor.h"
#include "an_table.h"
#include "an_texture.h"
#include "an_types.h"

/* First member of each build's own state. */
typedef struct {
    an_supervisor supervisor;
    an_texture texture;
    uint32_t worst_cycles; /* of the fast interrupt; the board's note */
    uint32_t slot;         /* which of what may be measured is chosen: 0, or the shape */
    uint32_t chosen;       /* times that it was */
    uint32_t measured;     /* times that its measurement succeeded */
    float sample_rate_hz;
} an_application;

enum { AN_SLOTS = 2 };
_Static_assert((int)AN_SLOTS >= (int)AN_TABLE_SHAPES, "each shape has its slot");

/* How the interrupts are getting on. */
typedef struct {
    bool vacant;     /* the job posted last is at work: another may be prepared */
    an_job_kind job; /* at work */
    uint32_t faults; /* found by them */
    uint32_t window; /* the present one */
    float window_hz;
} an_moment;

/* What an_application_keep has seen to. */
typedef struct {
    uint32_t chosen;
    uint32_t measured;
    an_keep_state state;
} an_keeping;

/* A build; app is its own state. */
typedef struct an_build {
    uint8_t number; /* as a host is told */
    an_moment (*moment)(const an_application *app);
    const an_table *(*table)(const an_application *app);
    uint32_t (*entries)(const an_table *table);
    an_table_result (*accepts)(const an_table *table, float sample_rate_hz); /* a sound one: is it for this build and rate? */
    bool (*post_rest)(an_application *app, bool clear); /* the job; clear: it forgets the faults of the interrupts */
    void (*trip)(an_application *app, uint32_t faults); /* rests the outputs at once */
    void (*begin_identify)(an_application *app);
    void (*identify)(an_application *app); /* goes on with it */
    void (*follow)(an_application *app);   /* looks after the loop that runs */
    void (*set_reference)(an_application *app, float reference);
    uint8_t *(*put_status)(const an_application *app, uint8_t *at);
    uint8_t *(*put_values)(const an_application *app, uint8_t *at); /* what was measured, at most AN_KEEP_VALUES_MAX */
    bool (*take_values)(an_application *app, const uint8_t *values, uint32_t length); /* back again */
    an_result (*handle_request)(an_application *app, const an_message *request); /* those of no other build */
} an_build;

/* At rest, or in the faults found before. */
void an_application_boot(an_application *app, float sample_rate_hz, uint32_t faults);

/* One pass of the main loop. Nothing is decided while a job waits to be taken over: the slow step acts on faults by itself,
 * and does so first. */
void an_application_poll(an_application *app, const an_build *build);

/* True when a start would be granted. */
bool an_application_is_ready(const an_application *app, const an_build *build);

/* Measures the plate anew, known or not, and rests. False unless idle. */
bool an_application_identify(an_application *app, const an_build *build);

/* What was measured in the chosen slot is good: rests, and true, if that was all. */
bool an_application_is_measured(an_application *app, const an_build *build);

/* Back to rest. */
void an_application_stop(an_application *app);

/* A fault that the main loop found: latched, the outputs at rest at once. */
void an_application_fail(an_application *app, const an_build *build, an_fault fault);

/* Leaves the fault state when no fault of the board or the table is left. */
bool an_application_clear(an_application *app, const an_build *build);

/* A request of the host, as an_link passes it on. */
an_result an_application_handle_request(an_application *app, const an_build *build, const an_message *request,
                                        const an_table *staged, an_message *reply);

/* The counts and faults that every status has. */
uint8_t *an_application_put_counts(const an_application *app, uint32_t window, uint8_t *at);

/* True for a reference from 0 to 1. */
bool an_application_may_refer(float reference);

/* Keeps in memory (AN_SLOTS times AN_KEEP_BYTES, or NULL) what was measured since the last call, or takes from it what was
 * kept of a slot that was chosen since, once nothing is driven. */
void an_application_keep(an_application *app, const an_build *build, uint8_t *memory, an_keeping *keeping);

/* A start that a host ordered: it must keep talking from now on. */
an_result an_application_started(an_application *app, const an_build *build, bool done);

#endif
