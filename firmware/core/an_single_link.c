/* What a host may ask of the single-mode application. */
#include "an_bytes.h"
#include "an_dds.h"
#include "an_faults.h"
#include "an_single.h"

enum { IDENTITY_SINGLE = 1, HASH_AT = 32, HASH_BYTES = 16 };

static uint8_t *put_identity(const an_single *app, uint8_t *at)
{
    const bool known = (app->supervisor.faults & AN_FAULT_TABLE) == 0u;
    at = an_put8(at, AN_PROTOCOL);
    at = an_put8(at, IDENTITY_SINGLE);
    at = an_put8(at, AN_TABLE_VERSION);
    at = an_put8(at, known ? app->table.mode_count : 0u);
    for (uint32_t i = 0u; i < HASH_BYTES; i++) {
        at = an_put8(at, known ? app->table.data[HASH_AT + i] : 0u);
    }
    return at;
}

static uint8_t *put_mode(const an_single *app, uint8_t *at)
{
    const an_mode *mode = app->supervisor.state == AN_STATE_RUN ? &app->now : &app->mode;
    at = an_put_float(at, an_single_frequency(app));
    at = an_put_float(at, app->detuning_hz);
    at = an_put_float(at, mode->tau_s);
    at = an_put_complex(at, mode->gain);
    at = an_put_float(at, mode->delay_s);
    return an_put_float(at, app->neighbour);
}

static uint8_t *put_status(const an_single *app, uint8_t *at)
{
    const an_view view = an_single_view(app);
    at = an_put8(at, app->supervisor.state);
    at = an_put8(at, app->ident.stage);
    at = an_put8(at, app->texture.kind);
    at = an_put8(at, app->mode_flags | (an_single_is_limited(app) ? (uint32_t)AN_STATUS_LIMITED : 0u));
    at = an_put32(at, app->supervisor.faults);
    at = an_put32(at, app->supervisor.first);
    at = an_put32(at, app->fast.window.count);
    at = an_put32(at, app->texture.starved);
    at = an_put32(at, app->worst_cycles);
    at = put_mode(app, at);
    at = an_put_float(at, view.reference);
    at = an_put_complex(at, view.measured);
    at = an_put_complex(at, view.drive);
    return an_put_float(at, view.offset);
}

static an_result result_of(bool done)
{
    return done ? AN_OK : AN_NOT_NOW;
}

static an_result start(an_single *app, const an_message *request)
{
    const float reference = an_get_float(request->payload);
    const float detuning_hz = an_get_float(request->payload + 4);
    if (!an_single_may_start(reference, detuning_hz)) {
        return AN_BAD_VALUE;
    }
    const bool started = an_single_start(app, reference, detuning_hz);
    if (started) {
        an_supervisor_bind_host(&app->supervisor, app->fast.window.count);
    }
    return result_of(started);
}

static an_result refer(an_single *app, const an_message *request)
{
    const float reference = an_get_float(request->payload);
    if (!(reference >= 0.0f && reference <= 1.0f)) {
        return AN_BAD_VALUE;
    }
    if (app->supervisor.state != AN_STATE_RUN) {
        return AN_NOT_NOW;
    }
    an_single_refer(app, reference);
    return AN_OK;
}

static an_result sine(an_single *app, const an_message *request)
{
    const float window_hz = app->sample_rate_hz / (float)AN_PERIOD;
    const float rate_hz = an_get_float(request->payload);
    const float depth = an_get_float(request->payload + 4);
    return an_texture_sine(&app->texture, rate_hz, depth, window_hz) ? AN_OK : AN_BAD_VALUE;
}

/* Replies how many of the samples were taken. */
static an_result samples(an_single *app, const an_message *request, an_message *reply)
{
    uint32_t taken = 0u;
    while (2u * taken + 2u <= request->length &&
           an_texture_give(&app->texture, an_get16(request->payload + 2u * taken))) {
        taken++;
    }
    reply->payload[1] = (uint8_t)taken;
    reply->length = 2u;
    return app->texture.kind == AN_TEXTURE_STREAM ? AN_OK : AN_NOT_NOW;
}

static an_result identify(an_single *app)
{
    const bool begun = an_single_identify(app);
    if (begun) {
        an_supervisor_bind_host(&app->supervisor, app->fast.window.count);
    }
    return result_of(begun);
}

static an_result judge(const an_single *app, const an_table *staged, an_message *reply)
{
    const an_table_result fitting = an_single_accepts(staged, app->sample_rate_hz);
    return fitting == AN_TABLE_OK ? result_of(!an_supervisor_drives(&app->supervisor)) : an_link_refuse(reply, fitting);
}

/* Payload bytes a request must have; samples come in any number. */
static bool has_its_length(const an_message *request)
{
    switch (request->kind) {
    case AN_START:
    case AN_SINE:
        return request->length == 8u;
    case AN_REFERENCE:
    case AN_STREAM:
        return request->length == 4u;
    case AN_SAMPLES:
        return request->length > 0u && request->length % 2u == 0u;
    default:
        return request->length == 0u;
    }
}

static an_result obey(an_single *app, const an_message *request, const an_table *staged, an_message *reply)
{
    uint8_t *more = reply->payload + 1;
    switch (request->kind) {
    case AN_IDENTITY:
        reply->length = (uint32_t)(put_identity(app, more) - reply->payload);
        return AN_OK;
    case AN_STATUS:
        reply->length = (uint32_t)(put_status(app, more) - reply->payload);
        return AN_OK;
    case AN_START:
        return start(app, request);
    case AN_STOP:
        an_single_stop(app);
        return AN_OK;
    case AN_CLEAR:
        return result_of(an_single_clear(app));
    case AN_REFERENCE:
        return refer(app, request);
    case AN_SINE:
        return sine(app, request);
    case AN_STREAM:
        return an_texture_stream(&app->texture, an_get32(request->payload)) ? AN_OK : AN_BAD_VALUE;
    case AN_SAMPLES:
        return samples(app, request, reply);
    case AN_IDENTIFY:
        return identify(app);
    case AN_UPLOAD_END:
        return judge(app, staged, reply);
    default:
        return AN_UNKNOWN;
    }
}

an_result an_single_obey(void *app, const an_message *request, const an_table *staged, an_message *reply)
{
    an_single *single = app;
    single->supervisor.heard = single->fast.window.count;
    return has_its_length(request) ? obey(single, request, staged, reply) : AN_BAD_VALUE;
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
