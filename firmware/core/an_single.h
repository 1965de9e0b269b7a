/* The single-mode application: fast tick, slow step and supervisor in one object without a global.
 *
 * States: IDLE (outputs at rest), IDENTIFY (sweep), RUN (closed loop), FAULT (latched, outputs at rest). The fast
 * tick and the slow step run in interrupts, everything else in the main loop.
 */
#ifndef AN_SINGLE_H
#define AN_SINGLE_H

#include "an_fast.h"
#include "an_ident.h"
#include "an_slow.h"
#include "an_link.h"
#include "an_table.h"
#include "an_texture.h"
#include "an_types.h"

enum { AN_STATE_IDLE, AN_STATE_IDENTIFY, AN_STATE_RUN, AN_STATE_FAULT };

typedef struct {
    an_fast fast;
    an_slow slow;
    an_mode mode;
    an_ident ident;
    uint32_t mode_flags;
    uint32_t centre; /* phase step of the mode */
    uint32_t state;
    uint32_t faults;
    uint32_t probing; /* a dwell has been posted */
    bool stopping;
    float wanted_reference; /* 0: the lowest useful level */
    an_texture texture;
    bool host_drives;    /* started by a host, which must keep talking */
    uint32_t host_heard; /* the window then */
    uint32_t worst_cycles; /* of the fast interrupt; the board's note */
    float detuning_hz;
    float neighbour; /* largest response beside the wanted mode's, as far as it is known */
    float sample_rate_hz;
    an_table table; /* last: it holds the one pointer, so that all else lies alike on any machine */
} an_single;

/* What goes on, for whoever watches: between two windows, from the main loop. */
typedef struct {
    an_complex measured;
    an_complex drive; /* in the mode's frame */
    float reference;
    float offset;
} an_view;

an_view an_single_view(const an_single *app);

/* Reads the table and rests. faults are those the board found before; any of them, or a refused table, latches. */
void an_single_boot(an_single *app, const uint8_t *table, uint32_t length, float sample_rate_hz, uint32_t faults);

/* Once for each window, before the gap ends: the slow step, then the envelope's next factor. */
void an_single_slow(an_single *app);

/* One pass of the main loop. */
void an_single_poll(an_single *app);

/* A request of the host, as an_link passes it on. */
uint32_t an_single_obey(void *app, const an_message *request, an_message *reply);

/* The log's record of the last window: measured, drive, reference. */
void an_single_record(const an_single *app, float *record);

/* True for a reference from 0 to 1 and a detuning within 500 Hz. */
bool an_single_may_start(float reference, float detuning_hz);

/* Drives the wanted mode at reference (fraction of full scale at the sensor, 0: lowest useful level), detuning_hz
 * away from its resonance; identifies first unless gain and frequency were measured. False unless idle and the
 * values are in range. */
bool an_single_start(an_single *app, float reference, float detuning_hz);

/* A new reference while running; clipped to what the amplitude limit leaves. */
void an_single_refer(an_single *app, float reference);

/* Back to rest. */
void an_single_stop(an_single *app);

/* A fault that the board found. */
void an_single_trip(an_single *app, uint32_t fault);

/* Leaves the fault state when no fault of the board or the table is left. */
bool an_single_clear(an_single *app);

#endif
