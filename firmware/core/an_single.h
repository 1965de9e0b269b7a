/* The single-mode application: fast tick, slow step and supervisor in one object without a global.
 *
 * The fast tick and the slow step run in interrupts, everything else in the main loop.
 */
#ifndef AN_SINGLE_H
#define AN_SINGLE_H

#include "an_fast.h"
#include "an_ident.h"
#include "an_slow.h"
#include "an_link.h"
#include "an_supervisor.h"
#include "an_table.h"
#include "an_texture.h"
#include "an_types.h"

typedef struct {
    an_fast fast;
    an_slow slow;
    an_mode mode; /* as the table holds it or identification found it */
    an_track track;
    an_mode now;  /* as it is followed */
    an_ident ident;
    uint32_t mode_flags;
    uint32_t centre; /* phase step of the mode as identified */
    an_supervisor supervisor;
    uint32_t probing; /* a dwell has been posted */
    float wanted_reference; /* 0: the lowest useful level */
    an_texture texture;
    uint32_t worst_cycles; /* of the fast interrupt; the board's note */
    float detuning_hz;
    float followed_reference; /* at the last look at the plate's balance */
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

/* Of the resonance, as it is followed. */
float an_single_frequency(const an_single *app);

/* True while the drive has been at its limit for most of the last few windows. */
bool an_single_is_limited(const an_single *app);

an_view an_single_view(const an_single *app);

/* Whether a sound table is one for this build at this rate. */
an_table_result an_single_accepts(const an_table *table, float sample_rate_hz);

/* Reads the table and rests. faults are those the board found before; any of them, or a refused table, latches. */
void an_single_boot(an_single *app, const uint8_t *table, uint32_t length, float sample_rate_hz, uint32_t faults);

/* Once for each window, before the gap ends: the slow step, then the envelope's next factor. */
void an_single_slow(an_single *app);

/* One pass of the main loop. */
void an_single_poll(an_single *app);

/* Faults that a look from outside finds in what the fast tick relies on, mended so that windows go on to end; from an
 * interrupt of its priority. */
uint32_t an_single_check(an_single *app);

/* A request of the host, as an_link passes it on. */
an_result an_single_obey(void *app, const an_message *request, const an_table *staged, an_message *reply);

/* The log's record of the last window: measured, drive, reference. */
void an_single_record(const an_single *app, float *record);

/* True for a reference from 0 to 1 and a detuning within 500 Hz. */
bool an_single_may_start(float reference, float detuning_hz);

/* Drives the wanted mode at reference (fraction of full scale at the sensor, 0: lowest useful level), detuning_hz
 * away from its resonance; identifies first unless gain and frequency were measured. False unless idle and the
 * values are in range. */
bool an_single_start(an_single *app, float reference, float detuning_hz);

/* Measures the mode anew, known or not, and rests. False unless idle. */
bool an_single_identify(an_single *app);

/* A new reference while running; clipped to what the amplitude limit leaves. */
void an_single_refer(an_single *app, float reference);

/* Back to rest. */
void an_single_stop(an_single *app);

/* A fault that the board found. */
void an_single_trip(an_single *app, uint32_t fault);

/* Leaves the fault state when no fault of the board or the table is left. */
bool an_single_clear(an_single *app);

#endif
