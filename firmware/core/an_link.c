#include "an_link.h"

#include "an_assert.h"
#include "an_bytes.h"
#include "an_crc.h"

enum { LOG_RECORD = sizeof(an_record), CAPTURE_WORDS = 56 };
_Static_assert(6 + 2 * CAPTURE_WORDS <= AN_PAYLOAD_MAX, "a reply holds its words");
_Static_assert(LOG_RECORD * AN_LOG_PER_FRAME <= AN_PAYLOAD_MAX, "a log frame holds its records");

void an_link_init(an_link *link, an_application *app, const an_build *build, an_capture *capture)
{
    an_clear(link, sizeof *link);
    an_frame_reader_init(&link->reader);
    link->app = app;
    link->build = build;
    link->capture = capture;
}

static an_result begin_upload(an_link *link, const an_message *request)
{
    const uint32_t length = an_get32(request->payload);
    if (length == 0u || length > AN_TABLE_MAX_BYTES) {
        return AN_BAD_VALUE;
    }
    link->staged_target = length;
    link->staged_length = 0u;
    return AN_OK;
}

/* A piece received twice is acknowledged twice: the first acknowledgement may have been lost. */
static an_result take_piece(an_link *link, const an_message *request)
{
    const uint32_t offset = an_get32(request->payload);
    const uint32_t length = request->length - 4u;
    if (offset > link->staged_length || length > link->staged_target || offset > link->staged_target - length) {
        return AN_BAD_VALUE;
    }
    for (uint32_t i = 0u; i < length; i++) {
        link->staged[offset + i] = request->payload[4u + i];
    }
    link->staged_length = offset + length > link->staged_length ? offset + length : link->staged_length;
    return AN_OK;
}

/* A table followed by extra bytes is also rejected. */
static an_table_result check_staged(an_link *link, an_table *table)
{
    const an_table_result found = an_table_open(table, link->staged, link->staged_length);
    return found == AN_TABLE_OK && table->length != link->staged_length ? AN_TABLE_LENGTH : found;
}

static an_result end_upload(an_link *link, const an_message *request, an_message *reply)
{
    if (link->staged_target == 0u || link->staged_length != link->staged_target) {
        return AN_BAD_VALUE;
    }
    an_table table;
    const an_table_result reason = check_staged(link, &table);
    if (reason != AN_TABLE_OK) {
        return an_protocol_refuse(reply, reason);
    }
    const an_result allowed = an_application_handle_request(link->app, link->build, request, &table, reply);
    if (allowed == AN_OK) {
        link->store_target = true;
        link->store_sequence = request->sequence;
    }
    return allowed;
}

static an_result set_log(an_link *link, const an_message *request)
{
    link->log_every = an_get32(request->payload);
    link->log_waited = 0u;
    link->log.length = 0u;
    return AN_OK;
}

static an_result report_health(const an_link *link, an_message *reply)
{
    an_put_object(reply->payload + 1, &link->health, sizeof link->health);
    reply->length = 1u + sizeof link->health;
    return AN_OK;
}

/* The payload gives the number of samples per row. */
static an_result begin_capture(an_link *link, const an_message *request)
{
    return an_capture_begin(link->capture, an_get32(request->payload)) ? AN_OK : AN_BAD_VALUE;
}

/* Its response is recorded in place of a capture. */
static an_result begin_chirp(an_link *link, const an_message *request, an_message *reply)
{
    const an_result begun = an_application_handle_request(link->app, link->build, request, NULL, reply);
    if (begun == AN_OK) {
        an_chirp_request given;
        an_get_object(&given, request->payload, sizeof given);
        an_capture_begin_chirp(link->capture, given.settle);
    }
    return begun;
}

/* Reply with the number of words so far and in total, the words per row, and the words from the requested index
 * onwards. */
static an_result report_captured(const an_link *link, const an_message *request, an_message *reply)
{
    const an_capture *capture = link->capture;
    const uint32_t used = an_capture_used(capture);
    uint8_t *at = an_put16(an_put16(reply->payload + 1, used), capture->total);
    at = an_put8(at, capture->row);
    const uint32_t from = an_get32(request->payload);
    for (uint32_t i = 0u; i < CAPTURE_WORDS && from < used && i < used - from; i++) {
        at = an_put16(at, capture->words[from + i]);
    }
    reply->length = (uint32_t)(at - reply->payload);
    return AN_OK;
}

