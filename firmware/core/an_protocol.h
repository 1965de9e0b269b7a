/* What host and board call things: kinds of requests, results, and the order of what health tells. */
#ifndef AN_PROTOCOL_H
#define AN_PROTOCOL_H

#include "an_frame.h"
#include "an_table.h"

typedef enum {
    AN_IDENTITY = 1,
    AN_STATUS = 2,
    AN_START = 3,
    AN_STOP = 4,
    AN_CLEAR = 5,
    AN_REFERENCE = 6,
    AN_SINE = 7,
    AN_STREAM = 8,
    AN_SAMPLES = 9,
    AN_LOG = 10,
    AN_UPLOAD_BEGIN = 11,
    AN_UPLOAD_DATA = 12,
    AN_UPLOAD_END = 13,
    AN_PATTERN = 14,
    AN_IDENTIFY = 15,
    AN_HEALTH = 16,
    AN_CAPTURE = 17,
    AN_CAPTURED = 18,
    AN_REPLY = 0x80,
    AN_LOG_RECORDS = 0xc0
} an_kind;

typedef enum {
    AN_OK,
    AN_UNKNOWN,       /* this image does not know the request */
    AN_BAD_VALUE,     /* wrong length, or a value out of range */
    AN_NOT_NOW,       /* refused in this state */
    AN_TABLE_REFUSED, /* followed by the reason, AN_TABLE_... */
    AN_STORE_FAILED
} an_result;

enum { AN_STATUS_LIMITED = 8 }; /* in a status' fourth byte: the drive is at its limit, and the plate short of its reference */

enum { AN_PROTOCOL = 3, AN_LOG_FLOATS = 5, AN_LOG_PER_FRAME = 4 };

/* What the board tells of itself, in answer to AN_HEALTH: 32-bit words in this order. Exception, pc, lr and cfsr are those
 * of the last interrupt that nobody expected, zeros when there was none since power-on. */
typedef enum {
    AN_HEALTH_RESETS, /* by the watchdog, in a row */
    AN_HEALTH_EXCEPTION,
    AN_HEALTH_PC,
    AN_HEALTH_LR,
    AN_HEALTH_CFSR,
    AN_HEALTH_CORE_HZ,
    AN_HEALTH_FAST_CYCLES, /* longest so far: fast interrupt, slow interrupt, pass of the main loop */
    AN_HEALTH_SLOW_CYCLES,
    AN_HEALTH_MAIN_CYCLES,
    AN_HEALTH_STACK_UNUSED, /* bytes; 0 in the first second */
    AN_HEALTH_KEPT,         /* an_keep_state */
    AN_HEALTH_WORDS
} an_health;

/* A table that is refused, with the reason. */
an_result an_protocol_refuse(an_message *reply, an_table_result reason);

#endif
