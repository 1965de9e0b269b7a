/* Numbers and layouts shared with the host; written by `python -m firmware.wire`: do not edit. */
#ifndef AN_WIRE_H
#define AN_WIRE_H

#include "an_types.h"

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
    AN_CHIRP = 19,
    AN_MEASURED = 20,
    AN_COLUMN = 21,
    AN_REPLY = 0x80,
    AN_LOG_RECORDS = 0xc0,
} an_kind;

typedef enum {
    AN_OK = 0,
    AN_UNKNOWN = 1,
    AN_BAD_VALUE = 2,
    AN_NOT_NOW = 3,
    AN_TABLE_REFUSED = 4,
    AN_STORE_FAILED = 5,
} an_result;

typedef enum {
    AN_TABLE_OK = 0,
    AN_TABLE_TRUNCATED = 1,
    AN_TABLE_MAGIC = 2,
    AN_TABLE_WRONG_VERSION = 3,
    AN_TABLE_LENGTH = 4,
    AN_TABLE_DAMAGED = 5,
    AN_TABLE_RANGE = 6,
    AN_TABLE_OTHER_BUILD = 7,
} an_table_result;

typedef enum {
    AN_KEEP_NONE = 0,
    AN_KEEP_EMPTY = 1,
    AN_KEEP_REFUSED = 2,
    AN_KEEP_READ = 3,
    AN_KEEP_WRITTEN = 4,
} an_keep_state;

typedef enum {
    AN_STATE_IDLE = 0,
    AN_STATE_IDENTIFY = 1,
    AN_STATE_RUN = 2,
    AN_STATE_FAULT = 3,
} an_state;

typedef enum {
    AN_FAULT_TABLE = 1 << 0, /* no valid mode table (not clearable) */
    AN_FAULT_CLOCK = 1 << 1, /* crystal, PLL or overdrive did not start; the chip runs from its own oscillator, 1 % accurate, to keep the serial line (not clearable) */
    AN_FAULT_NOT_FINITE = 1 << 2, /* a NaN or overflow was about to reach an output */
    AN_FAULT_SENSOR_CLIPPED = 1 << 3, /* more than two samples of a window (six channels: of two) at the ends of the converter */
    AN_FAULT_SENSOR_OFFSET = 1 << 4, /* rest level a quarter of full scale from the middle */
    AN_FAULT_AMPLITUDE = 1 << 5, /* more motion than the table allows */
    AN_FAULT_MISMATCH = 1 << 6, /* sensor dead, stuck or reversed; drive without motion, motion without drive, or a limit cycle */
    AN_FAULT_FAST_LATE = 1 << 7, /* a sample was lost, or the samples stopped */
    AN_FAULT_SLOW_LATE = 1 << 8, /* the slow step missed its deadline */
    AN_FAULT_IDENTIFY = 1 << 9, /* no resonance within 4 % of the computed frequency, or two too close together; six channels: decay so slow that the dwells take over a minute */
    AN_FAULT_HOST_SILENT = 1 << 10, /* the host that started it stopped talking */
    AN_FAULT_FLASH = 1 << 11, /* the table's sector could not be written */
    AN_FAULT_BREAK = 1 << 12, /* the power stage let its line go, or a wire is broken */
    AN_FAULT_WATCHDOG = 1 << 13, /* a task hung and the chip was reset */
    AN_FAULT_SHAPING = 1 << 14, /* the six-channel matrix cannot be inverted (condition above 100) */
    AN_FAULT_SUPPLY = 1 << 15, /* below 2.9 V */
    AN_FAULT_MEMORY = 1 << 16, /* a word of the program's state contradicts another */
} an_fault;

typedef enum {
    AN_STATUS_GAIN_IDENTIFIED = 1,
    AN_STATUS_TAU_IDENTIFIED = 2,
    AN_STATUS_FREQUENCY_IDENTIFIED = 4,
    AN_STATUS_LIMITED = 8,
    AN_STATUS_RETRIES = 16,
    AN_STATUS_EASED = 32,
    AN_STATUS_DISPLACEMENT = 64,
    AN_STATUS_GAVE_UP = 128,
} an_status_flag;

enum {
    AN_FAULT_COUNT = 17,
    AN_PROTOCOL = 7,
    AN_PAYLOAD_MAX = 120,
    AN_CHIRP_ROWS = 1024,
    AN_TABLE_VERSION = 2,
    AN_CHANNELS = 6,
    AN_PATTERNS = 8,
    AN_TABLE_MODES = 16,
    AN_TABLE_SHAPES = 2,
    AN_NAME_BYTES = 8,
    AN_TABLE_CRC_BYTES = 4,
    AN_TABLE_MAX_BYTES = 3680,
    AN_GAIN_IDENTIFIED = 1,
    AN_TAU_IDENTIFIED = 2,
    AN_FREQUENCY_IDENTIFIED = 4,
    AN_MATRIX_IDENTIFIED = 1,
    AN_SENSES_DISPLACEMENT = 1,
};

