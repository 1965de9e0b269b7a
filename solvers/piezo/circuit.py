"""Modes of a patched plate whose patches are open instead of short: (K + sum theta theta'/C) u = omega^2 M u.

An open patch carries no charge, theta' u + C V = 0, and its voltage stiffens the plate (hagood1991). Solved in the space
of the short modes about the band and the plate's answers to each patch, which holds what one voltage a patch can add.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from geometry.elements import ComplexArray, FloatArray
from solvers.piezo.forced import ForcedPlate

SAME = 1e-10  # of the largest: directions of the space that are combinations of the others


@dataclass(frozen=True)
class CircuitShift:
    """The wanted mode with every patch short and with some open: Hz, and the share of it in that open mode.

    coupling = (f_open^2 - f_short^2)/f_open^2, the effective coupling factor squared (ieee176).
    """

    short_hz: float
    open_hz: float
    share: float

    @property
    def coupling(self) -> float:
        """Effective electromechanical coupling factor squared."""
        return 1.0 - (self.short_hz / self.open_hz) ** 2


def open_modes(forced: ForcedPlate, opened: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Frequencies in Hz, ascending, with these patches open and the others short, and unit coordinates (modes, columns).

    Columns are those of the groups' modes and residuals, one group after another. Only what lies within the band
    means something.
    """
    stiffness, mass, loads = _projected(forced)
    plate = forced.plate
    charge = loads[:, list(opened)]
    capacitance = plate.capacitance_f[list(opened)] / plate.stiffness_unit
    stiffness = stiffness + (charge / capacitance) @ charge.T
    size = 1.0 / np.sqrt(np.maximum(np.diag(mass), 1e-300))
    values, basis = scipy.linalg.eigh(mass * np.outer(size, size))
    kept = values > SAME * values[-1]
    whiten = size[:, None] * basis[:, kept] / np.sqrt(values[kept])
    eigenvalue, vectors = scipy.linalg.eigh(whiten.T @ stiffness @ whiten)
    return plate.scale.frequency(eigenvalue), np.asarray((mass @ whiten @ vectors).T)


def circuit_shift(forced: ForcedPlate, opened: Sequence[int] | None = None) -> CircuitShift | None:
    """What opening patches (default: all) does to the wanted mode; None when the band holds no wanted mode."""
    place = forced.wanted_column()
    short = forced.wanted_hz()
    if place is None or short is None:
        return None
    frequency, shares = open_modes(forced, range(len(forced.plate.patches)) if opened is None else opened)
    best = int(np.argmax(np.abs(shares[:, place])))
    return CircuitShift(short, float(frequency[best]), float(shares[best, place] ** 2))


def open_patches(forced: ForcedPlate) -> list[int]:
    """Patches that no voltage holds: those that listen, and where a charge drives those that drive."""
    return forced.sensors if forced.circuit == "short" else [*forced.drivers, *forced.sensors]


def driven_hz(forced: ForcedPlate) -> float | None:
    """Return the wanted mode's frequency with the patches' circuits as wired: sensors open, drivers as they are fed."""
    shift = circuit_shift(forced, opened) if (opened := open_patches(forced)) else None
    return shift.open_hz if shift else forced.wanted_hz()


def resonances_hz(forced: ForcedPlate) -> FloatArray:
    """Frequencies within the band at which the plate resonates with its patches as they are wired, ascending."""
    low, high = forced.band_hz
    frequency = open_modes(forced, opened)[0] if (opened := open_patches(forced)) else np.sort(forced.resonances_hz)
    return frequency[(frequency > low) & (frequency < high)]


def _projected(forced: ForcedPlate) -> tuple[FloatArray, FloatArray, FloatArray]:
    """K, M (c, c) and the loads (c, patches) in the columns of all groups, scaled; the modes' own loads are extrapolated."""
    stiffness, mass = zip(*(basis.projected for basis in forced.modes), strict=True)
    loads = [
        np.vstack([basis.gain, basis.columns[:, len(basis.eigenvalue) :].T @ basis.group.loads])
        for basis in forced.modes
    ]
    return scipy.linalg.block_diag(*stiffness), scipy.linalg.block_diag(*mass), np.vstack(loads)


def admittance(forced: ForcedPlate, frequency_hz: FloatArray) -> ComplexArray:
    """Current per volt into the driven patches in parallel, each with its polarisation, (n,) in S; sensors stay open.

    The charge of a patch is theta' u + C V with its bonded face's motion u: Y = j omega s' q over the driven ones. Dielectric
    losses are left out.
    """
    signs, driven, left = forced.signs[forced.drivers], forced.drivers, forced.sensors
    out = np.zeros(len(frequency_hz), dtype=complex)
    for index, frequency in enumerate(frequency_hz):
        eigenvalue = forced.plate.scale.eigenvalue(float(frequency))
        parts = [basis.receptance(eigenvalue, forced.loss) for basis in forced.modes]
        per_volt = np.sum(parts, axis=0) * forced.plate.stiffness_unit + np.diag(forced.plate.capacitance_f)
        charge = per_volt[np.ix_(driven, driven)] @ signs
        if left:
            volts = np.linalg.solve(per_volt[np.ix_(left, left)], -per_volt[np.ix_(left, driven)] @ signs)
            charge = charge + per_volt[np.ix_(driven, left)] @ volts
        out[index] = 2j * np.pi * frequency * (signs @ charge)
    return out
