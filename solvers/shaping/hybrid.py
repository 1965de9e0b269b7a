"""Passive and active confinement together: resonators hung on any structure, and patches driven beside them.

An oscillator (mass m, spring k = m omega_0^2) at a point adds 1/2 k (w - y)^2 to the structure's energy: modes of the joined
system from diag(omega^2) + sum k (phi, -1)(phi, -1)' against diag(1, m).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from geometry.elements import BoolArray, ComplexArray
from solvers.errors import SolverError
from solvers.shaping.acoustic_contrast import best_contrast, contrast
from solvers.shaping.modal_table import ModalTable, field_matrix


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
    return ModalTable(
        frequencies_hz=np.sqrt(np.maximum(values, 0.0)) / (2.0 * pi),
        quality_factor=composite_quality_factor,
        actuators=vectors[:modes].T @ table.actuators,
        sensors=vectors[:modes].T @ table.sensors,
        field=vectors[:modes].T @ table.field,
        points_m=table.points_m,
        sensor_residual=table.sensor_residual,
        field_residual=table.field_residual,
    )


@dataclass(frozen=True)
class Confined:
    """At one frequency, dB of rms inside over rms outside: one actuator alone, and all with the best voltages (a,), V."""

    frequency_hz: float
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
    return Confined(frequency_hz, alone.contrast_db, shaped.contrast_db, voltages)


@dataclass(frozen=True)
class PassiveActive:
    """The four combinations: `bare` alone and shaped (neither, patches), `passive` alone and shaped (resonators, both)."""

    bare: Confined
    passive: Confined

    def to_dict(self) -> dict[str, float]:
        """The four levels in dB."""
        return {
            "neither_db": self.bare.alone_db,
            "passive_db": self.passive.alone_db,
            "active_db": self.bare.shaped_db,
            "both_db": self.passive.shaped_db,
        }
