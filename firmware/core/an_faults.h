/* Faults: each is one bit, latched until cleared, and each puts the outputs into their safe state. */
#ifndef AN_FAULTS_H
#define AN_FAULTS_H

typedef enum {
    AN_FAULT_TABLE = 1 << 0,          /* no mode table, or one that was refused */
    AN_FAULT_CLOCK = 1 << 1,          /* crystal, PLL or overdrive did not start */
    AN_FAULT_NOT_FINITE = 1 << 2,     /* a NaN or an overflow reached an output or a measurement */
    AN_FAULT_SENSOR_CLIPPED = 1 << 3, /* too many samples at the converter's ends */
    AN_FAULT_SENSOR_OFFSET = 1 << 4,  /* the sensor's rest level left the middle of the range */
    AN_FAULT_AMPLITUDE = 1 << 5,      /* the plate moves more than the table allows */
    AN_FAULT_MISMATCH = 1 << 6,       /* the sensor does not follow the model: lost, reversed, or another plate */
    AN_FAULT_FAST_LATE = 1 << 7,      /* a sample was lost before it was read */
    AN_FAULT_SLOW_LATE = 1 << 8,      /* the slow step did not end in its gap */
    AN_FAULT_IDENTIFY = 1 << 9,       /* the sweep found no resonance it could vouch for */
    AN_FAULT_HOST_SILENT = 1 << 10,   /* the host that started the drive stopped talking */
    AN_FAULT_FLASH = 1 << 11,         /* the table's sector could not be erased or written */
    AN_FAULT_BREAK = 1 << 12,         /* the power stage pulled its break line */
    AN_FAULT_WATCHDOG = 1 << 13,      /* the watchdog had to reset the chip */
    AN_FAULT_SHAPING = 1 << 14,       /* the matrix of shaping cannot be inverted with any confidence */
    AN_FAULT_SUPPLY = 1 << 15,        /* the supply fell below 2.9 V */
    AN_FAULT_MEMORY = 1 << 16,        /* a word of the program's state contradicts another */
    AN_FAULT_COUNT = 17
} an_fault;

#endif
