"""Peaks of a response: the wanted mode's own, and the highest of the band, which may be another mode's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.optimize import minimize_scalar

from geometry.elements import FloatArray
from solvers.control.resonance import half_power_quality_factor
from solvers.measures.levels import ratio_db
from solvers.piezo.forced import Curve

PER_WIDTH = 6  # points over a resonance's half-power width about a peak
SHARP = 1e-3  # of a half-power width: how finely a peak is found
SAME_WIDTHS = 1.0  # half-power widths: nearer, two peaks are one


class Driven(Protocol):
    """What answers a sweep."""

    @property
    def loss(self) -> float:
        """1/Q."""
        ...

    def curve(self, frequency_hz: FloatArray) -> Curve:
        """Response at frequencies in Hz."""
        ...


@dataclass(frozen=True)
class Peak:
    """The response at one frequency: rms |u_z| of zone and passive face (m/V, or m/N), and the curve's quality factor there.

    confinement_db: 20 log10 of their ratio. None where there is no passive face, or the curve has no half-power points.
    """

    frequency_hz: float
    zone_rms: float
    passive_rms: float | None
    quality_factor: float | None

    @property
    def confinement_db(self) -> float | None:
        """20 log10 of zone over passive rms."""
        return None if self.passive_rms is None else float(ratio_db(self.zone_rms, self.passive_rms))

    def is_at(self, frequency_hz: float, loss: float) -> bool:
        """Whether it lies within a half-power width of a frequency."""
        return abs(self.frequency_hz - frequency_hz) <= SAME_WIDTHS * loss * frequency_hz


def highest_hz(driven: Driven, low: float, high: float, points: int, resonances_hz: FloatArray | None = None) -> float:
    """Where the zone's response is largest, Hz: on a grid and at the resonances, finer about its top, then between points.

    A resonance between two points of the grid may be narrower than they are apart: each one of the plate with its patches as
    they are wired has to be among `resonances_hz`, within the band.
    """
    even = np.union1d(np.linspace(low, high, points), [] if resonances_hz is None else resonances_hz)
    top = float(even[int(np.argmax(driven.curve(even).zone_rms_m_per_v))])
    for reach in (2.0 * (high - low) / points, 2.0 * top * driven.loss):
        top = _top_of(driven, max(low, top - reach), min(high, top + reach), top)
    return _between(driven, top, low, high)


def near_hz(driven: Driven, mode_hz: float) -> float:
    """The peak of a mode, Hz: where the response is largest within a half-power width; its own frequency where it has no peak.

    A stronger neighbour's flank rises to one end of that interval and is no peak.
    """
    reach = mode_hz * driven.loss
    top = _top_of(driven, mode_hz - reach, mode_hz + reach, mode_hz)
    inside = abs(top - mode_hz) < reach * (1.0 - 1.0 / (2.0 * PER_WIDTH))
    return _between(driven, top, mode_hz - reach, mode_hz + reach) if inside else mode_hz


def own_or(driven: Driven, mode_hz: float, highest_hz: float) -> float:
    """The peak of a mode, Hz, as near_hz; the highest one's own frequency where both are one, each as finely as it is found."""
    own = near_hz(driven, mode_hz)
    return highest_hz if abs(own - highest_hz) <= 2.0 * SHARP * highest_hz * driven.loss else own


def _top_of(driven: Driven, low: float, high: float, known_hz: float) -> float:
    fine = np.append(np.linspace(low, high, 4 * PER_WIDTH + 1), known_hz)
    return float(fine[int(np.argmax(driven.curve(fine).zone_rms_m_per_v))])


def _between(driven: Driven, top: float, low: float, high: float) -> float:
    """The largest response about a point of a fine grid."""
    step = top * driven.loss / PER_WIDTH
    ends = (max(low, top - step), min(high, top + step))
    minimum = minimize_scalar(
        lambda hz: -float(driven.curve(np.array([hz])).zone_rms_m_per_v[0]),
        bounds=ends,
        method="bounded",
        options={"xatol": SHARP * top * driven.loss},
    )
    return float(minimum.x) if low < top < high else top


def curve_about(driven: Driven, low: float, high: float, points: int, peaks_hz: list[float]) -> Curve:
    """The response on an even grid, as dense about each peak as its damping makes it narrow."""
    tones = np.linspace(low, high, points)
    for peak in peaks_hz:
        reach = 2.0 * peak * driven.loss
        fine = np.linspace(max(low, peak - reach), min(high, peak + reach), 4 * PER_WIDTH + 1)
        tones = np.union1d(tones, np.append(fine, peak))
    return driven.curve(tones)


def peak_of(curve: Curve, frequency_hz: float) -> Peak:
    """A peak as a curve has it that holds its frequency."""
    at = int(np.argmin(np.abs(curve.frequency_hz - frequency_hz)))
    passive = curve.passive_rms_m_per_v
    return Peak(
        float(curve.frequency_hz[at]),
        float(curve.zone_rms_m_per_v[at]),
        None if passive is None else float(passive[at]),
        half_power_quality_factor(curve.frequency_hz, curve.zone_rms_m_per_v, at) if _is_top(curve, at) else None,
    )


def _is_top(curve: Curve, at: int) -> bool:
    """Whether the curve falls to both sides: a flank has no half-power width."""
    around = curve.zone_rms_m_per_v[max(at - 1, 0) : at + 2]
    return 0 < at < len(curve.frequency_hz) - 1 and bool(around.max() == curve.zone_rms_m_per_v[at])
