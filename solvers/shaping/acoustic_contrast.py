"""Confining vibration to a part of a structure: targets at sensors, ratios of the field, and the best that is possible.

peak ratio = max |w| inside/max |w| outside; contrast = rms |w| inside/rms |w| outside. Over all voltages the contrast is
largest for the first eigenvector of G_in V = c^2 G_out V, G = F' F/points (acoustic contrast control, choi2002).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from geometry.elements import BoolArray, ComplexArray, FloatArray
from solvers.errors import SolverError
from solvers.measures.levels import ratio_db

Region = Literal["left", "middle", "right"]
REGIONS: tuple[Region, ...] = ("left", "middle", "right")


@dataclass(frozen=True)
class Contrast:
    """How well a field is confined inside: ratios of amplitudes, inside over outside."""

    peak_ratio: float
    contrast: float

    @property
    def contrast_db(self) -> float:
        """20 log10 of the contrast."""
        return float(ratio_db(self.contrast, 1.0))


def region_sensors(region: str, count: int) -> NDArray[np.intp]:
    """Numbers of the sensors in a third of them along the line; SolverError for an unknown region or below 3 sensors."""
    if region not in REGIONS:
        raise SolverError(f"region {region!r}: must be one of {', '.join(REGIONS)}")
    if count < len(REGIONS):
        raise SolverError(f"{count} sensors: three regions need 3 or more")
    return np.array_split(np.arange(count), len(REGIONS))[[*REGIONS].index(region)]


def region_points(region: str, places_m: FloatArray, points_m: FloatArray) -> BoolArray:
    """Points not farther from a sensor of the region than from any other one, shape (p,); errors as region_sensors."""
    places, x = np.asarray(places_m, dtype=float), np.asarray(points_m).reshape(len(points_m), -1)[:, 0]
    chosen, away = region_sensors(region, len(places)), np.abs(x[:, None] - places)
    rounding = 1e-9 * float(np.ptp(x))
    return np.asarray(away[:, chosen].min(axis=1) <= away.min(axis=1) + rounding)


def region_target(region: str, count: int, alternate: bool = False) -> ComplexArray:
    """Signals 1 (or +1, -1, ... when alternate) inside, 0 outside, shape (s,); errors as region_sensors."""
    target, inside = np.zeros(count, dtype=complex), region_sensors(region, count)
    target[inside] = (-1.0) ** np.arange(len(inside)) if alternate else 1.0
    return target


def contrast(displacement: ComplexArray, inside: BoolArray) -> Contrast:
    """Ratios of a field (p,) over points that stand for equal lengths.

    SolverError when a side has no point or nothing moves outside and inside.
    """
    _check_sides(inside)
    size = np.abs(displacement)
    if not size.any():
        raise SolverError("the field is zero everywhere: nothing can be said about its confinement")
    power = [float(np.mean(size[side] ** 2)) for side in (inside, ~inside)]
    with np.errstate(divide="ignore"):
        peak = np.float64(size[inside].max()) / size[~inside].max()
        return Contrast(float(peak), float(np.sqrt(np.float64(power[0]) / power[1])))


def best_contrast(field: ComplexArray, inside: BoolArray, alpha: float = 0.0) -> ComplexArray:
    """Voltages (a,) of the largest contrast for a field (p, a) per volt, largest voltage 1 V.

    alpha^2 mean(diag G_out) |V|^2 is added to the outside, so that large voltages for little motion are left alone.
    SolverError when a side has no point, or the outside cannot resist (fewer points than actuators) without alpha.
    """
    _check_sides(inside)
    gram_in, gram_out = (field[side].conj().T @ field[side] / len(field[side]) for side in (inside, ~inside))
    size = field.shape[1]
    gram_out = gram_out + alpha**2 * float(np.trace(gram_out).real) / size * np.eye(size)
    spread = np.linalg.eigvalsh(gram_out)
    if spread[0] <= 1e-14 * spread[-1]:
        raise SolverError(
            "some voltages move nothing outside, to rounding: their contrast has no bound; take alpha > 0"
        )
    vectors = eigh(gram_in, gram_out)[1]
    best = vectors[:, -1]
    return np.asarray(best / np.abs(best).max())


def _check_sides(inside: BoolArray) -> None:
    if inside.all() or not inside.any():
        raise SolverError("confinement compares two sides: some points must lie inside and some outside")
