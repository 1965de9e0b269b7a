"""Voltages for a target motion within the amplifiers' limits and for the largest contrast, and the effect of errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import minimize

from geometry.elements import BoolArray, ComplexArray, FloatArray
from solvers.errors import SolverError, check_above_zero
from solvers.measures.confinement import ratio_db
from solvers.shaping.modal_table import ModalTable, field_matrix, orthogonality

SINGULAR = 1e-12  # sigma_N/sigma_1 below which T^-1 holds rounding only
OPTIMAL = 1e-6  # relative: how far a limited solution may stand from its optimality conditions

REGIONS = ("left", "middle", "right")


@dataclass(frozen=True)
class Drive:
    """voltages (a,), V; error = |T V - W|/|W|."""

    voltages: ComplexArray
    error: float


@dataclass(frozen=True)
class LowPass:
    """inductance_h L, resistance_ohm R, capacitance_f C of the clamped patch; all above 0."""

    inductance_h: float
    resistance_ohm: float
    capacitance_f: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            check_above_zero(f"filter: {name}", value)

    @property
    def corner_hz(self) -> float:
        """1/(2 pi sqrt(LC)), Hz."""
        return 1.0 / (2.0 * pi * sqrt(self.inductance_h * self.capacitance_f))

    def response(self, frequency_hz: float) -> complex:
        """F(i omega); SolverError for a frequency that is not above 0."""
        return 1.0 / (1.0 + self.capacitance_f * self._impedance(frequency_hz))

    def loaded_response(self, frequency_hz: float, capacitance: ComplexArray) -> ComplexArray:
        """V over V_command (a, a) with every patch on its own filter and C(omega) (a, a) in place of C.

        SolverError for a frequency that is not above 0.
        """
        return np.asarray(np.linalg.inv(np.eye(len(capacitance)) + self._impedance(frequency_hz) * capacitance))

    def compensation(self, frequency_hz: float) -> complex:
        """1/F(i omega): the factor on each command that undoes gain and phase of the unloaded filter."""
        return 1.0 / self.response(frequency_hz)

    def _impedance(self, frequency_hz: float) -> complex:
        """s R + s^2 L: voltage lost per charge."""
        check_above_zero("frequency in Hz", frequency_hz)
        s = 2j * pi * frequency_hz
        return self.resistance_ohm * s + self.inductance_h * s**2


@dataclass(frozen=True)
class Errors:
    """Standard deviations, and how often they are drawn from which seed: the same one gives the same numbers.

    noise: of each entry of T as a share of its largest one (complex, rms); gain: relative; phase_rad; crosstalk: of the share
    (complex, rms) a sensor picks up from each neighbour. All 0 or more; trials 1 or more.
    """

    noise: float = 0.0
    gain: float = 0.0
    phase_rad: float = 0.0
    crosstalk: float = 0.0
    trials: int = 400
    seed: int = 1

    def __post_init__(self) -> None:
        for name in ("noise", "gain", "phase_rad", "crosstalk"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                raise SolverError(f"errors: {name} = {value:g}: must be 0 or more")
        if self.trials < 1:
            raise SolverError(f"trials = {self.trials}: must be 1 or more")


@dataclass(frozen=True)
class Contrast:
    """Confinement of a field: ratios of amplitudes, inside over outside."""

    peak_ratio: float
    contrast: float

    @property
    def contrast_db(self) -> float:
        """20 log10 of the contrast."""
        return float(ratio_db(self.contrast, 1.0))


@dataclass(frozen=True)
class Confined:
    """Confinement at one frequency, rms inside over outside in dB: one actuator, and all with the best voltages (a,), V."""

    alone_db: float
    shaped_db: float
    voltages: ComplexArray


def drive_voltages(matrix: ComplexArray, target: ComplexArray, limit_v: float = np.inf) -> Drive:
    """Find the voltages for a target motion: least squares with more sensors than actuators, else the smallest voltages.

    Parameters
    ----------
    matrix : ndarray, shape (s, a)
        T, signals per volt.
    target : ndarray, shape (s,)
        W, in the sensors' unit.
    limit_v : float, optional
        Largest voltage.

    Returns
    -------
    Drive
        Voltages in V and relative residual.

    Raises
    ------
    SolverError
        For a singular T, a target of zeros or of another length, or a limit that is not above 0.
    """
    matrix, target = np.asarray(matrix, dtype=complex), np.asarray(target, dtype=complex)
    _check(matrix, target, limit_v)
    left, singular, right = np.linalg.svd(matrix, full_matrices=False)
    _refuse_singular(matrix, singular)
    voltages = right.conj().T @ (singular / singular**2 * (left.conj().T @ target))
    if np.abs(voltages).max() > limit_v:
        voltages = _limited(matrix, target, limit_v, voltages)
    return Drive(voltages, float(np.linalg.norm(matrix @ voltages - target) / np.linalg.norm(target)))


def filter_for(capacitance_f: float, highest_hz: float, pwm_hz: float) -> LowPass:
    """Size a maximally flat low-pass, sqrt(L/C)/R = sqrt(1/2), with its corner at the geometric mean of both frequencies.

    Parameters
    ----------
    capacitance_f : float
        Capacitance of the patch, in F (farads): a number above 0.
    highest_hz, pwm_hz : float
        Highest operating frequency and PWM frequency.

    Returns
    -------
    LowPass
        L in H, R in ohm and C in F.

    Raises
    ------
    SolverError
        Unless 0 < highest_hz < pwm_hz and the capacitance is above 0.
    """
    if not 0.0 < highest_hz < pwm_hz:
        raise SolverError(
            f"filter: requires 0 < highest operating frequency < PWM frequency, got {highest_hz:g} and {pwm_hz:g} Hz"
        )
    check_above_zero("filter: capacitance", capacitance_f)
    corner = 2.0 * pi * sqrt(highest_hz * pwm_hz)
    inductance = 1.0 / (corner**2 * capacitance_f)
    return LowPass(inductance, sqrt(2.0 * inductance / capacitance_f), capacitance_f)


def monte_carlo(matrix: ComplexArray, target: ComplexArray, errors: Errors) -> tuple[ComplexArray, FloatArray]:
    """Compute the voltages of seeded trials in which T is known with errors, and what they miss of the target.

    Parameters
    ----------
    matrix : ndarray, shape (s, a)
        True T, signals per volt.
    target : ndarray, shape (s,)
        W, in the sensors' unit.
    errors : Errors
        Number of trials, seed and sizes of the errors.

    Returns
    -------
    voltages : ndarray, shape (n, a)
        In V, one row per trial.
    missed : ndarray, shape (n,)
        |T V - W|/|W|.

    Raises
    ------
    SolverError
        As `drive_voltages`.
    """
    random = np.random.default_rng(errors.seed)
    known = [_misjudged(np.asarray(matrix, dtype=complex), errors, random) for _ in range(errors.trials)]
    voltages = np.stack([drive_voltages(one, target).voltages for one in known])
    missed = np.linalg.norm(voltages @ np.asarray(matrix).T - target, axis=1)
    return voltages, missed / float(np.linalg.norm(target))


def quantiles(values: FloatArray) -> dict[str, Any]:
    """Compute the 5, 50 and 95 % quantiles of trials.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Results of the trials.

    Returns
    -------
    dict
        "q05", "median" and "q95".
    """
    low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
    return {"q05": float(low), "median": float(middle), "q95": float(high)}


def _unit_phasors(random: np.random.Generator, shape: tuple[int, ...]) -> ComplexArray:
    """Normally distributed phasors of rms 1."""
    return np.asarray((random.standard_normal(shape) + 1j * random.standard_normal(shape)) / np.sqrt(2.0))


def region_sensors(region: str, count: int) -> NDArray[np.intp]:
    """List the sensors in one third of the line.

    Parameters
    ----------
    region : str
        One of REGIONS.
    count : int
        Number of sensors.

    Returns
    -------
    ndarray of int, shape (about count / 3,)
        Numbers of the sensors.

    Raises
    ------
    SolverError
        For an unknown region, or fewer than 3 sensors.
    """
    if region not in REGIONS:
        raise SolverError(f"region {region!r}: must be one of {', '.join(REGIONS)}")
    if count < len(REGIONS):
        raise SolverError(f"{count} sensors: three regions need 3 or more")
    return np.array_split(np.arange(count), len(REGIONS))[[*REGIONS].index(region)]


def region_points(region: str, places_m: FloatArray, points_m: FloatArray) -> BoolArray:
    """Find the points nearest to a sensor of a region.

    Parameters
    ----------
    region : str
        One of REGIONS.
    places_m : ndarray, shape (s,)
        Places of the sensors.
    points_m : ndarray, shape (p,) or (p, d)
        Points; x comes first.

    Returns
    -------
    ndarray of bool, shape (p,)
        True where no sensor outside the region is nearer.

    Raises
    ------
    SolverError
        As `region_sensors`.
    """
    places, x = np.asarray(places_m, dtype=float), np.asarray(points_m).reshape(len(points_m), -1)[:, 0]
    chosen, away = region_sensors(region, len(places)), np.abs(x[:, None] - places)
    rounding = 1e-9 * float(np.ptp(x))
    return np.asarray(away[:, chosen].min(axis=1) <= away.min(axis=1) + rounding)


def region_target(region: str, count: int, alternate: bool = False) -> ComplexArray:
    """Set signals 1 inside a region and 0 outside.

    Parameters
    ----------
    region : str
        One of REGIONS.
    count : int
        Number of sensors.
    alternate : bool, optional
        Alternate the sign inside, +1, -1 and so on.

    Returns
    -------
    ndarray, shape (s,)
        Complex signals.

    Raises
    ------
    SolverError
        As `region_sensors`.
    """
    target, inside = np.zeros(count, dtype=complex), region_sensors(region, count)
    target[inside] = (-1.0) ** np.arange(len(inside)) if alternate else 1.0
    return target


def contrast(displacement: ComplexArray, inside: BoolArray) -> Contrast:
    """Compute the ratios of a field inside to outside, over points that stand for equal lengths.

    Parameters
    ----------
    displacement : ndarray, shape (p,)
        Complex displacement in any unit.
    inside : ndarray of bool, shape (p,)
        Points of the region.

    Returns
    -------
    Contrast
        Ratios of the largest values and of the rms.

    Raises
    ------
    SolverError
        If a side has no point, or the field is zero.
    """
    _check_sides(inside)
    size = np.abs(displacement)
    if not size.any():
        raise SolverError("the field is zero everywhere: its confinement is undefined")
    power = [float(np.mean(size[side] ** 2)) for side in (inside, ~inside)]
    with np.errstate(divide="ignore"):
        peak = np.float64(size[inside].max()) / size[~inside].max()
        return Contrast(float(peak), float(np.sqrt(np.float64(power[0]) / power[1])))


def best_contrast(field: ComplexArray, inside: BoolArray) -> ComplexArray:
    """Find the voltages of the largest contrast.

    Parameters
    ----------
    field : ndarray, shape (p, a)
        Displacement per volt.
    inside : ndarray of bool, shape (p,)
        Points of the region.

    Returns
    -------
    ndarray, shape (a,)
        In V, the largest of size 1.

    Raises
    ------
    SolverError
        If a side has no point, or some voltages move nothing outside (fewer points than actuators).
    """
    _check_sides(inside)
    gram_in, gram_out = (field[side].conj().T @ field[side] / len(field[side]) for side in (inside, ~inside))
    spread = np.linalg.eigvalsh(gram_out)
    if spread[0] <= 1e-14 * spread[-1]:
        raise SolverError("some voltages move nothing outside, to rounding: their contrast is unbounded")
    best = eigh(gram_in, gram_out)[1][:, -1]
    return np.asarray(best / np.abs(best).max())


def attach_oscillators(
    table: ModalTable, points: NDArray[np.intp], mass_kg: float, frequency_hz: float, quality_factor: float
) -> ModalTable:
    """Join equal mass-spring oscillators to a structure at some of its points; the residuals stay.

    The loss of a joined mode is its strain energy in each part divided by the part's quality factor.

    Parameters
    ----------
    table : ModalTable
        Modes of the structure.
    points : ndarray of int, shape (n,)
        Numbers of the points.
    mass_kg, frequency_hz, quality_factor : float
        Of each oscillator; the quality factor is dimensionless.

    Returns
    -------
    ModalTable
        Modes of both.

    Raises
    ------
    SolverError
        For no point or an unknown one, or a value that is not above 0.
    """
    chosen = np.asarray(points, dtype=int)
    if not chosen.size or chosen.min() < 0 or chosen.max() >= len(table.points_m):
        raise SolverError(f"oscillators: points must be from 0 to {len(table.points_m) - 1}, at least one")
    for name, value in (("mass", mass_kg), ("frequency", frequency_hz), ("quality_factor", quality_factor)):
        if not value > 0.0:
            raise SolverError(f"oscillators: {name} = {value:g}: must be above 0")
    modes, hung = table.frequencies_hz.size, len(chosen)
    spring = mass_kg * (2.0 * pi * frequency_hz) ** 2
    # coordinates: the table's modes (mass 1), then each oscillator's own displacement; a spring stretches by w(x_i) - a_i
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


def confinement(table: ModalTable, frequency_hz: float, inside: BoolArray, driver: int) -> Confined:
    """Compute the confinement to a region by one actuator and by all.

    Parameters
    ----------
    table : ModalTable
        Modes, actuators and points.
    frequency_hz : float
        Frequency of the drive.
    inside : ndarray of bool, shape (p,)
        Points of the region.
    driver : int
        Number of the single actuator.

    Returns
    -------
    Confined
        Levels of both in dB, and the voltages of all.

    Raises
    ------
    SolverError
        For an unknown driver; as `best_contrast` and `field_matrix`.
    """
    if not 0 <= driver < table.actuator_count:
        raise SolverError(f"driver {driver}: must be from 0 to {table.actuator_count - 1}")
    field = field_matrix(table, frequency_hz)
    voltages = best_contrast(field, inside)
    alone, shaped = contrast(field[:, driver], inside), contrast(field @ voltages, inside)
    return Confined(alone.contrast_db, shaped.contrast_db, voltages)


def _check(matrix: ComplexArray, target: ComplexArray, limit_v: float) -> None:
    if matrix.ndim != 2 or not matrix.size:
        raise SolverError("T has no entry: the list of actuators or of sensors is empty")
    if not (np.isfinite(matrix).all() and np.isfinite(target).all()):
        raise SolverError("T or the target holds a value that is not finite")
    if target.shape != (len(matrix),):
        raise SolverError(f"the target has shape {target.shape}, must be ({len(matrix)},), one value per sensor")
    if not np.abs(target).any():
        raise SolverError("the target is zero everywhere: request a vibration somewhere")
    if not limit_v > 0.0:
        raise SolverError(f"voltage limit = {limit_v:g} V: must be above 0 (inf for none)")


def _refuse_singular(matrix: ComplexArray, singular: FloatArray) -> None:
    if singular[-1] > SINGULAR * singular[0]:
        return
    modal_overlap = orthogonality(matrix)
    np.fill_diagonal(modal_overlap, 0.0)
    i, j = np.unravel_index(int(np.argmax(modal_overlap)), modal_overlap.shape)
    condition = singular[0] / singular[-1] if singular[-1] > 0.0 else np.inf
    raise SolverError(
        f"T is singular (condition number {condition:.2g}): sensors {min(i, j) + 1} and {max(i, j) + 1} are the most alike "
        f"({modal_overlap[i, j]:.6f} of 1); move off the resonance or move a patch"
    )


def _limited(matrix: ComplexArray, target: ComplexArray, limit_v: float, start: ComplexArray) -> ComplexArray:
    """The constrained minimum by sequential quadratic programming in units of the limit, over real and imaginary parts."""
    size = matrix.shape[1]
    scale = float(np.linalg.norm(matrix, 2))
    gram = matrix.conj().T @ matrix / scale**2
    pull = matrix.conj().T @ target / (scale**2 * limit_v)

    def cost(x: FloatArray) -> tuple[float, FloatArray]:
        v = x[:size] + 1j * x[size:]
        slope = gram @ v - pull
        value = float((v.conj() @ (gram @ v)).real / 2.0 - (pull.conj() @ v).real)
        return value, np.concatenate([slope.real, slope.imag])

    room = {
        "type": "ineq",
        "fun": lambda x: 1.0 - x[:size] ** 2 - x[size:] ** 2,
        "jac": lambda x: np.hstack([np.diag(-2.0 * x[:size]), np.diag(-2.0 * x[size:])]),
    }
    first = start / np.maximum(np.abs(start), limit_v)
    x0 = np.concatenate([first.real, first.imag])
    optimum = minimize(cost, x0, jac=True, constraints=[room], method="SLSQP", options={"ftol": 1e-15, "maxiter": 500})
    voltages = optimum.x[:size] + 1j * optimum.x[size:]
    voltages = voltages / np.maximum(np.abs(voltages), 1.0)
    # the cost's gap to its linearised minimum over |V_a| <= 1 bounds how far it is above its own (Frank and Wolfe, jaggi2013)
    slope = gram @ voltages - pull
    gap = float((slope.conj() @ voltages).real + np.abs(slope).sum()) / float(np.abs(pull).sum())
    if gap > OPTIMAL:
        raise SolverError(f"limited voltages: {gap:.1e} from optimal, allowed {OPTIMAL:.0e}; move off the resonance")
    return np.asarray(limit_v * voltages)


def _misjudged(matrix: ComplexArray, errors: Errors, random: np.random.Generator) -> ComplexArray:
    size = len(matrix)
    gains = (1.0 + errors.gain * random.standard_normal(size)) * np.exp(
        1j * errors.phase_rad * random.standard_normal(size)
    )
    neighbours = np.eye(size, k=1) + np.eye(size, k=-1)
    heard = np.eye(size) + errors.crosstalk * neighbours * _unit_phasors(random, (size, size))
    noise = errors.noise * float(np.abs(matrix).max()) * _unit_phasors(random, matrix.shape)
    return np.asarray(gains[:, None] * (heard @ matrix) + noise)


def _check_sides(inside: BoolArray) -> None:
    if inside.all() or not inside.any():
        raise SolverError("confinement compares two sides: some points must lie inside and some outside")
