/* What a host may ask of the six-channel application. */
#include "an_bytes.h"
#include "an_dds.h"
#include "an_faults.h"
#include "an_six.h"

enum { IDENTITY_SIX = 6, HASH_AT = 32, HASH_BYTES = 16 };

static uint8_t *put_identity(const an_six *app, uint8_t *at)
{
    const bool known = (app->supervisor.faults & AN_FAULT_TABLE) == 0u;
    at = an_put8(at, AN_PROTOCOL);
    at = an_put8(at, IDENTITY_SIX);
    at = an_put8(at, AN_TABLE_VERSION);
    at = an_put8(at, known ? app->table.shape_count : 0u);
    for (uint32_t i = 0u; i < HASH_BYTES; i++) {
        at = an_put8(at, known ? app->table.data[HASH_AT + i] : 0u);
    }
    return at;
}

static uint8_t *put_status(const an_six *app, uint8_t *at)
{
    at = an_put8(at, app->supervisor.state);
    at = an_put8(at, app->shape_index);
    at = an_put8(at, app->pattern);
    at = an_put8(at, app->identified | (app->slow.limited != 0u ? (uint32_t)AN_STATUS_LIMITED : 0u));
    at = an_put32(at, app->supervisor.faults);
    at = an_put32(at, app->supervisor.first);
    at = an_put32(at, app->fast.window.count);
    at = an_put32(at, app->texture.starved);
    at = an_put32(at, app->worst_cycles);
    at = an_put_float(at, an_dds_frequency(app->step, app->sample_rate_hz));
    at = an_put_float(at, app->shaping.condition);
    at = an_put_float(at, app->reachable);
    at = an_put_float(at, app->slow.reference * app->slow.envelope);
    for (uint32_t i = 0u; i < AN_SIX; i++) {
        at = an_put_complex(at, app->slow.measured[i]);
    }
    return at;
}

static an_result result_of(bool done)
{
    return done ? AN_OK : AN_NOT_NOW;
}

/* Pattern and reference. */
static an_result start(an_six *app, const an_message *request)
{
    const uint32_t pattern = an_get32(request->payload);
    const float reference = an_get_float(request->payload + 4);
    if (pattern >= app->shape.pattern_count || !(reference >= 0.0f && reference <= 1.0f)) {
        return AN_BAD_VALUE;
    }
    const bool started = an_six_start(app, pattern, reference);
    if (started) {
        an_supervisor_bind_host(&app->supervisor, app->fast.window.count);
    }
    return result_of(started);
}

/* Shape and pattern: another pattern while running, another shape at rest. */
static an_result choose(an_six *app, const an_message *request)
{
    const uint32_t shape = an_get32(request->payload);
    const uint32_t pattern = an_get32(request->payload + 4);
    if (shape >= app->table.shape_count) {
        return AN_BAD_VALUE;
    }
    if (shape != app->shape_index) {
        return result_of(an_six_choose(app, shape));
    }
    return pattern < app->shape.pattern_count ? result_of(an_six_change(app, pattern)) : AN_BAD_VALUE;
}

static an_result refer(an_six *app, const an_message *request)
{
    const float reference = an_get_float(request->payload);
    if (!(reference >= 0.0f && reference <= 1.0f)) {
        return AN_BAD_VALUE;
    }
    if (app->supervisor.state != AN_STATE_RUN) {
        return AN_NOT_NOW;
    }
    an_six_refer(app, reference);
    return AN_OK;
}

static an_result sine(an_six *app, const an_message *request)
{
    const float window_hz = app->sample_rate_hz / (float)(app->window + AN_SIX_GAP);
    const float rate_hz = an_get_float(request->payload);
    const float depth = an_get_float(request->payload + 4);
    return an_texture_sine(&app->texture, rate_hz, depth, window_hz) ? AN_OK : AN_BAD_VALUE;
}

static an_result identify(an_six *app)
{
    const bool begun = an_six_identify(app);
    if (begun) {
        an_supervisor_bind_host(&app->supervisor, app->fast.window.count);
    }
    return result_of(begun);
}

static an_result judge(const an_six *app, const an_table *staged, an_message *reply)
{
    const an_table_result fitting = an_six_accepts(staged, app->sample_rate_hz);
    return fitting == AN_TABLE_OK ? result_of(!an_supervisor_drives(&app->supervisor)) : an_link_refuse(reply, fitting);
}

static bool has_its_length(const an_message *request)
{
    switch (request->kind) {
    case AN_START:
    case AN_SINE:
    case AN_PATTERN:
        return request->length == 8u;
    case AN_REFERENCE:
        return request->length == 4u;
    default:
        return request->length == 0u;
    }
}

static an_result obey(an_six *app, const an_message *request, const an_table *staged, an_message *reply)
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
        an_six_stop(app);
        return AN_OK;
    case AN_CLEAR:
        return result_of(an_six_clear(app));
    case AN_REFERENCE:
        return refer(app, request);
    case AN_SINE:
        return sine(app, request);
    case AN_PATTERN:
        return choose(app, request);
    case AN_IDENTIFY:
        return identify(app);
    case AN_UPLOAD_END:
        return judge(app, staged, reply);
    default:
        return AN_UNKNOWN;
    }
}

an_result an_six_obey(void *app, const an_message *request, const an_table *staged, an_message *reply)
{
    an_six *six = app;
    six->supervisor.heard = six->fast.window.count;
    return has_its_length(request) ? obey(six, request, staged, reply) : AN_BAD_VALUE;
}
