/* Any state at all, for the drivers of Frama-C's Eva: `python -m firmware.prove`. */
#ifndef AN_ANY_H
#define AN_ANY_H

#include "__fc_builtin.h"

#define AN_ANY(state) Frama_C_make_unknown((char *)&(state), sizeof(state))
#define AN_FROM(low, high) Frama_C_unsigned_int_interval((low), (high))
/* Any drive but those that are not finite: Eva keeps a NaN through a comparison, tests/firmware sends them through. */
#define AN_LEVEL() Frama_C_float_interval(-1e30f, 1e30f)

#endif
