"""The wanted mode: its shape and symmetry class, how well the plate confines it, how its motion falls off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometry.elements import FloatArray
from geometry.layout import Design
from solvers.analytic.beams import free_free_mode
from solvers.measures.wanted_mode import Verdict, verdict

CONFINED_DB = 10.0
NEGLIGIBLE = 1e-9  # of the active area: a passive face smaller than that is rounding


@dataclass(frozen=True)
class Confinement:
    """Measures per mode, each (k,); zone_share and confinement_db are NaN where the plate has no passive face.

    extension_db: 20 log10 of rms |u_z| on the active touch face over rms |u_z| beyond the last row; NaN without extension.
    strength: NaN where the field's modal mass is not known.
    """

    zone_share: FloatArray
    confinement_db: FloatArray
    mac: FloatArray
    extension_db: FloatArray
    strength: FloatArray


def wanted_shape(design: Design, points: FloatArray) -> FloatArray:
    """The analytic (0, N) shape at points (q, 2 or 3) in m: half a sine across the zone, a free-free beam along it."""
    across = np.sin(np.pi * (points[:, 1] + design.width_m / 2.0) / design.width_m)
    along = free_free_mode(design.nodal_lines).shape(points[:, 0] / design.length_m + 0.5)
    return np.asarray(across * along)


def wanted_symmetry(nodal_lines: int) -> str:
    """Signs (x, y) of u_z of the wanted mode: a free-free beam with N nodes is even for even N; half a sine is even."""
    return ("S" if nodal_lines % 2 == 0 else "A") + "S"


@dataclass(frozen=True)
class TouchField:
    """u_z at quadrature points of the touch face: points (q, 2) in m, weights (q,) in m2, values (q, k).

    modal_mass_kg: of each field, where it is a mode; NaN where that is not known, as of a measured map.
    """

    points: FloatArray
    weights: FloatArray
    values: FloatArray
    modal_mass_kg: float = np.nan


def measure(touch: TouchField, design: Design, symmetry: str | None) -> Confinement:
    """Confinement of modes from their normal displacement on the touch face.

    `symmetry` is the symmetry class of a halved model (a shape of another class has no share in it), None for a whole plate.
    """
    active = np.abs(touch.points[:, 1]) < design.width_m / 2.0
    squares = touch.weights[:, None] * touch.values**2
    inside, everywhere = squares[active].sum(axis=0), squares.sum(axis=0)
    area, passive_area = touch.weights[active].sum(), touch.weights[~active].sum()
    has_passive = passive_area > NEGLIGIBLE * area
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(has_passive, inside / everywhere, np.nan)
        passive = (everywhere - inside) / passive_area if has_passive else np.full_like(inside, np.nan)
        decibels = 10.0 * np.log10((inside / area) / passive)
    beyond = np.abs(touch.points[:, 1]) > design.half_span_m - design.extension_m
    squared, mac = _projection(touch, active, design, symmetry)
    strength = design.material.density_kg_m3 * design.thickness_m * squared / touch.modal_mass_kg
    return Confinement(share, decibels, mac, _ratio_db(touch, active, beyond), strength)


def _ratio_db(touch: TouchField, first: NDArray[np.bool_], second: NDArray[np.bool_]) -> FloatArray:
    """20 log10 of rms |u_z| on one part of the touch face over that on another; NaN where a part is empty."""
    areas = touch.weights[first].sum(), touch.weights[second].sum()
    if min(areas) <= NEGLIGIBLE * max(areas):
        return np.full(touch.values.shape[1], np.nan)
    means = [
        touch.weights[part] @ touch.values[part] ** 2 / area for part, area in zip((first, second), areas, strict=True)
    ]
    with np.errstate(divide="ignore"):
        return np.asarray(10.0 * np.log10(means[0] / means[1]))


def _projection(
    touch: TouchField, active: NDArray[np.bool_], design: Design, symmetry: str | None
) -> tuple[FloatArray, FloatArray]:
    """<u_z, shape>^2 / <shape, shape> and its share of <u_z, u_z>, the MAC, on the active touch face, (k,) each."""
    if symmetry not in (None, wanted_symmetry(design.nodal_lines)):
        return np.zeros(touch.values.shape[1]), np.zeros(touch.values.shape[1])
    values, weights = touch.values[active], touch.weights[active]
    shape = wanted_shape(design, touch.points[active])
    squared = np.asarray(((weights * shape) @ values) ** 2 / (weights @ shape**2))
    return squared, squared / np.maximum(weights @ values**2, 1e-300)


@dataclass(frozen=True)
class Profile:
    """u_z over y: places y_m (q,), weights (q,), values (q, k) real or complex, and the wanted motion there, shape (q,).

    modal_mass: of each mode, kg over the weights' unit (kg/m for weights in m, kg for weights in m2).
    """

    y_m: FloatArray
    weights: FloatArray
    values: NDArray[Any]
    shape: NDArray[Any]
    modal_mass: float


@dataclass(frozen=True)
class ProfileConfinement:
    """Measures per mode, (k,) each, as solvers.measures.confinement has them; NaN where the plate has no such part."""

    zone_share: FloatArray
    confinement_db: FloatArray
    extension_db: FloatArray
    mac: FloatArray
    strength: FloatArray

    @property
    def wanted(self) -> Verdict:
        """The wanted mode among them, by the rule of `solvers.measures.wanted_mode`."""
        return verdict(self.strength, self.zone_share, self.mac)


def profile_confinement(profile: Profile, design: Design) -> ProfileConfinement:
    """Share of the zone, 20 log10 of rms ratios, and modal assurance with the wanted motion inside the zone."""
    y, weights = np.abs(profile.y_m), profile.weights
    squares = weights[:, None] * np.abs(profile.values) ** 2
    active, beyond = y < design.width_m / 2.0, y > design.half_span_m - design.extension_m
    inside, everywhere = squares[active].sum(axis=0), squares.sum(axis=0)
    share = inside / everywhere if (~active).any() else np.full_like(inside, np.nan)
    shape, values = profile.shape[active], profile.values[active]
    own = weights[active] @ np.abs(shape) ** 2
    projection = np.abs((weights[active] * shape.conj()) @ values) ** 2
    return ProfileConfinement(
        share,
        _decibels(squares, weights, active, ~active),
        _decibels(squares, weights, active, beyond),
        projection / np.maximum(inside * own, 1e-300),
        design.material.density_kg_m3 * design.thickness_m * projection / own / profile.modal_mass,
    )


def _decibels(
    squares: FloatArray, weights: FloatArray, first: NDArray[np.bool_], second: NDArray[np.bool_]
) -> FloatArray:
    """10 log10 of the mean square on one part over that on another; NaN where a part is empty."""
    if not (first.any() and second.any()):
        return np.full(squares.shape[1], np.nan)
    means = [squares[part].sum(axis=0) / weights[part].sum() for part in (first, second)]
    with np.errstate(divide="ignore"):
        return np.asarray(10.0 * np.log10(means[0] / means[1]))
