"""A structure as a table of modes between actuators and sensors, their matrix T(omega), and the calibration of sensors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.errors import SolverError, check_above_zero

# -- modal table -------------------------------------------------------------------------------------------------------
# A structure as a table of modes: frequencies, losses, and each mode's actuator and sensor weights.
# Modes are mass-normalised and e^{+i omega t} is understood: q_m = sum_a actuators[m, a] V_a/(omega_m^2 - omega^2 + i
# omega omega_m/Q_m), signal_s = sum_m sensors[m, s] q_m, w(x_p) = sum_m field[m, p] q_m, plus what the discarded modes
# answer statically (the residuals).

EXACT = 1e-12  # relative distance of squared frequencies below which an undamped mode is hit


@dataclass(frozen=True)
class ModalTable:
    """m modes, a actuators, s sensors, p points; any structure. Raises SolverError for an invalid table.

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


def _receptance(table: ModalTable, frequency_hz: float) -> ComplexArray:
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
    """Modal coordinates per volt of each actuator.

    Parameters
    ----------
    table : ModalTable
        The structure.
    frequency_hz : float
        Driving frequency.

    Returns
    -------
    ndarray, shape (m, a)
        Complex, in m sqrt(kg) per volt.

    Raises
    ------
    SolverError
        For a frequency that is not above 0, or that of a mode without loss.
    """
    return np.asarray(_receptance(table, frequency_hz)[:, None] * table.actuators)


def sensor_matrix(table: ModalTable, frequency_hz: float) -> ComplexArray:
    """Transfer matrix T(omega): signals per volt.

    Parameters
    ----------
    table : ModalTable
        The structure.
    frequency_hz : float
        Driving frequency.

    Returns
    -------
    ndarray, shape (s, a)
        Complex, in the sensors' unit per volt; the static residual is included.

    Raises
    ------
    SolverError
        For a frequency that is not above 0, or that of a mode without loss.
    """
    modal: ComplexArray = table.sensors.T @ modal_drive(table, frequency_hz)
    return modal if table.sensor_residual is None else modal + table.sensor_residual


def field_matrix(table: ModalTable, frequency_hz: float) -> ComplexArray:
    """Displacement at the table's points per volt.

    Parameters
    ----------
    table : ModalTable
        The structure.
    frequency_hz : float
        Driving frequency.

    Returns
    -------
    ndarray, shape (p, a)
        Complex, in m/V; the static residual is included.

    Raises
    ------
    SolverError
        For a frequency that is not above 0, or that of a mode without loss.
    """
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
    named = {
        "quality_factor": (modes,),
        "actuators": (modes, actuators),
        "sensors": (modes, sensors),
        "field": (modes, points),
        "sensor_residual": (sensors, actuators),
        "field_residual": (points, actuators),
    }
    for name, shape in named.items():
        values = getattr(table, name)
        if values is not None and values.shape != shape:
            raise SolverError(f"modal table: {name} has shape {values.shape}, must be {shape}")
        if values is not None and name != "quality_factor" and not np.isfinite(values).all():
            raise SolverError(f"modal table: {name} holds a value that is not finite")
    if not (np.isfinite(table.frequencies_hz).all() and (table.frequencies_hz >= 0.0).all()):
        raise SolverError("modal table: frequencies must be finite and not below 0")
    if not (table.quality_factor > 0.0).all():
        raise SolverError("modal table: quality factors must be above 0 (inf for no loss)")


# -- transfer matrix ---------------------------------------------------------------------------------------------------
# The actuator-sensor matrix T(omega): how well it can be inverted, and at which frequencies.
# coupling = ||I - ORT||_2/(N - 1), ORT_ij = |t_i . conj t_j|/(|t_i||t_j|) over the rows of T: 0 for orthogonal rows,
# 1 when all are parallel. Two equal rows of six give only 0.2 while T is singular, so the condition number is always
# given with it.

UNDRIVEN = 1e-9  # of the largest row: a sensor below it measures nothing


@dataclass(frozen=True)
class Conditioning:
    """Conditioning of one T: condition number sigma_1/sigma_N (inf when singular), coupling and independence = 1 - coupling."""

    condition: float
    coupling: float

    @property
    def independence(self) -> float:
        """1 - coupling: 1 for orthogonal rows, 0 when all are parallel."""
        return 1.0 - self.coupling


def orthogonality(matrix: ComplexArray) -> FloatArray:
    """Compute |cos| of the angle between every pair of sensors' rows, which the scaling of a row does not change.

    Parameters
    ----------
    matrix : ndarray, shape (s, a)
        T.

    Returns
    -------
    ndarray, shape (s, s)
        ORT, from 0 to 1.

    Raises
    ------
    SolverError
        For a row of zeros.
    """
    matrix = np.asarray(matrix, dtype=complex)
    size = np.linalg.norm(matrix, axis=1)
    largest = float(size.max(initial=0.0))
    undriven = np.flatnonzero(size <= UNDRIVEN * largest) if largest > 0.0 else np.arange(len(size))
    if undriven.size:
        raise SolverError(
            f"sensor {undriven[0] + 1} answers to no actuator (its row of T is {size[undriven[0]]:.3g} against {largest:.3g}): "
            "it sits on a node of every mode that is excited; move it or change the frequency"
        )
    rows = matrix / size[:, None]
    return np.minimum(np.abs(rows @ rows.conj().T), 1.0)


