/* Host requests of the single-mode application. */
#include "an_bytes.h"
#include "an_single.h"

uint8_t *an_single_put_status(const an_application *base, uint8_t *at)
{
    const an_single *app = (const an_single *)base;
    const an_mode *mode = base->supervisor.state == AN_STATE_RUN ? &app->now : &app->mode;
    const an_view view = an_single_view(app);
    an_single_status status;
    const uint32_t senses = (app->table.flags & AN_SENSES_DISPLACEMENT) != 0u ? (uint32_t)AN_STATUS_DISPLACEMENT : 0u;
    an_application_status(base, &an_single_build, app->mode_flags | senses, &status.head);
    status.head.choice[0] = (uint8_t)app->ident.stage;
    status.head.choice[1] = (uint8_t)base->texture.kind;
    status.head.frequency_hz = an_single_frequency(app);
    status.head.metres = app->mode.metres;
    status.detuning_hz = app->detuning_hz;
    status.tau_s = mode->tau_s;
    status.gain = mode->gain;
    status.delay_s = mode->delay_s;
    status.neighbour = app->neighbour;
    status.motion = app->ident.motion;
    status.misfit = app->ident.misfit;
    status.reference = view.reference;
    status.measured = view.measured;
    status.drive = view.drive;
    status.offset = view.offset;
    return an_put_object(at, &status, sizeof status);
}

static an_result start(an_single *app, const an_message *request)
{
    an_start_request given;
    an_get_object(&given, request->payload, sizeof given);
    if (!an_single_may_start(given.reference, given.detuning_hz)) {
        return AN_BAD_VALUE;
    }
    const bool started = an_single_start(app, given.reference, given.detuning_hz);
    return an_application_started(&app->base, &an_single_build, started);
}

static an_result chirp(an_single *app, const an_message *request)
{
    an_chirp_request given;
    an_get_object(&given, request->payload, sizeof given);
    if (!an_single_may_chirp(app, &given)) {
        return AN_BAD_VALUE;
    }
    return an_application_started(&app->base, &an_single_build, an_single_chirp(app, &given));
}

static an_result adopt(an_single *app, const an_message *request)
{
    an_measured_request given;
    an_get_object(&given, request->payload, sizeof given);
    if (!an_single_may_adopt(app, &given)) {
        return AN_BAD_VALUE;
    }
    return an_single_adopt(app, &given) ? AN_OK : AN_NOT_NOW;
}

an_result an_single_handle_request(an_application *base, const an_message *request, an_message *reply)
{
    (void)reply;
    an_single *app = (an_single *)base;
    switch (request->kind) {
    case AN_START:
        return start(app, request);
    case AN_CHIRP:
        return chirp(app, request);
    case AN_MEASURED:
        return adopt(app, request);
    default:
        return AN_UNKNOWN;
    }
}

an_record an_single_record(const an_single *app)
{
    const an_view view = an_single_view(app);
    const an_record record = {
        .window = app->fast.window.count,
        .measured = view.measured,
        .drive = view.drive,
        .reference = view.reference,
    };
    return record;
}
