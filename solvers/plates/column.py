"""One column of reduced cells across the plate, repeated along x with a phase, and the error bars of its modes and levels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf, isnan, log, pi
from typing import Any, ClassVar

import numpy as np
from scipy.linalg import eigh

from geometry.elements import BoolArray, ComplexArray, FloatArray, IntArray
from geometry.layout import Design
from geometry.tiling import DIGITS, Panel, tile
from solvers.accuracy.reduction import (
    EDGE_LAYER,
    Assembly,
    ModeErrors,
    by_mesh,
    by_modes,
    energy,
    last_bubbles,
    last_layer,
)
from solvers.errors import SolverError
from solvers.measures.confinement import (
    BESIDE,
    AcrossModes,
    DrivenZones,
    Overlaps,
    Profile,
    drive_zones,
    measure_profile,
)
from solvers.plates.assembled import Reductions
from solvers.superelement.cell import Cell
from solvers.superelement.lattice import Periodic
from solvers.threads import one_thread
from solvers.waves.complex_bands import Row

# -- levels within bars of frequencies ---------------------------------------------------------------------------------
# Error bars of levels over frequency: what a level may change by while frequencies lie anywhere within their bars.
# A cell whose frequencies err by at most e, relative, has at f the level that the exact one has somewhere from f (1 -
# e) to f (1 + e): the bar is the largest change over that interval, which near an edge or a resonance is not the
# slope times its width.

BENT = 0.5  # of the larger of two neighbouring steps: where they differ by more, the samples do not resolve the curve
FLAT_DB = 1e-3
ENDS = (-1.0, 1.0)  # of the interval, where the level is looked up: computed for a curve that bends
PROBES = 9  # places in an interval wider than the step between samples: a peak between these is seen
Level = Callable[[float], float | None]


def level_bars(frequency_hz: FloatArray, level_db: FloatArray, error: float | None, level: Level) -> list[float | None]:
    """Bound the error of levels by the relative error of frequencies.

    Parameters
    ----------
    frequency_hz, level_db : ndarray, shape (n,)
        The samples, ascending in frequency; NaN for no level.
    error : float or None
        Relative error bar of the frequencies, dimensionless; None without an estimate.
    level : callable
        Returns the level in dB at a frequency in Hz; called where the samples do not resolve the curve.

    Returns
    -------
    list of float or None
        Half-widths in dB; None where there is no level or no estimate.
    """
    if error is None or not np.isfinite(error):
        return [None] * len(level_db)
    bent = _bent(level_db)
    return [
        None if np.isnan(own) else _bar(frequency_hz, level_db, index, error, level if bent[index] else None)
        for index, own in enumerate(level_db)
    ]


def _bent(level_db: FloatArray) -> BoolArray:
    """Samples next to which the curve bends, (n,): its steps differ there, or a neighbour is missing."""
    if len(level_db) < 3:
        return np.ones(len(level_db), dtype=bool)
    step = np.diff(level_db)
    larger = np.maximum(np.abs(step[1:]), np.abs(step[:-1]))
    there = np.isnan(larger) | ((np.abs(np.diff(step)) > BENT * larger) & (larger > FLAT_DB))
    bent = np.concatenate([[there[0]], there, [there[-1]]])
    return np.asarray(bent | np.append(bent[1:], False) | np.append(False, bent[:-1]))


def _bar(frequency_hz: FloatArray, level_db: FloatArray, index: int, error: float, level: Level | None) -> float | None:
    own, at = float(level_db[index]), float(frequency_hz[index])
    inside = level_db[np.abs(frequency_hz - at) <= error * at]
    few = (
        len(inside) < PROBES
        and level is not None
        and 2.0 * error * at > float(np.diff(frequency_hz).min(initial=np.inf))
    )
    ends = [at * (1.0 + end * error) for end in (np.linspace(*ENDS, PROBES) if few else ENDS)]
    if level is None:
        others = [_extrapolated(frequency_hz, level_db, end) for end in ends]
    else:
        others = [np.nan if (found := level(end)) is None else found for end in ends]
    changes = np.abs(np.concatenate([inside, others]) - own)
    return None if np.isnan(changes).any() else float(changes.max())


def _extrapolated(frequency_hz: FloatArray, level_db: FloatArray, at_hz: float) -> float:
    """The level between samples, and on the line through the last two beyond them."""
    index = int(np.clip(np.searchsorted(frequency_hz, at_hz) - 1, 0, len(frequency_hz) - 2))
    share = (at_hz - frequency_hz[index]) / (frequency_hz[index + 1] - frequency_hz[index])
    return float(level_db[index] + share * (level_db[index + 1] - level_db[index]))


# -- errors of a column ------------------------------------------------------------------------------------------------
# Error bars of a column of cells: of its modes' frequencies, and of the level of its forced motion.
# Frequencies: as those of an assembled plate (`solvers.accuracy.reduction`), summed over the column's cells. Levels: the exact
# stiffness differs from the column's by d with |d_jj| <= 2 e_j l_j, l_j the eigenvalue of mode j and e_j the relative
# bar of its frequency, and |d_ij| <= 2 e_j w_i w_j. Each d_jj changes the modal amplitude s_j = f_j / (l_j (1 + i/Q)
# - l), by much near a resonance; each d_ij adds d_ij s_j / (l_i (1 + i/Q) - l) to that of mode i, of which a
# calibrated share is expected.

DECIBELS = 20.0 / log(10.0)
MOST = 0.45  # relative: eigenvalues stay positive


def _mode_errors(
    column: Assembly, pencil: tuple[ComplexArray, ComplexArray], value: FloatArray, vectors: ComplexArray
) -> ModeErrors:
    """Estimate the errors of M-orthonormal modes (dof, k) of a column and its K and M with scaled eigenvalues (k,).

    What they lose by discarded fixed-interface modes is l u^H D u / 2, D the residual flexibility; what the last degree on the
    sides brought bounds the next ones, as that through the thickness does where cells know further ones.
    """
    with np.errstate(invalid="ignore"):
        modes = by_modes(column, value, vectors)
    modes = np.nan_to_num(modes, nan=np.inf, posinf=np.inf)
    along, layer = (_brought(column, pencil, value, vectors, part) for part in (last_bubbles, last_layer))
    through = layer if any(place.cell.further for place in column.placed_cells) else EDGE_LAYER * layer
    return ModeErrors(modes, along, through, *by_mesh(column, value, vectors, 1.0))


def _brought(
    column: Assembly,
    pencil: Sequence[ComplexArray],
    value: FloatArray,
    vectors: ComplexArray,
    part: Callable[[Cell], IntArray],
) -> FloatArray:
    """Relative rise of each frequency without some functions of every cell, to first order, (k,)."""
    where = np.unique(np.concatenate([place.dofs[place.columns[part(place.cell)]] for place in column.placed_cells]))
    where = where[where >= 0]
    stiff, heavy = (energy(vectors[where], matrix[np.ix_(where, where)] @ vectors[where]) for matrix in pencil)
    moving, rise = value > 0.0, np.zeros_like(value)
    rise[moving] = np.maximum(stiff - value * heavy, 0.0)[moving] / (2.0 * value[moving])
    return rise


def forced_bars(
    parts: Sequence[tuple[Any, Any]],
    force: ComplexArray,
    value: FloatArray,
    moved: FloatArray,
    quality_factor: float,
    error: FloatArray,
    mixed: float,
) -> FloatArray:
    """Bound the error of the level of one part over another in a motion forced on M-orthonormal modes.

    Parameters
    ----------
    parts : two of (weights (q,), values (q, k))
        Faces whose rms are compared: areas of their points, and the modes there.
    force, value : ndarray, shape (k,)
        Modal forces and scaled eigenvalues.
    moved : ndarray, shape (t,)
        Scaled eigenvalues of the driving frequencies.
    quality_factor : float
        Of every mode, dimensionless.
    error : ndarray, shape (k,)
        Relative error bars of the frequencies.
    mixed : float
        Expected fraction of the bound on the mixing of modes.

    Returns
    -------
    ndarray, shape (t,)
        Half-widths in dB.
    """
    lossy = 1.0 + 1j / quality_factor
    stiff, error = value[:, None] * lossy, np.minimum(error, MOST)
    share = force[:, None] / (stiff - moved)
    projected = [values.conj().T @ (weights[:, None] * (values @ share)) for weights, values in parts]
    own = [np.einsum("q,qk->k", weights, np.abs(values) ** 2)[:, None] for weights, values in parts]
    squares = [np.maximum(np.einsum("kt,kt->t", share.conj(), each).real, 1e-300) for each in projected]
    single = np.zeros_like(moved)
    for sign in (-1.0, 1.0):  # d_jj: each frequency at either end of its bar, the changes of all modes added
        change = force[:, None] / ((1.0 + sign * error[:, None]) ** 2 * stiff - moved) - share
        grown = [
            np.maximum(1.0 + (2.0 * (change.conj() * each).real + np.abs(change) ** 2 * norm) / whole, 1e-12)
            for each, norm, whole in zip(projected, own, squares, strict=True)
        ]
        single = np.maximum(single, DECIBELS / 2.0 * np.abs(np.log(grown[0] / grown[1])).sum(axis=0))
    # d_ij: the amplitudes that all other modes add to each, by the root of their squares
    source = 2.0 * error[:, None] * np.sqrt(np.abs(value))[:, None] * np.abs(share)
    others = np.sqrt(np.maximum((source**2).sum(axis=0) - source**2, 0.0))
    added = np.sqrt(np.abs(value))[:, None] * others / np.abs(stiff - moved)
    unlike = np.abs(projected[0] / squares[0] - projected[1] / squares[1])
    return np.asarray(single + mixed * DECIBELS * np.linalg.norm(added * unlike, axis=0))


# -- column ------------------------------------------------------------------------------------------------------------
# One column of reduced cells across the plate, repeated along x with a phase: the plate as the target wave sees it.
# K(k) and M(k) of the column are the cells' own, their sides x-, x+ tied by exp(i k p_x), their edges shared along y;
# the mirror y = 0 halves it where the plate has one zone. What it leaves out is the plate's two ends; it costs one
# column instead of all. A row of oblique cells ends further along x than it begins, and the strips beyond follow it: their
# motion is counted without the phase of that shift, so that edges are shared as in a straight column.


@dataclass(frozen=True)
class Driven:
    """All modes, and the confinement (n,) in dB of the forced motion at each frequency asked for.

    errors: estimates those of the modes' frequencies. bar_db: gives the half-widths (n,) of the bars of the levels from
    relative half-widths (k,) of those frequencies and the expected share of the bound on the modes' mixing; mixing_db: bounds
    what mixing moves a mode's own level by, from its number and the relative half-width of its frequency's.
    """

    modes: AcrossModes
    confinement_db: FloatArray
    errors: Callable[[], ModeErrors]
    bar_db: Callable[[FloatArray, float], FloatArray]
    mixing_db: Callable[[int, float], float]


@dataclass(frozen=True)
class _PlacedCell:
    """A cell of a row, the y of its middle (m), the row's degrees of freedom among the column's (-1 where nothing moves)."""

    row: Row
    middle: float
    dofs: IntArray
    index: int = 0
    copies: int = 1
    softened: ClassVar[float | None] = None  # a column has free edges

    @property
    def cell(self) -> Cell:
        """The cell."""
        return self.row.periodic.cells[self.index]

    @property
    def columns(self) -> IntArray:
        """Which of the row's degrees of freedom each of the cell's follows, (cell dof,)."""
        ties = self.row.periodic.ties
        return ties.open_column[ties.starts[self.index] : ties.starts[self.index + 1]]


class Column:
    """The panels of one pitch along x, assembled at a wavenumber along x in rad/m: with y >= 0 of a plate of one zone, all with
    several. panels: how many there are in a pitch; by default as few as the rows allow. joined: whether rows at the plate's
    edge keep the functions of their outer sides.
    """

    def __init__(
        self, design: Design, reductions: Reductions, kx_per_m: float, panels: int | None = None, joined: bool = False
    ) -> None:
        self.design, self.kx = design, kx_per_m
        self.strips = column_strips(design, reductions.reduction.max_edge_m, panels)
        if joined:
            self.strips = [tuple(replace(panel, free=()) for panel in strip) for strip in self.strips]
        alike = [tuple(map(_centred, strip)) for strip in self.strips]
        rows = {strip: Row(Periodic(list(map(reductions.cell, strip))), kx_per_m) for strip in dict.fromkeys(alike)}
        self.rows = [rows[strip] for strip in alike]
        self.placed_cells, self.dof = self._places()
        self.scale = self.rows[0].cell.scale

    def _places(self) -> tuple[list[_PlacedCell], int]:
        """Numbers of [lower edge, upper edge, inner] of every panel; edges are shared."""
        placed: list[_PlacedCell] = []
        live = self._live("y-", 0)
        if self.design.zones == 1:
            live[1::3] = False  # u_y vanishes on the mirror
        lower, start = _numbered(live, 0)
        for number, (strip, row) in enumerate(zip(self.strips, self.rows, strict=True)):
            upper, start = _numbered(self._live("y+", number), start)
            inner = start + np.arange(row.inner)
            start += row.inner
            dofs = np.concatenate([lower, upper, inner])
            placed += [_PlacedCell(row, panel.middle[1], dofs, index) for index, panel in enumerate(strip)]
            lower = upper
        return placed, start

    def _live(self, side: str, number: int) -> BoolArray:
        """Which of an edge's degrees of freedom move: what would follow feet flush with the plate's edge carries nothing."""
        face = self.rows[number].cell.interface
        along = np.arange(face.vertex_block + face.side_block) >= face.vertex_block
        return np.concatenate(
            [~along if side in panel.free else np.full(len(along), True) for panel in self.strips[number]]
        )

    def pencil(self) -> tuple[ComplexArray, ComplexArray]:
        """Hermitian K and M, (dof, dof) each."""
        stiffness, mass = (np.zeros((self.dof,) * 2, dtype=complex) for _ in range(2))
        for place in (each for each in self.placed_cells if each.index == 0):
            live = np.flatnonzero(place.dofs >= 0)
            here = np.ix_(place.dofs[live], place.dofs[live])
            stiffness[here] += place.row.stiffness[np.ix_(live, live)]
            mass[here] += place.row.mass[np.ix_(live, live)]
        return stiffness, mass

    def modes(self, low_hz: float, high_hz: float) -> AcrossModes:
        """Every mode with low <= f <= high, Hz, and how well it is confined. Errors as solve."""
        frequency_hz, vectors = self.solve(low_hz, high_hz)
        return AcrossModes(frequency_hz, measure_profile(self.profile(vectors), self.design))

    def zones(self, low_hz: float, high_hz: float, quality_factor: float) -> DrivenZones:
        """Zones of a plate of several driven in turn at their peaks within a window, by its modes and those somewhat beyond.
        Errors as solve and drive_zones.
        """
        frequency_hz, vectors = self.solve(BESIDE[0] * low_hz, BESIDE[1] * high_hz)
        return drive_zones(self.design, frequency_hz, self.profile(vectors), (low_hz, high_hz), quality_factor)

    def cell_vectors(self, placed_cell: _PlacedCell, vectors: ComplexArray) -> ComplexArray:
        """A cell's degrees of freedom (cell dof, k) from the column's (dof, k)."""
        live, row = placed_cell.dofs[:, None] >= 0, placed_cell.row
        _, transform = row.periodic.parts(row.transform)[placed_cell.index]
        return np.asarray(transform @ np.where(live, vectors[np.maximum(placed_cell.dofs, 0)], 0.0))

    def driven(self, frequencies_hz: FloatArray, quality_factor: float) -> Driven:
        """Motion forced by a pressure of the target shape on the zone: (K (1 + i/Q) - omega^2 M) u = f, by all modes.

        SolverError as solve.
        """
        tones_hz, vectors = self.solve(-1.0, inf)
        own = self.profile(vectors)
        pressed = np.where(np.abs(own.y_m) < self.design.width_m / 2.0, own.weights * own.shape, 0.0)
        force = own.values.conj().T @ pressed
        stiff, moved = (np.array([self.scale.eigenvalue(f) for f in tones]) for tones in (tones_hz, frequencies_hz))
        shares = force[:, None] / (stiff[:, None] * (1.0 + 1j / quality_factor) - moved)
        forced = measure_profile(replace(own, values=own.values @ shares), self.design)
        active = np.abs(own.y_m) < self.design.width_m / 2.0
        parts = [(own.weights[part], own.values[part]) for part in (active, ~active)]

        def bar_db(error: FloatArray, mixed: float) -> FloatArray:
            return forced_bars(parts, force, stiff, moved, quality_factor, error, mixed)

        def mixing_db(index: int, error: float) -> float:
            return Overlaps.between(own.weights * active, own.weights * ~active, own.values).mixing_db(
                tones_hz, index, error
            )

        modes = AcrossModes(tones_hz, measure_profile(own, self.design))
        errors = lambda: _mode_errors(self, self.pencil(), stiff, vectors)  # noqa: E731
        return Driven(modes, forced.confinement_db, errors, bar_db, mixing_db)

    def solve(self, low_hz: float, high_hz: float) -> tuple[FloatArray, ComplexArray]:
        """Frequencies (k,) in Hz within a window (all of them from below 0 to inf) and their vectors (dof, k); a dense solve
        misses none.

        SolverError where the mass is not positive.
        """
        stiffness, mass = self.pencil()
        every = low_hz < 0.0 and high_hz == inf
        window = {"subset_by_value": [self.scale.eigenvalue(low_hz), self.scale.eigenvalue(high_hz)], "driver": "gvx"}
        try:
            with one_thread():
                values, vectors = eigh(stiffness, mass, **({} if every else window))
        except np.linalg.LinAlgError as fault:
            raise SolverError(
                "the column's cells hold more boundary functions than their meshes can tell apart"
            ) from fault
        return self.scale.frequency(values), np.asarray(vectors)

    def profile(self, vectors: ComplexArray) -> Profile:
        """u_z of every mode on the touch face of the column, and exp(i k x) cos(pi y / W) there, y from the nearest zone."""
        places, weights, values, shapes = [], [], [], []
        for place in self.placed_cells:
            touch = place.cell.touch.rule([line - place.middle for line in self.design.touch_lines_m])
            motion = self.cell_vectors(place, vectors)
            values.append(touch.values(motion.real) + 1j * touch.values(motion.imag))
            y = touch.points[:, 1] + place.middle
            places.append(y)
            weights.append(touch.weights)
            across = np.cos(pi * self.design.from_zone_m(y) / self.design.width_m)
            lean_m = place.row.periodic.lattice.a2_m[0]  # a cell's middle is half of it beyond that of its lower edge
            x = touch.points[:, 0] + place.row.periodic.middles_m[place.index] + lean_m / 2.0
            shapes.append(np.exp(1j * self.kx * x) * across)
        y_m, area_m2, moved, target = (np.concatenate(part) for part in (places, weights, values, shapes))
        return Profile(y_m, area_m2, moved, target, self.scale.mass_kg)


def _numbered(live: BoolArray, start: int) -> tuple[IntArray, int]:
    """Numbers from a first one on of those that move, -1 for the others, and the next number."""
    return np.where(live, start - 1 + np.cumsum(live), -1), start + int(np.count_nonzero(live))


def column_strips(design: Design, max_edge_m: float, panels: int | None = None) -> list[tuple[Panel, ...]]:
    """List the panels of one column along y by strip; with one zone, from its middle outwards.

    With staggered rows, each pitch has two panels, with the pillar in one or the other. A row of an oblique lattice has a
    panel along its vectors, the first of them along x, with the pillar in its middle.

    Parameters
    ----------
    design : Design
        The plate, lengths in m.
    max_edge_m : float
        Largest panel edge.
    panels : int, optional
        Panels per pitch.

    Returns
    -------
    list of tuple of Panel
        One tuple per strip.

    Raises
    ------
    SolverError
        If a plate with one zone has no panel edge at y = 0, or the pillar of an oblique panel is not in its middle.
    """
    width = max_edge_m if isnan(design.pitch_x_m) or not design.rows else design.pitch_x_m
    count = (panels or 1 + design.is_staggered) if design.rows else 1
    lines, one = tile(design, max_edge_m).y.tolist(), design.zones == 1
    if one:
        lines = [y for y in lines if y > -(10.0**-DIGITS)]
    if one and lines[0] > 10.0**-DIGITS:
        raise SolverError("the plate's panels do not part at its middle line: a column cannot be halved there")
    feet = (design.row_centres() if one else design.row_places()) if design.rows else np.empty(0)
    own = dict(zip(feet.tolist(), design.graded, strict=False))
    strips = []
    for low, high in pairwise(lines):
        row = next((index for index, y in enumerate(feet.tolist()) if low < y < high), None)
        ends = {"y-": not one and low == lines[0], "y+": high == lines[-1]}
        at_end = tuple(side for side, ended in ends.items() if ended)
        half = width / count / 2.0
        strip = []
        for index in range(count):
            foot = (0.0, float(feet[row])) if row is not None and index == row % count else None
            free = at_end if foot else ()
            centred = foot is None or abs(foot[1] - (low + high) / 2.0) < 10.0**-DIGITS
            edges = design.oblique_m if foot else None
            if edges and not centred:
                raise SolverError("the pillars of oblique cells must be in the middle of their strips")
            halved = () if edges else (0, 1) if centred and not free else (0,)
            pillar = own.get(foot[1]) if foot else None
            strip.append(Panel((-half, low), (half, high), foot, halved, free, pillar, edges_m=edges))
        strips.append(tuple(strip))
    return strips


def _centred(panel: Panel) -> Panel:
    """The same panel with its middle at the origin: equal panels are then equal."""
    middle = panel.middle[1]
    low, high = (round(edge - middle, 12) for edge in (panel.low[1], panel.high[1]))
    foot = (panel.foot[0], round(panel.foot[1] - middle, 12)) if panel.foot else None
    return replace(panel, low=(panel.low[0], low), high=(panel.high[0], high), foot=foot)