def coupling_index(matrix: ComplexArray) -> float:
    """Compute ||I - ORT||_2/(N - 1): 0 for orthogonal rows, 1 for parallel ones.

    Parameters
    ----------
    matrix : ndarray, shape (s, a)
        T.

    Returns
    -------
    float
        Dimensionless.

    Raises
    ------
    SolverError
        For fewer than two rows, or a row of zeros.
    """
    if len(matrix) < 2:
        raise SolverError("the coupling index compares sensors: it needs two or more")
    modal_overlap = orthogonality(matrix)
    return float(np.linalg.norm(np.eye(len(modal_overlap)) - modal_overlap, 2) / (len(modal_overlap) - 1))


def conditioning(matrix: ComplexArray) -> Conditioning:
    """Compute the condition number and the coupling index of T.

    Parameters
    ----------
    matrix : ndarray, shape (s, a)
        T.

    Returns
    -------
    Conditioning
        Both, dimensionless.

    Raises
    ------
    SolverError
        As `coupling_index`.
    """
    singular = np.linalg.svd(matrix, compute_uv=False)
    coupling = coupling_index(matrix)
    return Conditioning(float(singular[0] / singular[-1]) if singular[-1] > 0.0 else np.inf, coupling)


@dataclass(frozen=True)
class Scan:
    """T over n frequencies: condition (n,), coupling (n,)."""

    frequencies_hz: FloatArray
    condition: FloatArray
    coupling: FloatArray


def scan(matrix_at: Callable[[float], ComplexArray], frequencies_hz: FloatArray) -> Scan:
    """Compute the conditioning of T at each frequency.

    Parameters
    ----------
    matrix_at : callable
        T (s, a) at a frequency in Hz.
    frequencies_hz : ndarray, shape (n,)
        The frequencies.

    Returns
    -------
    Scan
        Condition number and coupling index, (n,) each.

    Raises
    ------
    SolverError
        As `coupling_index`.
    """
    couplings = [conditioning(matrix_at(float(f))) for f in frequencies_hz]
    return Scan(
        np.asarray(frequencies_hz, dtype=float),
        np.array([one.condition for one in couplings]),
        np.array([one.coupling for one in couplings]),
    )


def operating_frequencies(of: Scan, count: int = 3) -> FloatArray:
    """Choose the best frequencies at which to invert T: the smallest condition numbers among the local minima of a scan.

    Parameters
    ----------
    of : Scan
        Condition numbers over frequency.
    count : int, optional
        Largest number of frequencies.

    Returns
    -------
    ndarray, shape (count or fewer,)
        In Hz, best first.

    Raises
    ------
    SolverError
        If the scan has no minimum between its ends.
    """
    inner = of.condition[1:-1]
    lows = 1 + np.flatnonzero((inner < of.condition[:-2]) & (inner <= of.condition[2:]))
    if not lows.size:
        raise SolverError("the scan has no minimum of the condition number between its ends; scan a wider band")
    best = lows[np.argsort(of.condition[lows], kind="stable")][:count]
    return np.asarray(of.frequencies_hz[best])


# -- calibration -------------------------------------------------------------------------------------------------------
# Sensors calibrated on a standing wave: each sensor's voltage against the displacement under it, over several
# amplitudes.
# w = c V with a complex c per sensor: |c| in m/V, and the phase that the measuring chain adds. c belongs to the wave
# it was measured on: a patch answers strain, whose ratio to displacement changes with wavelength and near a driven
# patch.

NODE = 0.05  # of the largest amplitude: a sensor below it stands too near a node to be calibrated on this wave


def calibrate(displacement: ComplexArray, voltage: ComplexArray) -> ComplexArray:
    """Calibrate sensors by the amplitudes of one standing wave: c = sum conj(V) w/sum |V|^2.

    Parameters
    ----------
    displacement, voltage : ndarray, shape (n, s)
        Complex readings at n amplitudes, in m and V.

    Returns
    -------
    ndarray, shape (s,)
        In m/V.

    Raises
    ------
    SolverError
        For fewer than two amplitudes, unequal shapes, or a sensor on a node of the wave.
    """
    w, v = displacement, voltage
    if w.ndim != 2 or w.shape != v.shape or not w.size:
        raise SolverError(
            f"calibration: displacement {w.shape} and voltage {v.shape} must be (amplitudes, sensors) alike"
        )
    if len(w) < 2:
        raise SolverError("calibration: one amplitude cannot show that a sensor is linear; measure two or more")
    _refuse_nodes(w, "moves")
    _refuse_nodes(v, "answers")
    return np.asarray(np.sum(v.conj() * w, axis=0) / np.sum(np.abs(v) ** 2, axis=0))


def common_phase(factor: ComplexArray) -> float:
    """Compute the common phase of the sensors' factors, which is the delay of the measuring chain.

    Parameters
    ----------
    factor : ndarray, shape (s,)
        Complex factors.

    Returns
    -------
    float
        In rad.
    """
    return float(np.angle(np.sum(factor / np.abs(factor))))


def _refuse_nodes(values: ComplexArray, verb: str) -> None:
    size = np.sqrt(np.mean(np.abs(values) ** 2, axis=0))
    low = np.flatnonzero(size <= NODE * size.max())
    if low.size:
        raise SolverError(
            f"calibration: sensor {low[0] + 1} sits on a node of this wave (it {verb} {size[low[0]]:.3g} against "
            f"{size.max():.3g} elsewhere); use another mode or move it"
        )
