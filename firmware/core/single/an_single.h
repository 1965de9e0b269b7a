/* The single-mode application: fast tick, slow step and supervisor in one object without a global.
 *
 * The fast tick and the slow step run in interrupts, everything else in the main loop.
 */
#ifndef AN_SINGLE_H
#define AN_SINGLE_H

#include "an_application.h"
#include "an_fast.h"
#include "an_ident.h"
#include "an_slow.h"
#include "an_table.h"
#include "an_types.h"

/* Lower tones than this cannot be told from an offset in a window, nor searched to 4 % below. */
enum { AN_SINGLE_FREQUENCY_MIN_HZ = 2000 };

typedef struct {
    an_application base;
    an_fast fast;
    an_slow slow;
    an_mode mode; /* as the table holds it or identification found it */
    an_track track;
    an_watch watch; /* the looks' own */
    uint32_t acting; /* the phase step at the last look in a window */
    an_mode now;  /* as it is followed */
    an_ident ident;
    uint32_t mode_flags;
    uint32_t centre; /* phase step of the mode as identified */
    uint32_t probing; /* a dwell has been posted */
    float target_reference; /* 0: the lowest useful level */
    float detuning_hz;
    float followed_reference; /* at the last look at the plate's balance */
    float neighbour; /* largest response beside the target mode's, as far as it is known */
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

/* Reads the table and rests. faults are those the board found before; any of them, or a refused table, latches. */
void an_single_boot(an_single *app, const uint8_t *table, uint32_t length, float sample_rate_hz, uint32_t faults);

/* Once for each window, before the gap ends: the slow step, then the envelope's next factor. */
void an_single_slow(an_single *app);

/* Faults that a look finds before a window's end, every AN_WATCH_TICKS ticks from an interrupt of the fast tick's priority: a
 * sensor at the converter's end, or dead, stuck or reversed; and damage to what the tick relies on, mended so that windows
 * go on to end. */
uint32_t an_single_check(an_single *app);

/* The log's record of the last window: measured, drive, reference. */
void an_single_record(const an_single *app, float *record);

/* True for a reference from 0 to 1 and a detuning within 500 Hz. */
bool an_single_may_start(float reference, float detuning_hz);

/* Drives the target mode at reference (fraction of full scale at the sensor, 0: lowest useful level), detuning_hz
 * away from its resonance; identifies first unless gain and frequency were measured. False unless idle and the
 * values are in range. */
bool an_single_start(an_single *app, float reference, float detuning_hz);

/* A new reference while running; clipped to what the amplitude limit leaves. */
void an_single_set_reference(an_single *app, float reference);

/* What this build gives to what both share. */
extern const an_build an_single_build;

/* Members of it that stand in another file than the rest. */
uint8_t *an_single_put_status(const an_application *app, uint8_t *at);
an_result an_single_handle_request(an_application *app, const an_message *request);

#endif
