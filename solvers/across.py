"""How well a motion is held across the plate, from its profile over y alone: the measures of solvers.confinement on a line.

The motion is Y(y) exp(i k x), alike everywhere along the zone, so that means over the touch face are means over y.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geometry.elements import FloatArray
from geometry.layout import Design
from solvers.wanted import Verdict, verdict


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
class Held:
    """Measures per mode, (k,) each, as solvers.confinement has them; NaN where the plate has no such part."""

    zone_share: FloatArray
    confinement_db: FloatArray
    extension_db: FloatArray
    mac: FloatArray
    strength: FloatArray

    @property
    def wanted(self) -> Verdict:
        """The wanted mode among them, by the rule of `solvers.wanted`."""
        return verdict(self.strength, self.zone_share, self.mac)


def held(profile: Profile, design: Design) -> Held:
    """Share of the zone, 20 log10 of rms ratios, and modal assurance with the wanted motion inside the zone."""
    y, weights = np.abs(profile.y_m), profile.weights
    squares = weights[:, None] * np.abs(profile.values) ** 2
    active, beyond = y < design.width_m / 2.0, y > design.half_span_m - design.extension_m
    inside, everywhere = squares[active].sum(axis=0), squares.sum(axis=0)
    share = inside / everywhere if (~active).any() else np.full_like(inside, np.nan)
    shape, values = profile.shape[active], profile.values[active]
    own = weights[active] @ np.abs(shape) ** 2
    projection = np.abs((weights[active] * shape.conj()) @ values) ** 2
    return Held(
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
