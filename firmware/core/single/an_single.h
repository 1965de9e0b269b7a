/* Single-mode application: fast tick, slow step and supervisor in one object, without globals.
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

/* At lower frequencies, a window cannot separate the carrier from the offset, nor can the sweep reach 4 % below. */
enum { AN_SINGLE_FREQUENCY_MIN_HZ = 2000 };

typedef struct {
    an_application base;
    an_fast fast;
    an_slow slow;
    an_mode mode; /* from the table or from identification */
    an_track track;
    an_watch watch; /* used by an_single_check */
    uint32_t acting; /* phase step at the last check within a window */
    an_mode now;  /* mode as tracked */
    an_ident ident;
    uint32_t mode_flags;
    uint32_t centre; /* phase step of the identified mode */
    uint32_t probing; /* nonzero: a dwell has been posted */
    float target_reference; /* 0: the lowest useful level */
    float detuning_hz;
    float followed_reference; /* at the last update of the tracking */
    bool eased;               /* the active gains are those of an eased drive */
    float neighbour; /* largest known response not due to the target mode */
    an_table table; /* last member: it holds the only pointer, so that all other offsets are the same on any machine */
} an_single;

/* Present values for display, read by the main loop between two windows. */
typedef struct {
    an_complex measured;
    an_complex drive; /* in the mode's frame */
    float reference;
    float offset;
} an_view;

/* Frequency of the resonance as tracked, in Hz. */
float an_single_frequency(const an_single *app);

/* True if the drive was at its limit for most of the last few windows. */
bool an_single_is_limited(const an_single *app);

an_view an_single_view(const an_single *app);

/* Read the table and start at rest. faults were found by the board before; any of them, or a rejected table, is
 * latched. */
void an_single_boot(an_single *app, const uint8_t *table, uint32_t length, float sample_rate_hz, uint32_t faults);

/* Run the slow step and advance the envelope; called once per window, before the end of the gap. */
void an_single_slow(an_single *app);

/* Check for faults that cannot wait for the end of a window: a sensor that is clipped, dead, stuck or reversed, and
 * corrupted state of the fast tick, which is repaired so that windows still end. Called every AN_WATCH_TICKS ticks from
 * an interrupt of the fast tick's priority. */
uint32_t an_single_check(an_single *app);

/* Log record of the last window. */
an_record an_single_record(const an_single *app);

/* True for a reference from 0 to 1 and a detuning within 500 Hz. */
bool an_single_may_start(float reference, float detuning_hz);

/* Drive the target mode at reference (fraction of full scale at the sensor; 0: lowest useful level), detuning_hz away
 * from its resonance. Unless gain and frequency have been measured, identification comes first. Returns false unless
 * idle and the values are in range. */
bool an_single_start(an_single *app, float reference, float detuning_hz);

/* True for a frequency that this build plays, a level from 0 to 1 of the drive limit, and a duration of at most ten
 * seconds. */
bool an_single_may_chirp(const an_single *app, const an_chirp_request *plan);

/* Drive a chirp, and stay in the state IDENTIFY until stopped. Returns false unless idle. */
bool an_single_chirp(an_single *app, const an_chirp_request *plan);

/* Record the response to a step of a chirp that has just ended; called after an_single_slow. */
void an_single_capture(const an_single *app, an_capture *capture);

/* True for values that a measurement may have. */
bool an_single_may_adopt(const an_single *app, const an_measured_request *values);

/* Take over the values of a host's measurement, which the next start checks. Returns false unless idle. */
bool an_single_adopt(an_single *app, const an_measured_request *values);

/* Change the reference while running; it is clipped to AN_REFERENCE_MAX of the amplitude limit. */
void an_single_set_reference(an_single *app, float reference);

/* Interface of this build to the code common to both. */
extern const an_build an_single_build;

/* Members of an_single_build defined in an_single_link.c. */
uint8_t *an_single_put_status(const an_application *app, uint8_t *at);
an_result an_single_handle_request(an_application *app, const an_message *request, an_message *reply);

#endif
