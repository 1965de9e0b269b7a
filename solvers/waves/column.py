"""One column of reduced cells across the plate, repeated along x with a phase: the plate as the wanted wave sees it.

K(k) and M(k) of the column are the cells' own, their sides x-, x+ tied by exp(i k p_x), their edges shared along y; the
mirror y = 0 halves it where the plate has one zone. What it leaves out is the plate's two ends; it costs one column instead of
all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf, isnan, pi

import numpy as np
from scipy.linalg import eigh

from geometry.elements import ComplexArray, FloatArray, IntArray
from geometry.hex.boxes import Panel
from geometry.layout import Design
from solvers.errors import SolverError
from solvers.measures.confinement import Confinement, Profile, measure_profile
from solvers.measures.driven_zones import BESIDE, DrivenZones, drive_zones
from solvers.measures.mode_mixing import Overlaps
from solvers.superelement.build import Reductions
from solvers.superelement.cell import Cell
from solvers.superelement.plate_error import ModeErrors
from solvers.superelement.tiling import DIGITS, tile
from solvers.threads import one_thread
from solvers.waves.column_error import forced_bars, mode_errors
from solvers.waves.evanescent import Row


@dataclass(frozen=True)
class ColumnModes:
    """Modes with u_z even about y = 0, ascending: frequency_hz (k,) and how well each is confined."""

    frequency_hz: FloatArray
    confinement: Confinement


@dataclass(frozen=True)
class Driven:
    """All modes, and the confinement (n,) in dB of the forced motion at each frequency asked for.

    errors: estimates those of the modes' frequencies. bar_db: gives the half-widths (n,) of the bars of the levels from
    relative half-widths (k,) of those frequencies and the expected share of the bound on the modes' mixing; mixing_db: bounds
    what mixing moves a mode's own level by, from its number and the relative half-width of its frequency's.
    """

    modes: ColumnModes
    confinement_db: FloatArray
    errors: Callable[[], ModeErrors]
    bar_db: Callable[[FloatArray, float], FloatArray]
    mixing_db: Callable[[int, float], float]


@dataclass(frozen=True)
class _PlacedCell:
    """A panel's row of cells, the y of its middle (m), its degrees of freedom among the column's (-1 where nothing moves)."""

    row: Row
    middle: float
    dofs: IntArray
    copies: int = 1

    @property
    def cell(self) -> Cell:
        """The cell of the row."""
        return self.row.cell


class Column:
    """The panels of one pitch along x, assembled at a wavenumber along x in rad/m: with y >= 0 of a plate of one zone, all with
    several.
    """

    def __init__(self, design: Design, reductions: Reductions, kx_per_m: float) -> None:
        self.design, self.kx = design, kx_per_m
        self.panels = column_panels(design, reductions.reduction.max_edge_m)
        alike = [_centred(panel) for panel in self.panels]
        rows = {panel: Row(reductions.cell(panel), kx_per_m) for panel in dict.fromkeys(alike)}
        self.rows = [rows[panel] for panel in alike]
        self.placed_cells, self.dof = self._places()
        self.scale = self.rows[0].cell.scale

    def _places(self) -> tuple[list[_PlacedCell], int]:
        """Numbers of [lower edge, upper edge, inner] of every panel; edges are shared."""
        edge, placed = self.rows[0].edge, []
        lower = np.arange(edge)
        if self.design.zones == 1:
            lower[1::3] = -1  # u_y vanishes on the mirror
        if "y-" in self.panels[0].free:
            lower[self.rows[0].cell.interface.vertex_block :] = -1
        lower[lower >= 0] = np.arange(np.count_nonzero(lower >= 0))
        start = int(np.count_nonzero(lower >= 0))
        for panel, row in zip(self.panels, self.rows, strict=True):
            upper = start + np.arange(edge)
            if "y+" in panel.free:  # what would follow a foot flush with the plate's edge carries nothing
                upper[row.cell.interface.vertex_block :] = -1
            start += int(np.count_nonzero(upper >= 0))
            inner = start + np.arange(row.inner)
            start += row.inner
            placed.append(_PlacedCell(row, (panel.low[1] + panel.high[1]) / 2.0, np.concatenate([lower, upper, inner])))
            lower = upper
        return placed, start

    def pencil(self) -> tuple[ComplexArray, ComplexArray]:
        """Hermitian K and M, (dof, dof) each."""
        stiffness, mass = (np.zeros((self.dof,) * 2, dtype=complex) for _ in range(2))
        for place in self.placed_cells:
            live = np.flatnonzero(place.dofs >= 0)
            here = np.ix_(place.dofs[live], place.dofs[live])
            stiffness[here] += place.row.stiffness[np.ix_(live, live)]
            mass[here] += place.row.mass[np.ix_(live, live)]
        return stiffness, mass

    def modes(self, low_hz: float, high_hz: float) -> ColumnModes:
        """Every mode with low <= f <= high, Hz, and how well it is confined. Errors as solve."""
        frequency_hz, vectors = self.solve(low_hz, high_hz)
        return ColumnModes(frequency_hz, measure_profile(self.profile(vectors), self.design))

    def zones(self, low_hz: float, high_hz: float, quality_factor: float) -> DrivenZones:
        """Zones of a plate of several driven in turn at their peaks within a window, by its modes and those somewhat beyond.
        Errors as solve and drive_zones.
        """
        frequency_hz, vectors = self.solve(BESIDE[0] * low_hz, BESIDE[1] * high_hz)
        return drive_zones(self.design, frequency_hz, self.profile(vectors), (low_hz, high_hz), quality_factor)

    def cell_vectors(self, placed_cell: _PlacedCell, vectors: ComplexArray) -> ComplexArray:
        """A cell's degrees of freedom (cell dof, k) from the column's (dof, k)."""
        live = placed_cell.dofs[:, None] >= 0
        return np.asarray(placed_cell.row.transform @ np.where(live, vectors[np.maximum(placed_cell.dofs, 0)], 0.0))

    def driven(self, frequencies_hz: FloatArray, quality_factor: float) -> Driven:
        """Motion forced by a pressure of the wanted shape on the zone: (K (1 + i/Q) - omega^2 M) u = f, by all modes.

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
            return Overlaps.between(parts).mixing_db(tones_hz, index, error)

        modes = ColumnModes(tones_hz, measure_profile(own, self.design))
        errors = lambda: mode_errors(self, self.pencil(), stiff, vectors)  # noqa: E731
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
            touch = place.row.cell.touch.rule([line - place.middle for line in self.design.touch_lines_m])
            local = np.where(place.dofs[:, None] >= 0, vectors[np.maximum(place.dofs, 0)], 0.0)
            motion = place.row.transform @ local
            values.append(touch.values(motion.real) + 1j * touch.values(motion.imag))
            y = touch.points[:, 1] + place.middle
            places.append(y)
            weights.append(touch.weights)
            across = np.cos(pi * self.design.from_zone_m(y) / self.design.width_m)
            shapes.append(np.exp(1j * self.kx * touch.points[:, 0]) * across)
        y_m, area_m2, moved, wanted = (np.concatenate(part) for part in (places, weights, values, shapes))
        return Profile(y_m, area_m2, moved, wanted, self.scale.mass_kg)


