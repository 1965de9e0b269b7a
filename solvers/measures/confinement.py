"""The wanted mode: its shape and symmetry class, how well the plate confines it, how its motion falls off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometry.elements import BoolArray, FloatArray
from geometry.layout import Design
from solvers.analytic.beams import free_free_mode
from solvers.measures.levels import ratio_db
from solvers.measures.wanted_mode import Verdict, verdict

NEGLIGIBLE = 1e-9  # of the larger part's area: a smaller part is rounding


@dataclass(frozen=True)
class Confinement:
    """Measures per mode, (k,) each; NaN where the plate has no such part.

    zone_share: of |u_z|^2 over the touch face, on its active part. confinement_db, extension_db: 20 log10 of rms |u_z| on the
    active touch face over that on the passive one, and over that beyond the last row. mac: with the wanted shape on the active
    face. strength: rho h <u_z, shape>^2 / (<shape, shape> modal mass), NaN where the modal mass is not known.
    """

    zone_share: FloatArray
    confinement_db: FloatArray
    mac: FloatArray
    extension_db: FloatArray
    strength: FloatArray

    @property
    def wanted(self) -> Verdict:
        """The wanted mode among them, by the rule of `solvers.measures.wanted_mode`."""
        return verdict(self.strength, self.zone_share, self.mac)


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

    def is_active(self, design: Design) -> BoolArray:
        """Which points lie on the active face, (q,)."""
        return np.asarray(np.abs(self.points[:, 1]) < design.width_m / 2.0)

    def is_beyond_rows(self, design: Design) -> BoolArray:
        """Which points lie beyond the last row, (q,)."""
        return is_beyond_rows(self.points[:, 1], design)


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


def measure(touch: TouchField, design: Design, symmetry: str | None) -> Confinement:
    """Confinement of modes from their normal displacement on the touch face.

    `symmetry` is the symmetry class of a halved model (a shape of another class has no share in it), None for a whole plate.
    """
    shape = shape_at(touch, design, symmetry)
    profile = Profile(np.abs(touch.points[:, 1]), touch.weights, touch.values, shape, touch.modal_mass_kg)
    return measure_profile(profile, design)


def strength_force(touch: TouchField, design: Design, symmetry: str | None) -> FloatArray:
    """Forces (q,) at the points whose work on a mode, squared, is its strength."""
    shape = shape_at(touch, design, symmetry)
    heavy = touch.weights * shape
    own = float(heavy @ shape)
    surface = design.material.density_kg_m3 * design.thickness_m
    return np.asarray(heavy * np.sqrt(surface / (own * touch.modal_mass_kg))) if own > 0.0 else np.zeros(len(heavy))


def shape_at(touch: TouchField, design: Design, symmetry: str | None) -> FloatArray:
    """Return the wanted shape at the points, (q,), 0 on the passive face and in a class that lacks it."""
    shape = np.zeros(len(touch.points))
    if symmetry in (None, wanted_symmetry(design.nodal_lines)):
        active = touch.is_active(design)
        shape[active] = wanted_shape(design, touch.points[active])
    return shape


def is_beyond_rows(y_m: FloatArray, design: Design) -> BoolArray:
    """Which places lie on the plate beyond the last row."""
    return np.asarray(np.abs(y_m) > design.half_span_m - design.extension_m)


def measure_profile(profile: Profile, design: Design) -> Confinement:
    """The same of a motion known over y and the wanted one there, which may be zero: nothing is alike then."""
    y, weights = np.abs(profile.y_m), profile.weights
    squares = np.abs(profile.values) ** 2
    active, beyond = y < design.width_m / 2.0, is_beyond_rows(y, design)
    inside, everywhere = weights[active] @ squares[active], weights @ squares
    shape, values = profile.shape[active], profile.values[active]
    own = weights[active] @ np.abs(shape) ** 2
    projection = np.abs((weights[active] * shape.conj()) @ values) ** 2 / np.maximum(own, 1e-300)
    levels = [_level_db(weights, squares, active, part) for part in (~active, beyond)]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(np.isnan(levels[0]), np.nan, inside / everywhere)
    strength = design.material.density_kg_m3 * design.thickness_m * projection / profile.modal_mass
    return Confinement(share, levels[0], projection / np.maximum(inside, 1e-300), levels[1], strength)


def _level_db(
    weights: FloatArray, squares: FloatArray, first: NDArray[np.bool_], second: NDArray[np.bool_]
) -> FloatArray:
    """20 log10 of rms on one part over that on another, (k,); NaN where a part is empty."""
    areas = weights[first].sum(), weights[second].sum()
    if min(areas) <= NEGLIGIBLE * max(areas):
        return np.full(squares.shape[1], np.nan)
    rms = [np.sqrt(weights[part] @ squares[part] / area) for part, area in zip((first, second), areas, strict=True)]
    return ratio_db(*rms)