static an_result answer(an_link *link, const an_message *request, an_message *reply)
{
    if (!an_protocol_has_its_length(request)) {
        return AN_BAD_VALUE;
    }
    switch (request->kind) {
    case AN_UPLOAD_BEGIN:
        return begin_upload(link, request);
    case AN_UPLOAD_DATA:
        return take_piece(link, request);
    case AN_UPLOAD_END:
        return end_upload(link, request, reply);
    case AN_LOG:
        return set_log(link, request);
    case AN_HEALTH:
        return report_health(link, reply);
    case AN_CAPTURE:
        return begin_capture(link, request);
    case AN_CHIRP:
        return begin_chirp(link, request, reply);
    case AN_CAPTURED:
        return report_captured(link, request, reply);
    default:
        return an_application_handle_request(link->app, link->build, request, NULL, reply);
    }
}

/* Requests that change nothing, and stop: a host that repeats a stop wants one, whatever became of the first. */
static bool is_always_executed(uint32_t kind)
{
    return kind == AN_IDENTITY || kind == AN_STATUS || kind == AN_HEALTH || kind == AN_CAPTURED || kind == AN_COLUMN || kind == AN_STOP;
}

static uint32_t digest_of(const an_message *request)
{
    return an_crc32(request->payload, request->length);
}

static bool is_repeated(const an_link *link, const an_message *request)
{
    const an_last_request *last = &link->last;
    return last->known && last->kind == request->kind && last->digest == digest_of(request);
}

static void remember(an_link *link, const an_message *request)
{
    link->last.known = true;
    link->last.kind = request->kind;
    link->last.sequence = request->sequence;
    link->last.digest = digest_of(request);
}

static void send(an_link *link, an_message *reply, uint32_t kind, uint32_t sequence, an_result result)
{
    reply->kind = (uint8_t)(kind | AN_REPLY);
    reply->sequence = (uint8_t)sequence;
    reply->payload[0] = (uint8_t)result;
    link->out_length = an_frame_write(link->out, reply);
}

/* Send a reply and keep a copy of it; such replies have at most two bytes. */
static void send_and_keep(an_link *link, an_message *reply, uint32_t kind, uint32_t sequence, an_result result)
{
    AN_ASSERT(reply->length <= sizeof link->last.answer);
    send(link, reply, kind, sequence, result);
    link->last.answer[0] = reply->payload[0];
    link->last.answer[1] = reply->length > 1u ? reply->payload[1] : 0u;
    link->last.answer_length = reply->length;
}

static void send_again(an_link *link, const an_message *request, an_message *reply)
{
    reply->length = link->last.answer_length;
    reply->payload[1] = link->last.answer[1];
    send(link, reply, request->kind, request->sequence, (an_result)link->last.answer[0]);
}

void an_link_feed(an_link *link, uint8_t byte)
{
    an_message request;
    an_message reply;
    if (!an_frame_feed(&link->reader, byte, &request) || (request.kind & AN_REPLY) != 0u) {
        return;
    }
    link->app->supervisor.heard = link->build->moment(link->app).window;
    reply.length = 1u;
    link->last.known = link->last.known && link->last.sequence == request.sequence;
    if (is_always_executed(request.kind)) {
        const an_result result = answer(link, &request, &reply);
        send(link, &reply, request.kind, request.sequence, result);
        return;
    }
    if (is_repeated(link, &request)) {
        send_again(link, &request, &reply);
        return;
    }
    remember(link, &request);
    const an_result result = answer(link, &request, &reply);
    if (!link->store_target) {
        send_and_keep(link, &reply, request.kind, request.sequence, result);
    }
}

void an_link_stored(an_link *link, bool done)
{
    an_message reply;
    reply.length = 1u;
    link->store_target = false;
    link->staged_target = 0u;
    send_and_keep(link, &reply, AN_UPLOAD_END, link->store_sequence, done ? AN_OK : AN_STORE_FAILED);
}

void an_link_log(an_link *link, const an_record *record)
{
    if (link->log_every == 0u || ++link->log_waited < link->log_every) {
        return;
    }
    link->log_waited = 0u;
    if (link->log.length + LOG_RECORD <= AN_PAYLOAD_MAX) {
        an_put_object(link->log.payload + link->log.length, record, sizeof *record);
        link->log.length += LOG_RECORD;
    }
    if (link->log.length >= LOG_RECORD * AN_LOG_PER_FRAME && link->out_length == 0u) {
        link->log.kind = AN_LOG_RECORDS;
        link->log.sequence++;
        link->out_length = an_frame_write(link->out, &link->log);
        link->log.length = 0u;
    }
}