def column_panels(design: Design, max_edge_m: float) -> list[Panel]:
    """The panels of one column along y, of one zone from its middle outwards. SolverError unless these part at y = 0."""
    width = max_edge_m if isnan(design.pitch_x_m) or not design.rows else design.pitch_x_m
    lines, one = tile(design, max_edge_m).y.tolist(), design.zones == 1
    if one:
        lines = [y for y in lines if y > -(10.0**-DIGITS)]
    if one and lines[0] > 10.0**-DIGITS:
        raise SolverError("the plate's panels do not part at its middle line: a column cannot be halved there")
    feet = (design.row_centres() if one else design.row_places()) if design.rows else np.empty(0)
    own = dict(zip(feet.tolist(), design.graded, strict=False))
    panels = []
    for low, high in pairwise(lines):
        inside = feet[(feet > low) & (feet < high)]
        foot = (0.0, float(inside[0])) if len(inside) else None
        ends = {"y-": not one and low == lines[0], "y+": high == lines[-1]}
        free = tuple(side for side, at_end in ends.items() if foot and at_end)
        even = foot is None or (abs(foot[1] - (low + high) / 2.0) < 10.0**-DIGITS and not free)
        sides = (-width / 2.0, low), (width / 2.0, high)
        panels.append(Panel(*sides, foot, (0, 1) if even else (0,), free, own.get(foot[1]) if foot else None))
    return panels


def _centred(panel: Panel) -> Panel:
    """The same panel with its middle at the origin: equal panels are then equal."""
    middle = panel.middle[1]
    low, high = (round(edge - middle, 12) for edge in (panel.low[1], panel.high[1]))
    foot = (0.0, round(panel.foot[1] - middle, 12)) if panel.foot else None
    return replace(panel, low=(panel.low[0], low), high=(panel.high[0], high), foot=foot)