/* Drive the target mode; reference 0: the lowest useful level. */
typedef struct {
    float reference;
    float detuning_hz;
} an_start_request;
_Static_assert(sizeof(an_start_request) == 8u, "packed");

/* Hold a pattern of the current shape; reference 0: half of the reachable one. */
typedef struct {
    uint32_t pattern;
    float reference;
} an_six_start_request;
_Static_assert(sizeof(an_six_start_request) == 8u, "packed");

/* Change the amplitude while running. */
typedef struct {
    float reference;
} an_reference_request;
_Static_assert(sizeof(an_reference_request) == 4u, "packed");

/* Modulate the amplitude between 1 and 1 - depth of the reference; up to a tenth of the window rate. */
typedef struct {
    float rate_hz;
    float depth;
} an_sine_request;
_Static_assert(sizeof(an_sine_request) == 8u, "packed");

/* Start a texture from samples that follow, each lasting some windows. */
typedef struct {
    uint32_t every;
} an_stream_request;
_Static_assert(sizeof(an_stream_request) == 4u, "packed");

/* Start a log with one record per some windows; 0: stop it. */
typedef struct {
    uint32_t every;
} an_log_request;
_Static_assert(sizeof(an_log_request) == 4u, "packed");

/* Begin the upload of a mode table. */
typedef struct {
    uint32_t total_bytes;
} an_upload_begin_request;
_Static_assert(sizeof(an_upload_begin_request) == 4u, "packed");

/* Change to another pattern while running, or to another shape at rest. */
typedef struct {
    uint32_t shape;
    uint32_t pattern;
} an_choose_request;
_Static_assert(sizeof(an_choose_request) == 8u, "packed");

/* Record inputs and outputs of all channels, one row per some samples. */
typedef struct {
    uint32_t every;
} an_capture_request;
_Static_assert(sizeof(an_capture_request) == 4u, "packed");

/* Return recorded words from one onwards. */
typedef struct {
    uint32_t first;
} an_captured_request;
_Static_assert(sizeof(an_captured_request) == 4u, "packed");

/* Drive a periodic chirp about a carrier, and record its response in place of a capture. */
typedef struct {
    float frequency_hz;
    float level;
    uint32_t advance;
    uint32_t growth;
    uint32_t steps;
    uint32_t every;
    uint32_t settle;
} an_chirp_request;
_Static_assert(sizeof(an_chirp_request) == 28u, "packed");

/* Take over a measured mode, as the board's own identification does; the next start checks it. */
typedef struct {
    float frequency_hz;
    float tau_s;
    an_complex gain;
    float delay_s;
    float neighbour;
    float motion;
    float misfit;
} an_measured_request;
_Static_assert(sizeof(an_measured_request) == 32u, "packed");

/* Return the measured responses of all sensors to one actuator; not before they have been measured. */
typedef struct {
    uint32_t actuator;
} an_column_request;
_Static_assert(sizeof(an_column_request) == 4u, "packed");

/* Status common to both builds. */
typedef struct {
    uint8_t state_number;
    uint8_t choice[2];
    uint8_t flags;
    uint32_t fault_bits;
    uint32_t first_bits;
    uint32_t windows;
    uint32_t underruns;
    uint32_t worst_cycles;
    float frequency_hz;
    float metres;
} an_status;
_Static_assert(sizeof(an_status) == 32u, "packed");

/* Status of the single-mode build; while it runs, frequency, tau and gain are the tracked ones. */
typedef struct {
    an_status head;
    float detuning_hz;
    float tau_s;
    an_complex gain;
    float delay_s;
    float neighbour;
    float motion;
    float misfit;
    float reference;
    an_complex measured;
    an_complex drive;
    float offset;
} an_single_status;
_Static_assert(sizeof(an_single_status) == sizeof(an_status) + 56u, "packed");

/* Status of the six-channel build: condition number of T (0: unknown), largest reference, and sensors. */
typedef struct {
    an_status head;
    float condition;
    float reachable;
    float motion;
    float misfit;
    float reference;
    an_complex sensors[6];
} an_six_status;
_Static_assert(sizeof(an_six_status) == sizeof(an_status) + 68u, "packed");

/* Column of T: responses of all sensors to one actuator, and their squared coherence (0: not measured by this board). */
typedef struct {
    an_complex responses[6];
    float coherence[6];
    float seconds;
    float least_s;
    float integral;
    float passed;
} an_column;
_Static_assert(sizeof(an_column) == 88u, "packed");

/* Identity of a board: protocol version, build, table version, number of modes or shapes, and hash of the design. */
typedef struct {
    uint8_t protocol;
    uint8_t build_number;
    uint8_t table_version;
    uint8_t count;
    uint8_t design[16];
    float drive_limit;
    float amplitude_limit;
} an_identity;
_Static_assert(sizeof(an_identity) == 28u, "packed");

