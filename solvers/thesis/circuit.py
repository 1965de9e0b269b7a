"""Mason's equivalent circuit of a bar with piezo cells, and the thesis' study of its band-reject filter."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import inf, pi, sqrt
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from geometry.elements import ComplexArray, FloatArray
from geometry.materials import MATERIALS, Material
from solvers.errors import SolverError, check_above_zero, check_bounded, checked_frequencies, solved
from solvers.measures.confinement import ratio_db

# -- circuit -----------------------------------------------------------------------------------------------------------
# Mason's equivalent circuit: a bar cut into cells, force as voltage, velocity as current; time factor e^{+j omega t}.
# A cell is a T of two arms j Z0 tan(Gl/2) and a shunt -j Z0/sin(Gl), the piezo force E0 in series with the shunt. Its
# chain matrix [[cos, j Z0 sin], [j sin/Z0, cos]](Gl) has no poles, so Gl = pi is harmless. Free ends are shorted,
# clamped ones open. Source: mason1948.

End = Literal["free", "clamped"]


@dataclass(frozen=True)
class Cell:
    """One piece of bar: length m, section m2, density kg/m3, stiffness Pa, loss factor of C (1 + j loss)."""

    length_m: float
    area_m2: float
    density_kg_m3: float
    stiffness_pa: float
    loss: float = 0.0

    def __post_init__(self) -> None:
        sizes = (self.length_m, self.area_m2, self.density_kg_m3, self.stiffness_pa)
        if not all(np.isfinite(size) and size > 0.0 for size in sizes) or not 0.0 <= self.loss < inf:
            raise SolverError(f"{self}: sizes must be finite and above 0, the loss 0 or more")

    @property
    def mass_kg(self) -> float:
        """rho A l, kg."""
        return self.density_kg_m3 * self.area_m2 * self.length_m

    @property
    def impedance(self) -> complex:
        """Z0 = A sqrt(rho C), N s/m."""
        return complex(self.area_m2 * np.sqrt(self.density_kg_m3 * self.stiffness_pa * (1.0 + 1j * self.loss)))

    def phase(self, omega: FloatArray) -> ComplexArray:
        """G l = omega l sqrt(rho/C), rad."""
        slow = np.sqrt(self.density_kg_m3 / (self.stiffness_pa * (1.0 + 1j * self.loss)))
        return np.asarray(omega * self.length_m * slow)

    def chain(self, omega: FloatArray) -> ComplexArray:
        """(V, I) at the left from (V, I) at the right, shape (n, 2, 2); with E0 both voltages count from E0."""
        phase, z0 = self.phase(omega), self.impedance
        c, s = np.cos(phase), 1j * np.sin(phase)
        return np.moveaxis(np.array([[c, z0 * s], [s / z0, c]]), -1, 0)


@dataclass(frozen=True)
class Filter:
    """Parallel L, C and R in series with the line: a mass L on a spring 1/C hung on the bar, R its losses.

    inductance_kg L, capacitance_m_n C, resistance_n_s_m R. Y = 1/(j omega L) + j omega C + 1/R vanishes at the rejected
    frequency 1/(2 pi sqrt(LC)) without losses.
    """

    inductance_kg: float
    capacitance_m_n: float
    resistance_n_s_m: float = inf

    def __post_init__(self) -> None:
        if not all(value > 0.0 for value in (self.inductance_kg, self.capacitance_m_n, self.resistance_n_s_m)):
            raise SolverError(f"{self}: L, C and R must be above 0")

    @property
    def rejected_hz(self) -> float:
        """1/(2 pi sqrt(LC)), Hz."""
        return 1.0 / (2.0 * pi * sqrt(self.inductance_kg * self.capacitance_m_n))

    def admittance(self, omega: FloatArray) -> ComplexArray:
        """Y, m/(N s), shape (n,)."""
        reactive = omega * self.capacitance_m_n - 1.0 / (omega * self.inductance_kg)
        return np.asarray(1j * reactive + 1.0 / self.resistance_n_s_m)


@dataclass(frozen=True)
class Line:
    """Cells from left to right, their two ends, filters by the number of the joint (1 between cells 1 and 2), forces E0.

    sources: one force per cell in N, 0 where no piezo drives.
    """

    cells: tuple[Cell, ...]
    left: End
    right: End
    sources: tuple[float, ...]
    filters: dict[int, Filter] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.cells or len(self.sources) != len(self.cells):
            raise SolverError("a line needs at least one cell and one source value per cell")
        if not {self.left, self.right} <= {"free", "clamped"}:
            raise SolverError(f"ends {self.left!r}, {self.right!r}: must be free or clamped")
        wrong = [joint for joint in self.filters if not 1 <= joint < len(self.cells)]
        if wrong:
            raise SolverError(f"filter at joint {wrong[0]}: must be from 1 to {len(self.cells) - 1}")


@dataclass(frozen=True)
class LineResponse:
    """Velocities (currents) at the cells + 1 joints, shape (n, cells + 1), m/s; forces on both sides, (n, cells, 2), N."""

    currents: ComplexArray
    voltages: ComplexArray


def nodal_response(line: Line, omega: ArrayLike) -> LineResponse:
    """Compute every force and velocity of a driven line from all circuit equations at once.

    Filters enter by their admittance, which is finite at the rejected frequency.

    Parameters
    ----------
    line : Line
        Cells, ends, sources and filters.
    omega : array_like, shape (n,)
        Angular frequencies in rad/s, or a single one.

    Returns
    -------
    LineResponse
        Complex velocities of the joints in m/s and forces in N.

    Raises
    ------
    SolverError
        If a lossless resonance is hit exactly, or a frequency is not above 0.
    """
    w = np.atleast_1d(checked_frequencies(omega))
    cells, size = len(line.cells), len(line.cells) + 1
    z0 = abs(line.cells[0].impedance)
    matrix = np.zeros((w.size, 3 * cells + 1, 3 * cells + 1), dtype=complex)
    load = np.zeros((w.size, 3 * cells + 1), dtype=complex)
    for k, (cell, source) in enumerate(zip(line.cells, line.sources, strict=True)):
        chain, row, v = cell.chain(w), 2 * k, size + 2 * k
        matrix[:, row, v], matrix[:, row, v + 1] = 1.0, -chain[:, 0, 0]
        matrix[:, row, k + 1] = -chain[:, 0, 1] / z0
        matrix[:, row + 1, k], matrix[:, row + 1, k + 1] = 1.0, -chain[:, 1, 1]
        matrix[:, row + 1, v + 1] = -chain[:, 1, 0] * z0
        load[:, row] = (1.0 - chain[:, 0, 0]) * source / z0
        load[:, row + 1] = -chain[:, 1, 0] * source
    for joint in range(1, cells):
        row, left = 2 * cells + joint - 1, size + 2 * joint - 1
        matrix[:, row, left], matrix[:, row, left + 1] = 1.0, -1.0
        if joint in line.filters:
            y = line.filters[joint].admittance(w) * z0
            scale = 1.0 / (1.0 + np.abs(y))
            matrix[:, row, left], matrix[:, row, left + 1] = y * scale, -y * scale
            matrix[:, row, joint] = -scale
    for row, end, current, voltage in ((-2, line.left, 0, size), (-1, line.right, cells, -1)):
        matrix[:, row, current if end == "clamped" else voltage] = 1.0
    solution = solved(matrix, load[:, :, None])[:, :, 0]
    currents = solution[:, :size]
    driven = (max(map(abs, line.sources)) or 1.0) / min(abs(one.impedance) for one in line.cells)
    check_bounded(np.abs(currents).max(axis=1) / driven, w)
    return LineResponse(currents, solution[:, size:].reshape(w.size, cells, 2) * z0)


def natural_frequencies_hz(line: Line, low_hz: float, high_hz: float, step_hz: float = 5.0) -> FloatArray:
    """Find the natural frequencies of a line without its losses: sign changes of the end condition.

    Parameters
    ----------
    line : Line
        Cells, ends and filters; sources have no effect.
    low_hz, high_hz : float
        Ends of the band, 0 < low < high.
    step_hz : float, optional
        Step of the scan; two frequencies within one step are missed.

    Returns
    -------
    ndarray, shape (k,)
        Frequencies in Hz, ascending.

    Raises
    ------
    SolverError
        If the band is empty.
    """
    if not 0.0 < low_hz < high_hz:
        raise SolverError(f"band {low_hz:g} to {high_hz:g} Hz: must be 0 < low < high")
    cells = tuple(replace(cell, loss=0.0) for cell in line.cells)
    filters = {joint: replace(one, resistance_n_s_m=inf) for joint, one in line.filters.items()}

    def mismatch(frequency: FloatArray) -> FloatArray:
        omega = 2.0 * pi * np.atleast_1d(frequency)
        state = np.zeros((omega.size, 2, 1), dtype=complex)
        state[:, 1 if line.right == "free" else 0] = 1.0
        for k in range(len(cells) - 1, -1, -1):
            state = cells[k].chain(omega) @ state
            if k in filters:
                # V changes by I/Y; times Y omega, which has no poles, over j, so that V and I stay real or imaginary
                y = filters[k].admittance(omega)[:, None] * omega[:, None]
                state = np.stack([y * state[:, 0] + omega[:, None] * state[:, 1], y * state[:, 1]], axis=1) / 1j
        end = state[:, 0, 0] if line.left == "free" else state[:, 1, 0]
        return np.asarray(end.real if line.left != line.right else end.imag, dtype=float)

    grid = np.arange(low_hz, high_hz + step_hz, step_hz)
    values = mismatch(grid)
    brackets = [(a, b) for (a, fa), (b, fb) in pairwise(zip(grid, values, strict=True)) if (fa < 0.0) != (fb < 0.0)]
    return np.array([brentq(lambda f: float(mismatch(np.array([f]))[0]), a, b, xtol=1e-9) for a, b in brackets])


# -- study -------------------------------------------------------------------------------------------------------------
# The band-reject filter on a bar of five cells: the confined mode is there with it and absent without it.


@dataclass(frozen=True)
class MasonData:
    """Cell and filter data; the thesis states none, these are ours. Five equal cells, the middle one driven by 1 N.

    target_hz: the mode to confine between the joints 1 and 4. The middle cell pushes both ways, so only the even modes of
    three clamped cells answer: the target is their second, c/(3 l), which sets the cells' length. area_m2: 10 x 2 mm.
    mass_ratio: filter mass over cell mass. quality_factor: of cells and of the filter's own losses.
    """

    target_hz: float = 25_000.0
    material: Material = MATERIALS["aluminium"]
    area_m2: float = 20e-6
    mass_ratio: float = 0.2
    quality_factor: float = 500.0

    @property
    def cell(self) -> Cell:
        """One cell: l = c/(3 f), c = sqrt(E/rho)."""
        length = sqrt(self.material.rod(0).young_pa / self.material.density_kg_m3) / (3.0 * self.target_hz)
        loss = 1.0 / self.quality_factor
        return Cell(length, self.area_m2, self.material.density_kg_m3, self.material.rod(0).young_pa, loss)

    @property
    def filter(self) -> Filter:
        """L = mass_ratio cell masses, C = 1/((2 pi f)^2 L), R = 2 pi f L Q."""
        mass, omega = self.mass_ratio * self.cell.mass_kg, 2.0 * pi * self.target_hz
        return Filter(mass, 1.0 / (omega**2 * mass), omega * mass * self.quality_factor)


@dataclass(frozen=True)
class MasonStudy:
    """Joint velocities over n frequencies for 1 N, m/s: three cells clamped (n, 4), five free without and with filter (n, 6).

    modes_hz: lossless natural frequencies in the window of the lines clamped, bare and filtered. confinement_db: rms velocity
    of the inner joints 2, 3 over that of the outer ones 0, 1, 4, 5 at the target, bare and filtered.
    """

    data: MasonData
    frequencies_hz: FloatArray
    clamped: ComplexArray
    bare: ComplexArray
    filtered: ComplexArray
    filter_impedance: ComplexArray
    modes_hz: dict[str, FloatArray]
    confinement_db: dict[str, float]


def mason_study(data: MasonData | None = None, frequencies_hz: FloatArray | None = None) -> MasonStudy:
    """Compute figures 1.24 to 1.27 of the thesis.

    Parameters
    ----------
    data : MasonData, optional
        Cells and filter; by default the study's own.
    frequencies_hz : ndarray, shape (n,), optional
        Window of the curves; by default from 0.04 to 1.6 times the target frequency.

    Returns
    -------
    MasonStudy
        Velocities, natural frequencies and confinement of the three lines.

    Raises
    ------
    SolverError
        If the target frequency, the quality factor or the mass ratio is not above 0.
    """
    data = MasonData() if data is None else data
    check_above_zero("target frequency in Hz", data.target_hz)
    if not (data.quality_factor > 0.0 and data.mass_ratio > 0.0):
        raise SolverError("quality factor and mass ratio must be above 0")
    if frequencies_hz is None:
        frequencies_hz = np.linspace(0.04, 1.6, 3121) * data.target_hz
    low, high = float(np.min(frequencies_hz)), float(np.max(frequencies_hz))
    free = {"bare": five_free(data, False), "filtered": five_free(data, True)}
    lines = {"clamped": three_clamped(data)} | free

    def currents(line: Line, frequencies: FloatArray | float) -> ComplexArray:
        return nodal_response(line, 2.0 * pi * frequencies).currents

    return MasonStudy(
        data=data,
        frequencies_hz=frequencies_hz,
        **{name: currents(line, frequencies_hz) for name, line in lines.items()},
        filter_impedance=1.0 / data.filter.admittance(2.0 * pi * frequencies_hz),
        modes_hz={
            name: natural_frequencies_hz(line, low, high, data.target_hz / 5000.0) for name, line in lines.items()
        },
        confinement_db={name: _confinement_db(currents(line, data.target_hz)[0]) for name, line in free.items()},
    )


def three_clamped(data: MasonData) -> Line:
    """Return the line of three cells with both ends clamped, the middle one driven by 1 N.

    Parameters
    ----------
    data : MasonData
        Data of the cells.

    Returns
    -------
    Line
        Line without filters.
    """
    return Line((data.cell,) * 3, "clamped", "clamped", (0.0, 1.0, 0.0))


def five_free(data: MasonData, filtered: bool) -> Line:
    """Return the line of five cells with both ends free, the middle one driven by 1 N.

    Parameters
    ----------
    data : MasonData
        Data of the cells and of the filter.
    filtered : bool
        Whether filters stand at the joints 1 and 4.

    Returns
    -------
    Line
        Line with or without filters.
    """
    filters = {1: data.filter, 4: data.filter} if filtered else {}
    return Line((data.cell,) * 5, "free", "free", (0.0, 0.0, 1.0, 0.0, 0.0), filters)


def _confinement_db(currents: ComplexArray) -> float:
    inner, outer = (np.sqrt(np.mean(np.abs(currents[part]) ** 2)) for part in ([2, 3], [0, 1, 4, 5]))
    return float(ratio_db(inner, outer))
