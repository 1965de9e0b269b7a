"""Active confinement by the patches themselves: the voltages of the largest contrast between zone and passive face.

a' G_in a over a' G_out a is largest for the first eigenvector of G_in a = c^2 G_out a (choi2002), with G from each
driver's field.
"""

from __future__ import annotations

import numpy as np

from geometry.elements import ComplexArray, FloatArray
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
    volts = np.zeros(len(plate.plate.patches), dtype=complex)
    volts[drivers] = best_volts(*_grams(plate, frequency_hz), alpha)
    return volts


def best_volts(inside: ComplexArray, outside: ComplexArray, alpha: float) -> ComplexArray:
    """The drivers' voltages (..., d) of the largest contrast between two forms (..., d, d), the largest of size 1."""
    count = inside.shape[-1]
    mean = np.trace(outside, axis1=-2, axis2=-1).real[..., None, None]
    lower = np.linalg.cholesky(outside + max(ROUNDING, alpha**2 / count) * mean * np.eye(count))
    back = np.linalg.inv(lower)
    top = np.linalg.eigh(back @ inside @ back.conj().swapaxes(-1, -2))[1][..., -1]
    best = (back.conj().swapaxes(-1, -2) @ top[..., None])[..., 0]
    largest = np.abs(best).argmax(axis=-1)[..., None]
    return np.asarray(best / np.take_along_axis(best, largest, axis=-1))


def unit_volts(plate: ForcedPlate, eigenvalue: float | FloatArray) -> ComplexArray:
    """Voltages of all patches at eigenvalues (...) with each driver alone at 1 V, sensors open, (..., patches, drivers)."""
    one = np.eye(len(plate.plate.patches), dtype=complex)[:, plate.drivers]
    volts = np.tile(one, (*np.shape(eigenvalue), 1, 1))
    if left := plate.sensors:
        moved, clamped = clamped_charges(plate, eigenvalue)
        volts[..., left, :] = -np.linalg.solve(clamped, moved[..., plate.drivers])
    return volts


def clamped_charges(plate: ForcedPlate, eigenvalue: float | FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Charges of the sensors per volt on each patch by the plate's motion (..., sensors, patches), and on the sensors in all
    (..., sensors, sensors), scaled.
    """
    left = plate.sensors
    moved = np.sum([basis.receptance(eigenvalue, plate.loss)[..., left, :] for basis in plate.modes], axis=0)
    return moved, moved[..., left] + np.diag(plate.plate.capacitance_f[left]) / plate.plate.stiffness_unit


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
