"""Active confinement by the patches themselves: the voltages of the largest contrast between zone and passive face.

a' G_in a over a' G_out a is largest for the first eigenvector of G_in a = c^2 G_out a (choi2002), with G from each
driver's field.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from geometry.elements import ComplexArray
from solvers.piezo.forced import ForcedPlate

ROUNDING = 1e-12  # of the outside's mean: what voltages that move nothing there have


def contrast_volts(plate: ForcedPlate, frequency_hz: float, alpha: float = 0.0) -> ComplexArray | None:
    """Voltages of all patches, 0 of those that listen, the largest of size 1; None with one driver or no passive face.

    alpha^2 times the mean of G_out's diagonal is added to the outside, as solvers.shaping.acoustic_contrast does: large
    voltages for little motion are left alone.
    """
    drivers = plate.drivers
    passive = 2.0 * plate.design.half_span_m > plate.design.width_m * (1.0 + 1e-9)
    if len(drivers) < 2 or plate.circuit != "short" or not passive:
        return None
    inside, outside = _grams(plate, frequency_hz)
    mean = float(np.trace(outside).real)
    floor = max(ROUNDING, alpha**2 / len(drivers)) * mean * np.eye(len(drivers))
    best = scipy.linalg.eigh(inside, outside + floor)[1][:, -1]
    volts = np.zeros(len(plate.plate.patches), dtype=complex)
    volts[drivers] = best / best[int(np.argmax(np.abs(best)))]
    return volts


def unit_volts(plate: ForcedPlate, eigenvalue: float) -> ComplexArray:
    """Voltages of all patches with each driver alone at 1 V and the sensors open, (patches, drivers)."""
    volts = np.eye(len(plate.plate.patches), dtype=complex)[:, plate.drivers]
    if left := plate.sensors:
        moved = np.sum([basis.receptance(eigenvalue, plate.loss) for basis in plate.modes], axis=0)
        moved = moved * plate.plate.stiffness_unit
        clamped = moved[np.ix_(left, left)] + np.diag(plate.plate.capacitance_f[left])
        volts[left] = np.linalg.solve(clamped, -moved[np.ix_(left, plate.drivers)])
    return volts


def _grams(plate: ForcedPlate, frequency_hz: float) -> tuple[ComplexArray, ComplexArray]:
    """Integrals of u_z^* u_z over zone and passive face for pairs of drivers at 1 V each, (drivers, drivers)."""
    eigenvalue, count = plate.plate.scale.eigenvalue(frequency_hz), len(plate.drivers)
    singles = unit_volts(plate, eigenvalue).T
    sums = [np.zeros((count, count), dtype=complex), np.zeros((count, count), dtype=complex)]
    for basis, grams in zip(plate.modes, plate.grams, strict=True):
        moved = np.column_stack([basis.amplitudes(eigenvalue, plate.loss, loads) for loads in singles])
        for total, gram in zip(sums, grams, strict=True):
            total += moved.conj().T @ gram @ moved
    return sums[0], sums[1]
