/* Direct digital synthesis: a 32-bit phase accumulator, 2^32 a turn. */
#ifndef AN_DDS_H
#define AN_DDS_H

#include "an_types.h"

#define AN_PHASE_TURN 4294967296.0f

/* Phase step per sample of a frequency, 0 when it is not between 0 and half the sample rate. */
uint32_t an_dds_step(float frequency_hz, float sample_rate_hz);

/* Frequency of a phase step, Hz. */
float an_dds_frequency(uint32_t step, float sample_rate_hz);

/* Exact difference of two steps as a frequency, Hz: no digits are lost to the carrier. */
float an_dds_detuning(uint32_t step, uint32_t reference, float sample_rate_hz);

/* The step that lies a few hertz from another. */
uint32_t an_dds_shifted(uint32_t step, float offset_hz, float sample_rate_hz);

#endif
