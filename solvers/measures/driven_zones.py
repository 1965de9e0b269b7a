"""Zones of a plate, each driven at its own peak: what the others and the passive face do meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geometry.elements import BoolArray, FloatArray
from geometry.layout import Design
from solvers.errors import SolverError
from solvers.measures.confinement import Profile
from solvers.measures.levels import ratio_db

BESIDE = (0.75, 1.3)  # of a window's ends: modes within move driven zones
FINE = 6  # points over a half-power width


@dataclass(frozen=True)
class DrivenZones:
    """Of every zone, driven: its peak in Hz, the rms of every zone and of the passive face over its own in dB, (zones,
    zones + 1), and its motion's MAC with the wanted shape, (zones,).
    """

    peak_hz: FloatArray
    level_db: FloatArray
    mac: FloatArray

    @property
    def isolation_db(self) -> float:
        """Least level of a driven zone over another one, dB."""
        return float(np.min(-self.level_db[:, :-1][~np.eye(len(self.mac), dtype=bool)]))

    @property
    def confinement_db(self) -> float:
        """Least level of a driven zone over the passive face, dB."""
        return float(np.min(-self.level_db[:, -1]))


def zone_parts(design: Design, y: FloatArray) -> list[BoolArray]:
    """Which places lie in each zone, and which in none."""
    inside = [np.abs(y - middle) < design.width_m / 2.0 for middle in design.zone_centres_m]
    return [*inside, ~np.logical_or.reduce(inside)]


def peak_hz(
    moved: Callable[[FloatArray], FloatArray], resonances_hz: FloatArray, band_hz: tuple[float, float], loss: float
) -> float:
    """Where something moves most within a band, Hz: at the resonances and the band's ends, then finer about the largest."""
    low, high = band_hz
    tones = np.concatenate([resonances_hz[(resonances_hz >= low) & (resonances_hz <= high)], [low, high]])
    for _ in range(2):
        top = float(tones[int(np.argmax(moved(tones)))])
        tones = np.clip(np.linspace(top * (1.0 - loss), top * (1.0 + loss), 4 * FINE + 1), low, high)
    return float(tones[int(np.argmax(moved(tones)))])


def drive_zones(
    design: Design, frequency_hz: FloatArray, profile: Profile, band_hz: tuple[float, float], quality_factor: float
) -> DrivenZones:
    """Zones driven in turn by a pressure of the wanted shape, by M-orthonormal modes (k,) over the whole width of the plate:
    a_k = phi_k' f / (f_k^2 (1 + i/Q) - f^2), each at its peak within the band. SolverError without modes.
    """
    if not len(frequency_hz):
        raise SolverError("no mode of the plate lies about the frequency of one of its zones alone")
    parts = [np.where(part, profile.weights, 0.0) for part in zone_parts(design, profile.y_m)]
    adjoint = profile.values.conj().T
    grams = np.array([adjoint @ (part[:, None] * profile.values) / part.sum() for part in parts])
    forces = [adjoint @ (part * profile.shape) for part in parts[:-1]]

    def shares(zone: int, tones: FloatArray) -> FloatArray:
        return np.asarray(forces[zone][:, None] / (frequency_hz[:, None] ** 2 * (1.0 + 1j / quality_factor) - tones**2))

    def squares(zone: int, tones: FloatArray) -> FloatArray:
        moved = shares(zone, tones)
        return np.einsum("it,zit->zt", moved.conj(), grams @ moved).real

    peaks, levels, macs = [], [], []
    for zone, (part, force) in enumerate(zip(parts, forces, strict=False)):
        top = peak_hz(lambda tones, zone=zone: squares(zone, tones)[zone], frequency_hz, band_hz, 1.0 / quality_factor)  # type: ignore[misc]
        (at,) = squares(zone, np.array([top])).T
        own = part @ np.abs(profile.shape) ** 2 * part.sum() * at[zone]
        peaks.append(top)
        levels.append(ratio_db(np.sqrt(at), np.sqrt(at[zone])))
        macs.append(float(abs(force.conj() @ shares(zone, np.array([top]))[:, 0]) ** 2 / own))
    return DrivenZones(np.array(peaks), np.array(levels), np.array(macs))