/* Health of the board. */
typedef struct {
    uint32_t watchdog_resets;
    uint32_t exception;
    uint32_t pc;
    uint32_t lr;
    uint32_t cfsr;
    uint32_t core_hz;
    uint32_t fast_cycles;
    uint32_t slow_cycles;
    uint32_t main_cycles;
    uint32_t stack_unused;
    uint32_t kept;
} an_health;
_Static_assert(sizeof(an_health) == 44u, "packed");

/* Record of the log: window number, measured phasor, drive, reference. */
typedef struct {
    uint32_t window;
    an_complex measured;
    an_complex drive;
    float reference;
} an_record;
_Static_assert(sizeof(an_record) == 24u, "packed");

/* Mode table: header. */
typedef struct {
    uint8_t magic[4];
    uint16_t version;
    uint16_t header_bytes;
    uint32_t total_bytes;
    uint16_t mode_count;
    uint16_t mode_bytes;
    uint16_t shape_count;
    uint16_t shape_bytes;
    uint8_t actuator_count;
    uint8_t sensor_count;
    uint16_t target;
    float sample_rate_hz;
    uint32_t flags;
    float sensor_volts;
    uint8_t design_hash[16];
} an_header_row;
_Static_assert(sizeof(an_header_row) == 52u, "packed");

/* Mode table: mode. */
typedef struct {
    float frequency_hz;
    float tau_s;
    an_complex gain;
    float delay_s;
    float drive_limit;
    float amplitude_limit;
    float metres_per_volt;
    uint32_t flags;
    an_complex actuator_weights[6];
    an_complex sensor_weights[6];
} an_mode_row;
_Static_assert(sizeof(an_mode_row) == 132u, "packed");

/* Mode table: shape. */
typedef struct {
    float frequency_hz;
    float tau_s;
    float drive_limit;
    float metres_per_volt;
    uint16_t flags;
    uint16_t pattern_count;
    uint8_t names[8][8];
    an_complex matrix[6][6];
    an_complex targets[8][6];
} an_shape_row;
_Static_assert(sizeof(an_shape_row) == 756u, "packed");

/* Lengths of the payloads of requests; the others have none, or one of any length. */
#define AN_REQUEST_BYTES \
    [AN_START] = sizeof(an_start_request), \
    [AN_REFERENCE] = sizeof(an_reference_request), \
    [AN_SINE] = sizeof(an_sine_request), \
    [AN_STREAM] = sizeof(an_stream_request), \
    [AN_LOG] = sizeof(an_log_request), \
    [AN_UPLOAD_BEGIN] = sizeof(an_upload_begin_request), \
    [AN_PATTERN] = sizeof(an_choose_request), \
    [AN_CAPTURE] = sizeof(an_capture_request), \
    [AN_CAPTURED] = sizeof(an_captured_request), \
    [AN_CHIRP] = sizeof(an_chirp_request), \
    [AN_MEASURED] = sizeof(an_measured_request), \
    [AN_COLUMN] = sizeof(an_column_request)

/* Allowed ranges of single numbers: offset, lowest, highest. */
#define AN_HEADER_BOUNDS \
    {offsetof(an_header_row, sample_rate_hz), 1000.0f, 1000000.0f}, \
    {offsetof(an_header_row, sensor_volts), 0.001f, 1000.0f}
#define AN_MODE_BOUNDS \
    {offsetof(an_mode_row, tau_s), 1e-06f, 10.0f}, \
    {offsetof(an_mode_row, delay_s), 0.0f, 0.001f}, \
    {offsetof(an_mode_row, drive_limit), 0.001f, 1.0f}, \
    {offsetof(an_mode_row, amplitude_limit), 0.001f, 1.0f}, \
    {offsetof(an_mode_row, metres_per_volt), 0.0f, 1.0f}
#define AN_SHAPE_BOUNDS \
    {offsetof(an_shape_row, tau_s), 1e-06f, 10.0f}, \
    {offsetof(an_shape_row, drive_limit), 0.001f, 1.0f}, \
    {offsetof(an_shape_row, metres_per_volt), 0.0f, 1.0f}

#define AN_FREQUENCY_LOW_HZ 20.0f
#define AN_FREQUENCY_HIGH 0.4f /* of the sample rate */
#define AN_GAIN_LOW 1e-06f /* larger of the parts */
#define AN_GAIN_HIGH 1000.0f
#define AN_TAU_LOW_S 1e-06f
#define AN_TAU_HIGH_S 10.0f
#define AN_DELAY_HIGH_S 0.001f
#define AN_WEIGHT_HIGH 1.0f
#define AN_MATRIX_HIGH 1000.0f
#define AN_DETUNING_MAX_HZ 500.0f

#endif
