"""Peak, frequency and quality factor of a measured sweep: circle fit about its highest point, half-power width beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.elements import FloatArray
from solvers.control.identification import Identified, Sensor, Sweep, identify
from solvers.errors import SolverError

FLOOR = (
    0.5  # of the peak: the circle is fitted to the points about it that reach so high, 240 degrees of a single mode's
)
MIN_COUNT = 8


@dataclass(frozen=True)
class Resonance:
    """A sweep's highest point and what is identified about it.

    frequency_hz, quality_factor: the circle's, or the highest point and the half-power width where there is no circle
    (`trouble` says why); low_hz, high_hz: what the circle was fitted to.
    """

    peak_hz: float
    frequency_hz: float
    quality_factor: float | None
    half_power_quality_factor: float | None
    circle: Identified | None
    low_hz: float
    high_hz: float
    trouble: str | None


def resonance(sweep: Sweep, sensor: Sensor) -> Resonance:
    """Identify the mode at a sweep's highest point. Source: ewins2000."""
    amplitude = np.abs(sweep.response)
    peak = int(np.argmax(amplitude))
    low, high = _about(amplitude, peak)
    part = Sweep(sweep.frequencies_hz[low:high], sweep.response[low:high])
    half = half_power_quality_factor(sweep.frequencies_hz, amplitude, peak)
    identified, trouble = None, None
    try:
        identified = identify(part, sensor)
        if not part.frequencies_hz[0] <= identified.plant.frequency_hz <= part.frequencies_hz[-1]:
            raise SolverError(
                f"the circle's frequency {identified.plant.frequency_hz:.1f} Hz lies outside what was fitted"
            )
    except SolverError as fault:
        identified, trouble = None, str(fault)
    peak_hz = float(sweep.frequencies_hz[peak])
    return Resonance(
        peak_hz,
        identified.plant.frequency_hz if identified else peak_hz,
        identified.plant.quality_factor if identified else half,
        half,
        identified,
        float(part.frequencies_hz[0]),
        float(part.frequencies_hz[-1]),
        trouble,
    )


def _about(amplitude: FloatArray, peak: int) -> tuple[int, int]:
    """The unbroken range about the peak above the floor, widened evenly to what a fit needs."""
    above = amplitude >= FLOOR * amplitude[peak]
    low = peak - int(np.argmin(above[peak::-1])) + 1 if not above[: peak + 1].all() else 0
    high = peak + int(np.argmin(above[peak:])) if not above[peak:].all() else len(amplitude)
    while high - low < min(MIN_COUNT, len(amplitude)):
        low, high = max(0, low - 1), min(len(amplitude), high + 1)
    return low, high


def half_power_quality_factor(frequency_hz: FloatArray, amplitude: FloatArray, peak: int) -> float | None:
    """f0 over the width at 1/sqrt(2) of the peak; None when a side does not fall that far."""
    ends = half_power_points(frequency_hz, amplitude, peak)
    return None if ends is None else float(frequency_hz[peak] / (ends[1] - ends[0]))


def half_power_points(frequency_hz: FloatArray, amplitude: FloatArray, peak: int) -> tuple[float, float] | None:
    """Interpolated crossings of 1/sqrt(2) of the peak below and above it; None when a side does not fall that far."""
    level = amplitude[peak] / np.sqrt(2.0)
    sides = []
    for step in (-1, 1):
        i = peak
        while 0 <= i + step < len(amplitude) and amplitude[i] > level:
            i += step
        if amplitude[i] > level:
            return None
        inner = i - step
        share = (amplitude[inner] - level) / (amplitude[inner] - amplitude[i])
        sides.append(float(frequency_hz[inner] + share * (frequency_hz[i] - frequency_hz[inner])))
    return sides[0], sides[1]
