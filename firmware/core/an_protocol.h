/* Numbers shared with the host: request kinds, results, and the order of the health words. */
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
    AN_UNKNOWN,       /* request not supported by this image */
    AN_BAD_VALUE,     /* wrong length or value out of range */
    AN_NOT_NOW,       /* not allowed in this state */
    AN_TABLE_REFUSED, /* followed by the reason, AN_TABLE_... */
    AN_STORE_FAILED
} an_result;

/* Flags in the fourth byte of a status: the drive is at its limit and the plate does not reach the reference; a fault
 * that will be cleared for another try; the drive is limited to half after a long time at its limit. */
enum { AN_STATUS_LIMITED = 8, AN_STATUS_RETRIES = 16, AN_STATUS_EASED = 32 };

enum { AN_PROTOCOL = 4, AN_LOG_FLOATS = 5, AN_LOG_PER_FRAME = 4 };

/* Reply to AN_HEALTH: 32-bit words in this order. Exception, pc, lr and cfsr describe the last unexpected exception;
 * they are zero if there has been none since power-on. */
typedef enum {
    AN_HEALTH_RESETS, /* consecutive watchdog resets */
    AN_HEALTH_EXCEPTION,
    AN_HEALTH_PC,
    AN_HEALTH_LR,
    AN_HEALTH_CFSR,
    AN_HEALTH_CORE_HZ,
    AN_HEALTH_FAST_CYCLES, /* longest so far: fast interrupt, slow interrupt, main-loop pass */
    AN_HEALTH_SLOW_CYCLES,
    AN_HEALTH_MAIN_CYCLES,
    AN_HEALTH_STACK_UNUSED, /* bytes; 0 during the first second */
    AN_HEALTH_KEPT,         /* an_keep_state */
    AN_HEALTH_WORDS
} an_health;

/* Write the reason for rejecting a table to the reply and return AN_TABLE_REFUSED. */
an_result an_protocol_refuse(an_message *reply, an_table_result reason);

#endif
