"""A structure as a table of modes: frequencies, losses, and how much each mode feels and shows.

Modes are mass-normalised and e^{+i omega t} is understood:
q_m = sum_a actuators[m, a] V_a/(omega_m^2 - omega^2 + i omega omega_m/Q_m),  signal_s = sum_m sensors[m, s] q_m,
w(x_p) = sum_m field[m, p] q_m, plus what the modes left out answer statically (the residuals).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.errors import SolverError, check_above_zero

EXACT = 1e-12  # relative distance of squared frequencies below which an undamped mode is hit


@dataclass(frozen=True)
class ModalTable:
    """m modes, a actuators, s sensors, p points; any structure. Raises SolverError for what cannot be one.

    frequencies_hz (m,); quality_factor (m,), inf without loss; actuators (m, a), N/V per sqrt(kg); sensors (m, s), signal per
    modal coordinate (m sqrt(kg)); field (m, p), 1/sqrt(kg); points_m (p, d). Residuals (s, a) and (p, a): static answer
    of the modes that are not in the table, None for none.
    """

    frequencies_hz: FloatArray
    quality_factor: FloatArray
    actuators: FloatArray
    sensors: FloatArray
    field: FloatArray
    points_m: FloatArray
    sensor_residual: FloatArray | None = None
    field_residual: FloatArray | None = None

    def __post_init__(self) -> None:
        _check(self)

    @property
    def angular(self) -> FloatArray:
        """Angular frequencies omega_m, rad/s, shape (m,)."""
        return 2.0 * pi * self.frequencies_hz

    @property
    def actuator_count(self) -> int:
        """Number of actuators."""
        return int(self.actuators.shape[1])

    @property
    def sensor_count(self) -> int:
        """Number of sensors."""
        return int(self.sensors.shape[1])

    def nearest(self, frequency_hz: float) -> int:
        """Index of the mode nearest to a frequency."""
        return int(np.argmin(np.abs(self.frequencies_hz - frequency_hz)))


def receptance(table: ModalTable, frequency_hz: float) -> ComplexArray:
    """1/(omega_m^2 - omega^2 + i omega omega_m/Q_m), s2, shape (m,).

    Raises SolverError for a frequency that is not above 0, and on the very frequency of a mode without loss.
    """
    check_above_zero("frequency in Hz", frequency_hz)
    omega = 2.0 * pi * frequency_hz
    detuning = table.angular**2 - omega**2
    hit = np.flatnonzero((np.abs(detuning) <= EXACT * omega**2) & np.isinf(table.quality_factor))
    if hit.size:
        raise SolverError(
            f"{frequency_hz:.6g} Hz is the frequency of mode {hit[0] + 1}, which has no loss: its response is infinite; "
            "give it a quality factor or move off the resonance"
        )
    return np.asarray(1.0 / (detuning + 1j * omega * table.angular / table.quality_factor))


def modal_drive(table: ModalTable, frequency_hz: float) -> ComplexArray:
    """Modal coordinates per volt, shape (m, a); errors as receptance."""
    return np.asarray(receptance(table, frequency_hz)[:, None] * table.actuators)


def sensor_matrix(table: ModalTable, frequency_hz: float) -> ComplexArray:
    """T(omega): signals per volt, shape (s, a); errors as receptance."""
    modal: ComplexArray = table.sensors.T @ modal_drive(table, frequency_hz)
    return modal if table.sensor_residual is None else modal + table.sensor_residual


def field_matrix(table: ModalTable, frequency_hz: float) -> ComplexArray:
    """Displacement at the points per volt, m/V, shape (p, a); errors as receptance."""
    modal: ComplexArray = table.field.T @ modal_drive(table, frequency_hz)
    return modal if table.field_residual is None else modal + table.field_residual


def _check(table: ModalTable) -> None:
    modes = table.frequencies_hz.size
    if not modes:
        raise SolverError("modal table: it has no mode")
    for name, axis in (("actuators", "actuator"), ("sensors", "sensor")):
        weights = getattr(table, name)
        if weights.ndim != 2 or weights.shape[1] == 0:
            raise SolverError(f"modal table: the list of {name} is empty, at least one {axis} is needed")
    points, sensors, actuators = len(table.points_m), table.sensors.shape[1], table.actuators.shape[1]
    wanted = {
        "quality_factor": (modes,),
        "actuators": (modes, actuators),
        "sensors": (modes, sensors),
        "field": (modes, points),
        "sensor_residual": (sensors, actuators),
        "field_residual": (points, actuators),
    }
    for name, shape in wanted.items():
        values = getattr(table, name)
        if values is not None and values.shape != shape:
            raise SolverError(f"modal table: {name} has shape {values.shape}, must be {shape}")
        if values is not None and name != "quality_factor" and not np.isfinite(values).all():
            raise SolverError(f"modal table: {name} holds a value that is not finite")
    if not (np.isfinite(table.frequencies_hz).all() and (table.frequencies_hz >= 0.0).all()):
        raise SolverError("modal table: frequencies must be finite and not below 0")
    if not (table.quality_factor > 0.0).all():
        raise SolverError("modal table: quality factors must be above 0 (inf for no loss)")
