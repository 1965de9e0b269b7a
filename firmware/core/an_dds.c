#include "an_dds.h"

uint32_t an_dds_step(float frequency_hz, float sample_rate_hz)
{
    const float turns = frequency_hz / sample_rate_hz;
    if (!(turns > 0.0f && turns < 0.5f)) {
        return 0u;
    }
    return (uint32_t)(turns * AN_PHASE_TURN + 0.5f);
}

float an_dds_frequency(uint32_t step, float sample_rate_hz)
{
    return (float)step * (sample_rate_hz / AN_PHASE_TURN);
}

float an_dds_detuning(uint32_t step, uint32_t reference, float sample_rate_hz)
{
    return (float)(int32_t)(step - reference) * (sample_rate_hz / AN_PHASE_TURN);
}

uint32_t an_dds_shifted(uint32_t step, float offset_hz, float sample_rate_hz)
{
    const float turns = offset_hz / sample_rate_hz;
    if (!(turns > -0.5f && turns < 0.5f)) {
        return step;
    }
    return step + (uint32_t)(int32_t)(turns * AN_PHASE_TURN);
}
