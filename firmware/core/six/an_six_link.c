/* Host requests of the six-channel application. */
#include "an_bytes.h"
#include "an_dds.h"
#include "an_six.h"

uint8_t *an_six_put_status(const an_application *base, uint8_t *at)
{
    const an_six *app = (const an_six *)base;
    at = an_put8(at, base->supervisor.state);
    at = an_put8(at, base->slot);
    at = an_put8(at, app->pattern);
    at = an_put8(at, app->identified | an_application_flags(base, app->slow.limited != 0u));
    at = an_application_put_counts(base, app->fast.window.count, at);
    at = an_put_float(at, an_dds_frequency(app->step, base->sample_rate_hz));
    at = an_put_float(at, app->shaping.condition);
    at = an_put_float(at, app->reachable);
    at = an_put_float(at, app->slow.reference * app->slow.envelope);
    for (uint32_t i = 0u; i < AN_SIX; i++) {
        at = an_put_complex(at, app->slow.measured[i]);
    }
    return at;
}

/* Payload: pattern and reference. */
static an_result start(an_six *app, const an_message *request)
{
    const uint32_t pattern = an_get32(request->payload);
    const float reference = an_get_float(request->payload + 4);
    if (pattern >= app->shape.pattern_count || !an_application_may_refer(reference)) {
        return AN_BAD_VALUE;
    }
    return an_application_started(&app->base, &an_six_build, an_six_start(app, pattern, reference));
}

/* Payload: shape and pattern. Change the pattern while running, or select another shape at rest. */
static an_result choose(an_six *app, const an_message *request)
{
    const uint32_t shape = an_get32(request->payload);
    const uint32_t pattern = an_get32(request->payload + 4);
    if (shape >= app->table.shape_count) {
        return AN_BAD_VALUE;
    }
    if (shape != app->base.slot) {
        return an_six_choose(app, shape) ? AN_OK : AN_NOT_NOW;
    }
    if (pattern >= app->shape.pattern_count) {
        return AN_BAD_VALUE;
    }
    return an_six_change(app, pattern) ? AN_OK : AN_NOT_NOW;
}

an_result an_six_handle_request(an_application *base, const an_message *request)
{
    an_six *app = (an_six *)base;
    if (request->kind != AN_START && request->kind != AN_PATTERN) {
        return AN_UNKNOWN;
    }
    if (request->length != 8u) {
        return AN_BAD_VALUE;
    }
    return request->kind == AN_START ? start(app, request) : choose(app, request);
}
