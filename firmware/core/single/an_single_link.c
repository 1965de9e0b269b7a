/* Host requests of the single-mode application. */
#include "an_bytes.h"
#include "an_single.h"

static uint8_t *put_mode(const an_single *app, uint8_t *at)
{
    const an_mode *mode = app->base.supervisor.state == AN_STATE_RUN ? &app->now : &app->mode;
    at = an_put_float(at, an_single_frequency(app));
    at = an_put_float(at, app->detuning_hz);
    at = an_put_float(at, mode->tau_s);
    at = an_put_complex(at, mode->gain);
    at = an_put_float(at, mode->delay_s);
    at = an_put_float(at, app->neighbour);
    at = an_put_float(at, app->ident.motion);
    return an_put_float(at, app->ident.misfit);
}

uint8_t *an_single_put_status(const an_application *base, uint8_t *at)
{
    const an_single *app = (const an_single *)base;
    const an_view view = an_single_view(app);
    at = an_put8(at, base->supervisor.state);
    at = an_put8(at, app->ident.stage);
    at = an_put8(at, base->texture.kind);
    at = an_put8(at, app->mode_flags | an_application_flags(base, an_single_is_limited(app)));
    at = an_application_put_counts(base, app->fast.window.count, at);
    at = put_mode(app, at);
    at = an_put_float(at, view.reference);
    at = an_put_complex(at, view.measured);
    at = an_put_complex(at, view.drive);
    return an_put_float(at, view.offset);
}

an_result an_single_handle_request(an_application *base, const an_message *request)
{
    an_single *app = (an_single *)base;
    if (request->kind != AN_START) {
        return AN_UNKNOWN;
    }
    const float reference = an_get_float(request->payload);
    const float detuning_hz = an_get_float(request->payload + 4);
    if (request->length != 8u || !an_single_may_start(reference, detuning_hz)) {
        return AN_BAD_VALUE;
    }
    return an_application_started(base, &an_single_build, an_single_start(app, reference, detuning_hz));
}

void an_single_record(const an_single *app, float *record)
{
    const an_view view = an_single_view(app);
    record[0] = view.measured.re;
    record[1] = view.measured.im;
    record[2] = view.drive.re;
    record[3] = view.drive.im;
    record[4] = view.reference;
}
