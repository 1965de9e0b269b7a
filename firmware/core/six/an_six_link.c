/* Host requests of the six-channel application. */
#include "an_bytes.h"
#include "an_dds.h"
#include "an_six.h"

uint8_t *an_six_put_status(const an_application *base, uint8_t *at)
{
    const an_six *app = (const an_six *)base;
    an_six_status status;
    an_application_status(base, &an_six_build, app->identified, &status.head);
    status.head.choice[0] = (uint8_t)base->slot;
    status.head.choice[1] = (uint8_t)app->pattern;
    status.head.frequency_hz = an_dds_frequency(app->step, base->sample_rate_hz);
    status.head.metres = app->shape.metres;
    status.condition = app->shaping.condition;
    status.reachable = app->reachable;
    status.motion = app->motion;
    status.misfit = app->misfit;
    status.reference = app->slow.reference * app->slow.envelope;
    for (uint32_t i = 0u; i < AN_SIX; i++) {
        status.sensors[i] = app->slow.measured[i];
    }
    return an_put_object(at, &status, sizeof status);
}

static an_result start(an_six *app, const an_message *request)
{
    an_six_start_request given;
    an_get_object(&given, request->payload, sizeof given);
    if (given.pattern >= app->shape.pattern_count || !an_application_may_refer(given.reference)) {
        return AN_BAD_VALUE;
    }
    return an_application_started(&app->base, &an_six_build, an_six_start(app, given.pattern, given.reference));
}

/* Change the pattern while running, or select another shape at rest. */
static an_result choose(an_six *app, const an_message *request)
{
    an_choose_request given;
    an_get_object(&given, request->payload, sizeof given);
    if (given.shape >= app->table.shape_count) {
        return AN_BAD_VALUE;
    }
    if (given.shape != app->base.slot) {
        return an_six_choose(app, given.shape) ? AN_OK : AN_NOT_NOW;
    }
    if (given.pattern >= app->shape.pattern_count) {
        return AN_BAD_VALUE;
    }
    return an_six_change(app, given.pattern) ? AN_OK : AN_NOT_NOW;
}

/* Report the measured responses to one actuator. */
static an_result report_column(const an_six *app, const an_message *request, an_message *reply)
{
    an_column_request given;
    an_get_object(&given, request->payload, sizeof given);
    if (given.actuator >= app->channels) {
        return AN_BAD_VALUE;
    }
    if (app->identified == 0u && app->misfit == 0.0f) {
        return AN_NOT_NOW;
    }
    an_column column;
    an_clear(&column, sizeof column);
    for (uint32_t i = 0u; i < app->channels; i++) {
        column.responses[i] = app->shaping.matrix[i * AN_SIX + given.actuator];
        column.coherence[i] = app->coherence[i * AN_SIX + given.actuator];
    }
    column.seconds = app->probed_s;
    column.least_s = an_six_least_s(app);
    column.integral = an_six_integral(app);
    column.passed = column.integral / (AN_SIX_INTEGRAL - column.integral);
    reply->length = (uint32_t)(an_put_object(reply->payload + 1, &column, sizeof column) - reply->payload);
    return AN_OK;
}

an_result an_six_handle_request(an_application *base, const an_message *request, an_message *reply)
{
    an_six *app = (an_six *)base;
    switch (request->kind) {
    case AN_START:
        return start(app, request);
    case AN_PATTERN:
        return choose(app, request);
    case AN_COLUMN:
        return report_column(app, request, reply);
    default:
        return AN_UNKNOWN;
    }
}
