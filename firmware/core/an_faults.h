/* Faults, one bit each. Every fault is latched until cleared and sets the outputs to their safe state. */
#ifndef AN_FAULTS_H
#define AN_FAULTS_H

typedef enum {
    AN_FAULT_TABLE = 1 << 0,          /* no mode table, or an invalid one */
    AN_FAULT_CLOCK = 1 << 1,          /* crystal, PLL or overdrive did not start */
    AN_FAULT_NOT_FINITE = 1 << 2,     /* a NaN or an overflow reached an output or a measurement */
    AN_FAULT_SENSOR_CLIPPED = 1 << 3, /* too many samples at the ends of the converter's range */
    AN_FAULT_SENSOR_OFFSET = 1 << 4,  /* the sensor's offset is too far from mid-scale */
    AN_FAULT_AMPLITUDE = 1 << 5,      /* the vibration amplitude exceeds the table's limit */
    AN_FAULT_MISMATCH = 1 << 6,       /* sensor contradicts the model: lost, reversed, or another plate */
    AN_FAULT_FAST_LATE = 1 << 7,      /* a sample was overwritten before it was read */
    AN_FAULT_SLOW_LATE = 1 << 8,      /* the slow step did not finish within its gap */
    AN_FAULT_IDENTIFY = 1 << 9,       /* the sweep found no reliable resonance */
    AN_FAULT_HOST_SILENT = 1 << 10,   /* the host that started the drive has fallen silent */
    AN_FAULT_FLASH = 1 << 11,         /* the table's flash sector could not be erased or written */
    AN_FAULT_BREAK = 1 << 12,         /* the power stage asserted its break line */
    AN_FAULT_WATCHDOG = 1 << 13,      /* the watchdog reset the chip */
    AN_FAULT_SHAPING = 1 << 14,       /* the transfer matrix T is too ill-conditioned to invert */
    AN_FAULT_SUPPLY = 1 << 15,        /* the supply fell below 2.9 V */
    AN_FAULT_MEMORY = 1 << 16,        /* the program's state is inconsistent */
    AN_FAULT_COUNT = 17
} an_fault;

#endif
