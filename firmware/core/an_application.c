#include "an_application.h"

#include "an_bytes.h"
#include "an_wire.h"

#define AN_FULL_DRIVE_S 10.0f
#define AN_FADE_S 0.5f /* longest time between a stop and rest */

void an_application_boot(an_application *app, float sample_rate_hz, uint32_t faults)
{
    app->sample_rate_hz = sample_rate_hz;
    app->worst_cycles = 0u;
    app->slot = 0u;
    app->chosen++;
    app->looked = 0u;
    app->full_s = 0.0f;
    app->fade_s = 0.0f;
    app->confirmed = false;
    app->eased = false;
    an_clear(&app->retry, sizeof app->retry);
    an_texture_init(&app->texture);
    an_supervisor_boot(&app->supervisor, faults);
}

bool an_application_is_ready(const an_application *app, const an_build *build)
{
    return app->supervisor.state == AN_STATE_IDLE && build->moment(app).vacant;
}

void an_application_fail(an_application *app, const an_build *build, an_fault fault)
{
    an_supervisor_fail(&app->supervisor, fault);
    build->trip(app, fault);
    build->post_rest(app, false);
    an_texture_end_stream(&app->texture);
}

bool an_application_identify(an_application *app, const an_build *build)
{
    if (!an_application_is_ready(app, build)) {
        return false;
    }
    an_supervisor_begin(&app->supervisor, AN_STATE_IDENTIFY);
    app->supervisor.measure_only = true;
    build->begin_identify(app);
    return true;
}

bool an_application_is_measured(an_application *app, const an_build *build)
{
    app->measured++;
    app->confirmed = true;
    return an_application_ends_measurement(app, build);
}

bool an_application_ends_measurement(an_application *app, const an_build *build)
{
    if (app->supervisor.measure_only) {
        an_supervisor_enter(&app->supervisor, AN_STATE_IDLE);
        build->post_rest(app, false);
    }
    return app->supervisor.measure_only;
}

void an_application_stop(an_application *app)
{
    an_retry_cancel(&app->retry);
    if (app->fade_s == 0.0f && an_supervisor_drives(&app->supervisor)) {
        app->fade_s = AN_FADE_S;
    }
}

bool an_application_clear(an_application *app, const an_build *build)
{
    if (!an_supervisor_may_clear(&app->supervisor) || !build->moment(app).vacant) {
        return false;
    }
    build->post_rest(app, true);
    an_supervisor_clear(&app->supervisor);
    return true;
}

static void rest(an_application *app, const an_build *build)
{
    if (app->supervisor.state == AN_STATE_FAULT) {
        build->trip(app, app->supervisor.faults);
    }
    build->post_rest(app, false);
    an_texture_end_stream(&app->texture);
}

/* Bound the time of hard drive: after AN_FULL_DRIVE_S the drive is limited to AN_EASED for as long. */
static void limit_full_drive(an_application *app, const an_moment *now, float passed_s)
{
    const float full_s = app->full_s + (now->hard ? passed_s : -passed_s);
    app->full_s = full_s > 0.0f ? full_s : 0.0f;
    app->eased = app->full_s >= AN_FULL_DRIVE_S || (app->eased && app->full_s > 0.0f);
}

/* End a job that was stopped, once its drives have faded out. */
static void serve_stop(an_application *app, const an_build *build, float passed_s)
{
    if (app->fade_s == 0.0f) {
        return;
    }
    app->fade_s -= passed_s;
    const bool fades = app->supervisor.state == AN_STATE_RUN && build->fades != NULL && build->fades(app);
    if (!(fades && app->fade_s > 0.0f)) {
        app->fade_s = 0.0f;
        an_supervisor_stop(&app->supervisor);
    }
}

/* Start the last job again; its host has stayed in contact. */
static void start_again(an_application *app, const an_build *build)
{
    const bool host_drives = app->retry.host_drives;
    const bool started = app->retry.measure_only ? an_application_identify(app, build) : build->restart(app);
    app->supervisor.host_drives = started && host_drives;
}

