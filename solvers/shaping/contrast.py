"""Vibration confined to a region: the largest contrast that voltages reach, alone and with resonators beside them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from geometry.elements import BoolArray, ComplexArray, FloatArray
from solvers.errors import SolverError
from solvers.measures.confinement import ratio_db
from solvers.shaping.modal_table import ModalTable, field_matrix

# -- regions and contrast ----------------------------------------------------------------------------------------------
# Confining vibration to a part of a structure: targets at sensors, ratios of the field, and the best that is possible.
# peak ratio = max |w| inside/max |w| outside; contrast = rms |w| inside/rms |w| outside. Over all voltages the
# contrast is largest for the first eigenvector of G_in V = c^2 G_out V, G = F' F/points (acoustic contrast control,
# choi2002).

REGIONS = ("left", "middle", "right")


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


def best_contrast(field: ComplexArray, inside: BoolArray) -> ComplexArray:
    """Voltages (a,) of the largest contrast for a field (p, a) per volt, largest voltage 1 V.

    SolverError when a side has no point, or the outside cannot resist (fewer points than actuators).
    """
    _check_sides(inside)
    gram_in, gram_out = (field[side].conj().T @ field[side] / len(field[side]) for side in (inside, ~inside))
    spread = np.linalg.eigvalsh(gram_out)
    if spread[0] <= 1e-14 * spread[-1]:
        raise SolverError("some voltages move nothing outside, to rounding: their contrast has no bound")
    best = eigh(gram_in, gram_out)[1][:, -1]
    return np.asarray(best / np.abs(best).max())


def _check_sides(inside: BoolArray) -> None:
    if inside.all() or not inside.any():
        raise SolverError("confinement compares two sides: some points must lie inside and some outside")


# -- resonators --------------------------------------------------------------------------------------------------------
# Passive and active confinement together: resonators hung on any structure, and patches driven beside them.
# An oscillator (mass m, spring k = m omega_0^2) at a point adds 1/2 k (w - y)^2 to the structure's energy: modes of
# the joined system from diag(omega^2) + sum k (phi, -1)(phi, -1)' against diag(1, m).


def attach_oscillators(
    table: ModalTable, points: NDArray[np.intp], mass_kg: float, frequency_hz: float, quality_factor: float
) -> ModalTable:
    """The structure with equal mass-spring oscillators at some of its points; modes of both, residuals as they were.

    The loss of a joined mode is its share of strain energy over each part's quality factor. SolverError for no point, a point
    that is not in the table, or a mass, frequency or quality factor that is not above 0.
    """
    chosen = np.asarray(points, dtype=int)
    if not chosen.size or chosen.min() < 0 or chosen.max() >= len(table.points_m):
        raise SolverError(f"oscillators: points must be from 0 to {len(table.points_m) - 1}, at least one")
    for name, value in (("mass", mass_kg), ("frequency", frequency_hz), ("quality_factor", quality_factor)):
        if not value > 0.0:
            raise SolverError(f"oscillators: {name} = {value:g}: must be above 0")
    modes, hung = table.frequencies_hz.size, len(chosen)
    spring = mass_kg * (2.0 * pi * frequency_hz) ** 2
    stretch = np.hstack([table.field[:, chosen].T, -np.eye(hung)])
    own, springs = np.zeros((modes + hung,) * 2), spring * stretch.T @ stretch
    own[:modes, :modes] = np.diag(table.angular**2)
    values, vectors = eigh(own + springs, np.diag(np.concatenate([np.ones(modes), np.full(hung, mass_kg)])))
    energy = vectors[:modes] ** 2 * (table.angular**2)[:, None]
    lost = (energy / table.quality_factor[:, None]).sum(axis=0) + np.einsum(
        "im,ij,jm->m", vectors, springs, vectors
    ) / quality_factor
    with np.errstate(divide="ignore", invalid="ignore"):
        composite_quality_factor = np.where(lost > 0.0, values / lost, np.inf)
    return replace(
        table,
        frequencies_hz=np.sqrt(np.maximum(values, 0.0)) / (2.0 * pi),
        quality_factor=composite_quality_factor,
        **{name: vectors[:modes].T @ getattr(table, name) for name in ("actuators", "sensors", "field")},
    )


@dataclass(frozen=True)
class Confined:
    """At one frequency, dB of rms inside over rms outside: one actuator alone, and all with the best voltages (a,), V."""

    alone_db: float
    shaped_db: float
    voltages: ComplexArray


def confinement(table: ModalTable, frequency_hz: float, inside: BoolArray, driver: int) -> Confined:
    """Confinement to the points inside (p,) by one actuator and by all; errors as best_contrast and receptance.

    SolverError for a driver that is not in the table.
    """
    if not 0 <= driver < table.actuator_count:
        raise SolverError(f"driver {driver}: must be from 0 to {table.actuator_count - 1}")
    field = field_matrix(table, frequency_hz)
    voltages = best_contrast(field, inside)
    alone, shaped = contrast(field[:, driver], inside), contrast(field @ voltages, inside)
    return Confined(alone.contrast_db, shaped.contrast_db, voltages)
