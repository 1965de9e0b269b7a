"""Travelling waves along a line: targets, measures of how much travels, and pairs of modes a quarter period apart."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from geometry.elements import BoolArray, ComplexArray, FloatArray
from solvers.errors import SolverError, check_above_zero
from solvers.shaping.modal_table import ModalTable, field_matrix, modal_drive
from solvers.shaping.voltages import Drive, drive_voltages

# -- waves -------------------------------------------------------------------------------------------------------------
# Travelling waves along a line: targets, and how much of what comes out travels.
# A wave towards +x is e^{-ikx} (time factor e^{+i omega t}). TWR = 1 - SWR, SWR = (A_max - A_min)/(A_max + A_min):
# for two waves a and b it is 1 - |b|/|a|, a ratio of amplitudes. The wave that goes forward then carries 1/(1 + (1 -
# TWR)^2) of the two waves' energy, and the net flux is 1 - (1 - TWR)^2 of the forward wave's. A line that moves in
# step with even amplitude has a TWR of 1 too: the two-wave fit distinguishes the two.

MIN_COUNT = 8  # points for a two-wave fit


def wave_target(places_m: FloatArray, wavelength_m: float) -> ComplexArray:
    """Compute e^{-2 pi i x/lambda} at the sensors: equal amplitudes, phases by place.

    Parameters
    ----------
    places_m : ndarray, shape (s,)
        Places of the sensors.
    wavelength_m : float
        lambda.

    Returns
    -------
    ndarray, shape (s,)
        Target phasors.

    Raises
    ------
    SolverError
        If the wavelength is not above 0.
    """
    check_above_zero("wavelength in m", wavelength_m)
    return np.asarray(np.exp(-2j * pi * np.asarray(places_m) / wavelength_m))


def free_wavelength_m(frequency_hz: float, bending_n_m2: float, mass_kg_m: float) -> float:
    """Compute the wavelength 2 pi c/omega of a free flexural wave, c = sqrt(omega) (EI/rho A)^(1/4) its phase velocity.

    Parameters
    ----------
    frequency_hz : float
        Frequency of the wave.
    bending_n_m2 : float
        EI, in N m^2.
    mass_kg_m : float
        rho A, in kg/m.

    Returns
    -------
    float
        In m.

    Raises
    ------
    SolverError
        If the frequency is not above 0.

    References
    ----------
    .. [1] graff1975 (docs/references.bib)
    """
    check_above_zero("frequency in Hz", frequency_hz)
    omega = 2.0 * pi * frequency_hz
    return float(2.0 * pi * (bending_n_m2 / mass_kg_m) ** 0.25 / np.sqrt(omega))


def travelling_wave_ratio(displacement: ComplexArray) -> float:
    """Compute TWR = 1 - SWR of |w| over points outside the near field.

    Parameters
    ----------
    displacement : ndarray, shape (p,)
        Complex displacement in any unit.

    Returns
    -------
    float
        From 0 (standing) to 1 (travelling), dimensionless.

    Raises
    ------
    SolverError
        For a field of zeros.
    """
    size = np.abs(displacement)
    if not size.size or size.max() == 0.0:
        raise SolverError("the field is zero everywhere: it has no standing-wave ratio")
    return 1.0 - float((size.max() - size.min()) / (size.max() + size.min()))


def forward_energy_share(ratio: float) -> float:
    """Compute the forward wave's share of the energy of both waves, 1/(1 + (1 - TWR)^2).

    Parameters
    ----------
    ratio : float
        TWR, dimensionless.

    Returns
    -------
    float
        Dimensionless.
    """
    return 1.0 / (1.0 + (1.0 - ratio) ** 2)


def net_flux_share(ratio: float) -> float:
    """Compute the net energy flux relative to the forward wave's, 1 - (1 - TWR)^2.

    Parameters
    ----------
    ratio : float
        TWR, dimensionless.

    Returns
    -------
    float
        Dimensionless.
    """
    return 1.0 - (1.0 - ratio) ** 2


def inner_window(points_m: FloatArray, low_m: float, high_m: float) -> BoolArray:
    """Find the points on the stretch low <= x <= high, outside the near fields of the ends.

    Parameters
    ----------
    points_m : ndarray, shape (p,) or (p, d)
        Points; x comes first.
    low_m, high_m : float
        Ends of the stretch.

    Returns
    -------
    ndarray of bool, shape (p,)
        True inside.

    Raises
    ------
    SolverError
        If it holds fewer than two points.
    """
    x = np.asarray(points_m).reshape(len(points_m), -1)[:, 0]
    inside = (x >= low_m) & (x <= high_m)
    if inside.sum() < 2:
        raise SolverError(f"no two points lie between {low_m:g} and {high_m:g} m")
    return np.asarray(inside)


@dataclass(frozen=True)
class TwoWaves:
    """w = forward e^{-ikx} + backward e^{+ikx} fitted: complex amplitudes, k in rad/m; residual: |w - fit|/|w| (rms)."""

    forward: complex
    backward: complex
    wavenumber: float
    residual: float

    @property
    def twr(self) -> float:
        """1 - |b|/|a|, negative never: counted along the stronger wave."""
        small, large = sorted((abs(self.forward), abs(self.backward)))
        return 1.0 - small / large


def two_wave_fit(x_m: FloatArray, displacement: ComplexArray, guess: float) -> TwoWaves:
    """Fit both waves and their wavenumber by least squares.

    The wavenumber is searched within a factor of 1.5 of a guess. Near fields of ends and patches stay in the residual.

    Parameters
    ----------
    x_m : ndarray, shape (p,)
        Points along the line.
    displacement : ndarray, shape (p,)
        Complex field there.
    guess : float
        Wavenumber in rad/m.

    Returns
    -------
    TwoWaves
        Amplitudes in the field's unit, wavenumber and relative residual.

    Raises
    ------
    SolverError
        If there are fewer than MIN_COUNT points, or the field is zero everywhere.
    """
    if len(x_m) < MIN_COUNT or not np.abs(displacement).any():
        raise SolverError(f"a two-wave fit needs {MIN_COUNT} points of a field that is not zero, {len(x_m)} came")
    size = float(np.linalg.norm(displacement))

    def fit(k: float) -> tuple[ComplexArray, float]:
        basis = np.exp(np.outer(x_m, [-1j * k, 1j * k]))
        amplitudes = np.asarray(np.linalg.lstsq(basis, displacement, rcond=None)[0], dtype=np.complex128)
        return amplitudes, float(np.linalg.norm(displacement - basis @ amplitudes)) / size

    grid = guess * np.geomspace(1.0 / 1.5, 1.5, 41)
    best = int(np.argmin([fit(float(k))[1] for k in grid]))
    bounds = (float(grid[max(best - 1, 0)]), float(grid[min(best + 1, 40)]))
    minimum = minimize_scalar(lambda k: fit(k)[1], bounds=bounds, method="bounded", options={"xatol": 1e-9 * guess})
    amplitudes, residual = fit(float(minimum.x))
    return TwoWaves(complex(amplitudes[0]), complex(amplitudes[1]), float(minimum.x), residual)


def best_travelling_drive(field: ComplexArray, x_m: FloatArray, guess: float) -> tuple[ComplexArray, float]:
    """Search for the voltages of the largest TWR, with amplitude and phase of every actuator free.

    The search starts from least-squares fits of waves e^{-ikx} around a guess of k, then raises the smallest amplitude while
    the largest stays 1. The problem is not convex: the value is attained, but a larger one cannot be excluded.

    Parameters
    ----------
    field : ndarray, shape (p, a)
        Displacement per volt.
    x_m : ndarray, shape (p,)
        Places.
    guess : float
        Wavenumber k, in rad/m.

    Returns
    -------
    voltages : ndarray, shape (a,)
        Complex voltages, scaled.
    ratio : float
        Their TWR, dimensionless.
    """
    scaled = field / np.abs(field).max()
    starts = []
    for k in guess * np.geomspace(1.0 / 1.4, 1.4, 21):
        voltages = np.linalg.lstsq(scaled, np.exp(-1j * k * x_m), rcond=None)[0]
        starts.append((travelling_wave_ratio(scaled @ voltages), voltages))
    starts.sort(key=lambda one: -one[0])
    candidates = [_raised(scaled, voltages) for _, voltages in starts[:4]] + [voltages for _, voltages in starts[:1]]
    best = max(candidates, key=lambda voltages: travelling_wave_ratio(scaled @ voltages))
    return best, travelling_wave_ratio(scaled @ best)


def _raised(field: ComplexArray, start: ComplexArray) -> ComplexArray:
    """Maximise t with t <= |w(x)|^2 <= 1 at every point, from a start, by sequential quadratic programming."""
    size = field.shape[1]
    unit = start / np.abs(field @ start).max()
    real = np.hstack([field.real, -field.imag])
    imag = np.hstack([field.imag, field.real])

    def squares(x: FloatArray) -> FloatArray:
        return np.asarray((real @ x[:-1]) ** 2 + (imag @ x[:-1]) ** 2)

    def slopes(x: FloatArray) -> FloatArray:
        return np.asarray(2.0 * ((real @ x[:-1])[:, None] * real + (imag @ x[:-1])[:, None] * imag))

    ones = np.ones((len(field), 1))
    room = [
        {"type": "ineq", "fun": lambda x: squares(x) - x[-1], "jac": lambda x: np.hstack([slopes(x), -ones])},
        {"type": "ineq", "fun": lambda x: 1.0 - squares(x), "jac": lambda x: np.hstack([-slopes(x), 0.0 * ones])},
    ]
    x0 = np.concatenate([unit.real, unit.imag, [float(np.abs(field @ unit).min()) ** 2]])
    ascent = np.zeros(2 * size + 1)
    ascent[-1] = -1.0
    optimum = minimize(
        lambda x: -x[-1], x0, jac=lambda _: ascent, constraints=room, method="SLSQP", options={"maxiter": 200}
    )
    return np.asarray(optimum.x[:size] + 1j * optimum.x[size:-1])


# -- pairs of modes ----------------------------------------------------------------------------------------------------
# Several modes held at once, and two of them a quarter period apart: a travelling wave inside a zone.
# Two shapes that look like cos kx and sin kx inside the zone, held with amplitudes in the ratio of their sizes and 90
# degrees apart, give w = cos kx - i sin kx = e^{-ikx}. Driven at one frequency between their own; the other modes are
# kept small.


def hold_modes(table: ModalTable, frequency_hz: float, held: dict[int, complex], others: float = 1.0) -> Drive:
    """Find the voltages that give modal coordinates and keep those of all other modes small, by least squares.

    Parameters
    ----------
    table : ModalTable
        Modes and actuators.
    frequency_hz : float
        Frequency of the drive.
    held : dict of int to complex
        Amplitude of each held mode, in sqrt(kg) m.
    others : float, optional
        Weight of the other modes relative to 1; 0 leaves them free.

    Returns
    -------
    Drive
        Voltages and relative residual.

    Raises
    ------
    SolverError
        For an unknown mode, a mode that no actuator drives, or a negative weight; as `drive_voltages` and
        `modal_drive`.
    """
    count = table.frequencies_hz.size
    for mode in held:
        if not 0 <= mode < count:
            raise SolverError(f"mode {mode}: the table has modes 0 to {count - 1}")
        if not np.abs(table.actuators[mode]).max() > 1e-9 * np.abs(table.actuators).max():
            raise SolverError(f"mode {mode}: every actuator sits on a node of it, it cannot be held")
    if not (np.isfinite(others) and others >= 0.0):
        raise SolverError(f"others = {others:g}: must be 0 or more")
    named = np.array(list(held), dtype=int)
    kept = np.arange(count) if others else named
    target = np.zeros(count, dtype=complex)
    target[named] = list(held.values())
    weight = np.full(count, others)
    weight[named] = 1.0
    matrix = weight[:, None] * modal_drive(table, frequency_hz)
    return drive_voltages(matrix[kept], target[kept])


@dataclass(frozen=True)
class ModePair:
    """Two modes held a quarter period apart: drive, field (p,) in m, twr inside the zone, wavenumber along x in rad/m.

    alone: TWR of the pure sum of the two shapes, what perfect holding would give. A field that moves in step with even
    amplitude has a TWR of 1 too, so read it with the wavenumber: 0 where nothing travels, as for shapes of one symmetry.
    """

    modes: tuple[int, int]
    frequency_hz: float
    drive: Drive
    field: ComplexArray
    twr: float
    alone: float
    wavenumber: float


def travelling_pair(table: ModalTable, modes: tuple[int, int], inside: BoolArray, others: float = 1.0) -> ModePair:
    """Hold two modes 90 degrees apart with equal rms over points along a line of the zone.

    The frequency is the geometric mean of both; the pure sum of the two runs towards +x.

    Parameters
    ----------
    table : ModalTable
        Modes, actuators and points.
    modes : tuple of int
        Numbers of the two modes.
    inside : ndarray of bool, shape (p,)
        Points along the line.
    others : float, optional
        Weight of the other modes relative to 1.

    Returns
    -------
    ModePair
        Drive, field, TWR and wavenumber.

    Raises
    ------
    SolverError
        For the same mode twice, fewer than 8 points inside, or a mode without motion there; as `hold_modes`.
    """
    first, second = modes
    if first == second:
        raise SolverError("a travelling wave takes two different modes")
    if inside.sum() < 8:
        raise SolverError(f"{int(inside.sum())} points lie inside: 8 or more are needed")
    frequency_hz = float(np.sqrt(np.prod(table.frequencies_hz[list(modes)])))
    sizes = np.sqrt(np.mean(table.field[list(modes)][:, inside] ** 2, axis=1))
    if not sizes.min() > 1e-9 * np.abs(table.field).max():
        raise SolverError("one of the two modes does not move inside the zone")
    amplitudes = {first: complex(1.0 / sizes[0]), second: -1j / complex(sizes[1])}
    if _turning(table, _sum(table, amplitudes), inside) < 0.0:
        amplitudes[second] *= -1.0
    drive = hold_modes(table, frequency_hz, amplitudes, others)
    field = field_matrix(table, frequency_hz) @ drive.voltages
    return ModePair(
        modes=modes,
        frequency_hz=frequency_hz,
        drive=drive,
        field=field,
        twr=travelling_wave_ratio(field[inside]),
        alone=travelling_wave_ratio(_sum(table, amplitudes)[inside]),
        wavenumber=_turning(table, field, inside),
    )


def _sum(table: ModalTable, amplitudes: dict[int, complex]) -> ComplexArray:
    return np.asarray(np.array(list(amplitudes.values())) @ table.field[list(amplitudes)])


def _turning(table: ModalTable, field: ComplexArray, inside: BoolArray) -> float:
    """Mean -d(phase)/dx along the first coordinate, rad/m: above 0 for a wave towards +x."""
    x = table.points_m[inside, 0]
    order = np.argsort(x)
    phase = np.unwrap(np.angle(field[inside][order]))
    return float(-np.polyfit(x[order], phase, 1)[0])