static void serve_retry(an_application *app, const an_build *build, an_retry_order order)
{
    if (order == AN_RETRY_CLEAR || order == AN_RETRY_GIVE_UP) {
        an_application_clear(app, build);
        app->confirmed = app->confirmed && order == AN_RETRY_CLEAR;
    } else if (order == AN_RETRY_START) {
        start_again(app, build);
    }
}

void an_application_poll(an_application *app, const an_build *build)
{
    const an_moment now = build->moment(app);
    if (!now.vacant) {
        if (!an_supervisor_is_sound(&app->supervisor)) {
            build->trip(app, AN_FAULT_MEMORY);
        }
        return;
    }
    const float passed_s = (float)(now.window - app->looked) / now.window_hz;
    app->looked = now.window;
    limit_full_drive(app, &now, passed_s);
    serve_stop(app, build, passed_s);
    const an_retry_order order = an_retry_decide(&app->retry, &app->supervisor, now.window, 1.0f / now.window_hz);
    switch (an_supervisor_decide(&app->supervisor, now.job, now.faults, now.window, 1.0f / now.window_hz)) {
    case AN_ACT_REST:
        rest(app, build);
        return;
    case AN_ACT_IDENTIFY:
        build->identify(app);
        return;
    case AN_ACT_NONE:
    default:
        break;
    }
    if (app->supervisor.state == AN_STATE_RUN) {
        build->follow(app);
    }
    serve_retry(app, build, order);
}

/* Values are bound to build, slot and protocol: another program may have measured them otherwise. */
static uint32_t keep_name(const an_application *app, const an_build *build)
{
    return build->number | app->slot << 8 | (uint32_t)AN_PROTOCOL << 16;
}

static void keep(const an_application *app, const an_build *build, uint8_t *memory, an_keeping *keeping)
{
    uint8_t values[AN_KEEP_VALUES_MAX];
    const uint32_t length = (uint32_t)(build->put_values(app, values) - values);
    an_keep_write(memory, keep_name(app, build), build->table(app), values, length);
    keeping->state = AN_KEEP_WRITTEN;
}

static void take_kept(an_application *app, const an_build *build, const uint8_t *memory, an_keeping *keeping)
{
    uint8_t values[AN_KEEP_VALUES_MAX];
    const uint32_t length = an_keep_read(memory, keep_name(app, build), build->table(app), values, &keeping->state);
    if (keeping->state == AN_KEEP_READ && !build->take_values(app, values, length)) {
        keeping->state = AN_KEEP_REFUSED;
    }
}

void an_application_keep(an_application *app, const an_build *build, uint8_t *memory, an_keeping *keeping)
{
    if (memory == NULL || app->slot >= (uint32_t)AN_SLOTS || (app->supervisor.faults & AN_FAULT_TABLE) != 0u) {
        return;
    }
    uint8_t *place = memory + app->slot * AN_KEEP_BYTES;
    if (keeping->measured != app->measured) {
        keep(app, build, place, keeping);
    } else if (keeping->chosen != app->chosen && !an_supervisor_drives(&app->supervisor)) {
        take_kept(app, build, place, keeping);
    } else {
        return;
    }
    keeping->measured = app->measured;
    keeping->chosen = app->chosen;
}

static an_result result_of(bool done)
{
    return done ? AN_OK : AN_NOT_NOW;
}

static void put_limits(const an_table *table, an_identity *identity)
{
    an_mode target;
    if (table->mode_count > 0u) {
        an_table_mode(table, table->target, &target);
        identity->drive_limit = target.drive_limit;
        identity->amplitude_limit = target.amplitude_limit;
    }
}

static uint8_t *put_identity(const an_application *app, const an_build *build, uint8_t *at)
{
    const an_table *table = build->table(app);
    const bool known = (app->supervisor.faults & AN_FAULT_TABLE) == 0u;
    an_identity identity;
    an_clear(&identity, sizeof identity);
    identity.protocol = AN_PROTOCOL;
    identity.build_number = build->number;
    identity.table_version = AN_TABLE_VERSION;
    if (known) {
        identity.count = (uint8_t)build->entries(table);
        put_limits(table, &identity);
        an_get_object(identity.design, table->data + offsetof(an_header_row, design_hash), sizeof identity.design);
    }
    return an_put_object(at, &identity, sizeof identity);
}

