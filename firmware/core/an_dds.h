/* Direct digital synthesis: a 32-bit phase accumulator with 2^32 counts per turn. */
#ifndef AN_DDS_H
#define AN_DDS_H

#include "an_types.h"

#define AN_PHASE_TURN 4294967296.0f

/* Phase step per sample of a frequency; 0 unless it lies between 0 and half the sample rate. */
uint32_t an_dds_step(float frequency_hz, float sample_rate_hz);

/* Frequency of a phase step in Hz. */
float an_dds_frequency(uint32_t step, float sample_rate_hz);

/* Difference of two phase steps in Hz, subtracted as integers and therefore exact. */
float an_dds_detuning(uint32_t step, uint32_t reference, float sample_rate_hz);

/* Phase step shifted by an offset in Hz. */
uint32_t an_dds_shifted(uint32_t step, float offset_hz, float sample_rate_hz);

#endif
