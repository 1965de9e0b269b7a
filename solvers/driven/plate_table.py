"""A driven plate's own modes as the table that shaping works on: sensors open, drivers fed by voltages.

With E = C + R_ss (clamped capacitance and quasi-static residual of the sensors) and modes r of the plate with closed circuits,
gains g_rp = phi_r' theta_p, open sensors stiffen the modes: (diag(lambda) + g_s E^-1 g_s') x = mu x. The damping that couples
the modes mu is left out, of the order of the electromechanical coupling over Q. u_z and u_s then follow from
V_s = -E^-1 (R_sd V_d + g_s' q); residuals are those at one frequency.
"""

from __future__ import annotations

import numpy as np

from geometry.elements import FloatArray
from solvers.errors import SolverError
from solvers.piezo.forced import ForcedPlate
from solvers.piezo.point import face_motion
from solvers.shaping.modal_table import ModalTable


def plate_table(
    forced: ForcedPlate, points_m: FloatArray, frequency_hz: float, rows: list[FloatArray] | None = None
) -> ModalTable:
    """The modes about the band over points (p, 2) of the touch face, in SI: actuators are the drivers, in the order of
    `forced.drivers`, sensors those that listen, V. Residuals are those at the frequency.

    rows: `motion_at` of the points, where it is known. SolverError for drivers that are fed a charge, or without sensors.
    """
    if forced.circuit != "short" or not forced.sensors:
        raise SolverError("shaping needs drivers that a voltage feeds and at least one patch that listens")
    plate, d, s = forced.plate, forced.drivers, forced.sensors
    scale, unit = plate.scale, plate.stiffness_unit
    eigenvalue = scale.eigenvalue(frequency_hz)
    values = np.concatenate([basis.eigenvalue for basis in forced.modes])
    gain = np.concatenate([basis.gain for basis in forced.modes])
    residual = np.sum([basis.residual(eigenvalue) for basis in forced.modes], axis=0)
    moves, beyond = _motion(forced, motion_at(forced, points_m) if rows is None else rows, eigenvalue)
    clamped = np.diag(plate.capacitance_f[s]) / unit + residual[np.ix_(s, s)]
    heard = np.linalg.solve(clamped, gain[:, s].T)  # -V_s per modal coordinate, (sensors, modes)
    at_once = np.linalg.solve(clamped, residual[np.ix_(s, d)])  # -V_s per volt of a driver
    mu, vectors = np.linalg.eigh(np.diag(values) + gain[:, s] @ heard)
    elastic = np.einsum("rm,r,rm->m", vectors, values, vectors)
    size = 1.0 / np.sqrt(scale.mass_kg)  # of a mode of 1 kg
    return ModalTable(
        frequencies_hz=np.asarray(scale.frequency(mu)),
        quality_factor=np.asarray(mu / (elastic * forced.loss)),
        actuators=vectors.T @ (gain[:, d] - heard.T @ residual[np.ix_(s, d)]) * scale.angular**2 / size,
        sensors=-(vectors.T @ heard.T) * size,
        field=vectors.T @ (moves - beyond[:, s] @ heard).T * size,
        points_m=points_m,
        sensor_residual=-at_once,
        field_residual=beyond[:, d] - beyond[:, s] @ at_once,
    )


def motion_at(forced: ForcedPlate, points_m: FloatArray) -> list[FloatArray]:
    """u_z at points (p, 2) of the touch face per unit of each column, group by group."""
    return [np.asarray(face_motion(basis.group, points_m) @ basis.columns) for basis in forced.modes]


def _motion(forced: ForcedPlate, known: list[FloatArray], eigenvalue: float) -> tuple[FloatArray, FloatArray]:
    """u_z at points per modal coordinate, (points, modes), and per volt beyond the modes, (points, patches)."""
    moves, beyond = [], np.zeros((len(known[0]), len(forced.plate.patches)))
    for basis, rows in zip(forced.modes, known, strict=True):
        count, patches = len(basis.frequency_hz), beyond.shape[1]
        moves.append(rows[:, :count])
        residual, slope = rows[:, count : count + patches], rows[:, count + patches :]
        beyond += residual + (eigenvalue - basis.middle) * slope
    return np.hstack(moves), beyond