void an_application_status(const an_application *app, const an_build *build, uint32_t flags, an_status *status)
{
    const an_moment now = build->moment(app);
    const uint32_t own = (now.limited ? (uint32_t)AN_STATUS_LIMITED : 0u) |
                         (app->retry.waits || app->retry.due ? (uint32_t)AN_STATUS_RETRIES : 0u) |
                         (app->retry.gave_up != 0u ? (uint32_t)AN_STATUS_GAVE_UP : 0u) |
                         (app->eased ? (uint32_t)AN_STATUS_EASED : 0u);
    status->state_number = (uint8_t)app->supervisor.state;
    status->flags = (uint8_t)(flags | own);
    status->fault_bits = app->supervisor.faults;
    status->first_bits = app->supervisor.first | app->retry.gave_up;
    status->windows = now.window;
    status->underruns = app->texture.underruns;
    status->worst_cycles = app->worst_cycles;
}

bool an_application_may_refer(float reference)
{
    return reference >= 0.0f && reference <= 1.0f;
}

static an_result set_reference(an_application *app, const an_build *build, const an_message *request)
{
    an_reference_request given;
    an_get_object(&given, request->payload, sizeof given);
    if (!an_application_may_refer(given.reference)) {
        return AN_BAD_VALUE;
    }
    if (app->supervisor.state != AN_STATE_RUN) {
        return AN_NOT_NOW;
    }
    build->set_reference(app, given.reference);
    return AN_OK;
}

static an_result set_sine(an_application *app, const an_build *build, const an_message *request)
{
    an_sine_request given;
    an_get_object(&given, request->payload, sizeof given);
    return an_texture_sine(&app->texture, given.rate_hz, given.depth, build->moment(app).window_hz) ? AN_OK : AN_BAD_VALUE;
}

/* Reply with the number of samples accepted. */
static an_result take_samples(an_application *app, const an_message *request, an_message *reply)
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

an_result an_application_started(an_application *app, const an_build *build, bool done)
{
    if (done) {
        an_supervisor_bind_host(&app->supervisor, build->moment(app).window);
    }
    return result_of(done);
}

static an_result check_table(const an_application *app, const an_build *build, const an_table *staged,
                             an_message *reply)
{
    const an_table_result found = build->accepts(staged, app->sample_rate_hz);
    const uint32_t faults = app->supervisor.faults | build->moment(app).faults;
    const bool writable = !an_supervisor_drives(&app->supervisor) && (faults & AN_FAULT_SUPPLY) == 0u;
    return found == AN_TABLE_OK ? result_of(writable) : an_protocol_refuse(reply, found);
}

an_result an_application_handle_request(an_application *app, const an_build *build, const an_message *request,
                                        const an_table *staged, an_message *reply)
{
    uint8_t *more = reply->payload + 1;
    switch (request->kind) {
    case AN_IDENTITY:
        reply->length = (uint32_t)(put_identity(app, build, more) - reply->payload);
        return AN_OK;
    case AN_STATUS:
        reply->length = (uint32_t)(build->put_status(app, more) - reply->payload);
        return AN_OK;
    case AN_STOP:
        an_application_stop(app);
        return AN_OK;
    case AN_CLEAR:
        return result_of(an_application_clear(app, build));
    case AN_REFERENCE:
        return set_reference(app, build, request);
    case AN_SINE:
        return set_sine(app, build, request);
    case AN_STREAM:
        return an_texture_stream(&app->texture, an_get32(request->payload)) ? AN_OK : AN_BAD_VALUE;
    case AN_SAMPLES:
        return take_samples(app, request, reply);
    case AN_IDENTIFY:
        return an_application_started(app, build, an_application_identify(app, build));
    case AN_UPLOAD_END:
        return check_table(app, build, staged, reply);
    default:
        return build->handle_request(app, request, reply);
    }
}
