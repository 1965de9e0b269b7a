"""Columns of cells from the parametric cell: what the explorer drags and the search ranks designs by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import hypot, pi
from typing import NamedTuple

import numpy as np

from geometry.elements import FloatArray
from geometry.hex.panels import CLEAR, has_room
from geometry.hex.scenes import HexSettings
from geometry.layout import Design
from geometry.materials import Material
from geometry.tiling import Panel
from pipeline.case.model import Case
from pipeline.planning.mesh_rules import search_window_hz
from solvers.analytic.predesign import free_kx_per_m, strip_of
from solvers.errors import SolverError
from solvers.measures.confinement import Confinement, Profile
from solvers.measures.target_mode import LEAD, MIN_MAC, Found, Verdict, search, weights
from solvers.parametric.affine import Sizes
from solvers.parametric.bare import bare_cell
from solvers.parametric.cell import Inner, ParametricCell
from solvers.parametric.finite import Chain, Condensed, FinitePlate, wavenumbers
from solvers.plates.assembled import Reductions
from solvers.plates.column import Column
from solvers.superelement.cell import Cell
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.lattice import Periodic

FACE, INNER = (
    Interface(3, 2),
    Inner(3, 3),
)  # of rows and column: a few half-waves of the plate, far below the tenth band
REACH = 6.0  # fixed-interface modes of panels that are meshed, in the top of the window
PANEL = 3.0  # thicknesses: longest bare panel
TRIED = 1.5  # of the window's top: column modes that are trial functions, and modes of the plate that are known
TIED = 0.3  # dB that few waves leave of a level
CHANGES = 11  # over the error of a frequency, at which the level is looked at
SHARING = 0.1  # of the target mode's strength: another mode that carries as much of the target shape is coupled to it
# of a frequency, by the polynomials of sides and, over (k h)^2, through them: each twice the most that degree 5 and three
# layers took off in columns of plates of 1.2 to 3 mm
SIDES, LAYERS = 0.003, 0.008
WAVES = 0.01  # of a frequency, over the half-wavelengths between the ends: the change from twice as many waves
# of a frequency, by condensed rows: more than a reach of 24 took off of any mode of 600 drawn columns
CONDENSED = 0.002


class LiveCell:
    """The cell of rows and column, the last one kept with its condensed rows: both ask for the same design, and so do plates
    of a cloud.
    """

    def __init__(self, model: ParametricCell) -> None:
        self.model = model
        self.condensed = Condensed()
        self._last: tuple[Sizes, Cell] | None = None

    def at(self, sizes: Sizes) -> Cell:
        """The cell of a design. SolverError for one outside the box, by name."""
        last = self._last
        if last is None or last[0] != sizes:
            last = self._last = sizes, self.model.at(sizes, INNER, FACE)
            self.condensed.clear()
        return last[1]

    def row(self, sizes: Sizes, plate: Material) -> Periodic:
        """The cells of a pitch of a design, in rows as the lattice has them. Errors as at."""
        cell, box = self.at(sizes), self.model.box
        return Periodic([cell, *[bare_cell(cell.size_m, plate, FACE)] * (box.panels - 1)], box.panels - 1)


class LiveReductions(Reductions):
    """Reductions whose cells with a pillar come from the parametric cell and whose bare panels are polynomials."""

    def __init__(self, live: LiveCell, design: Design, known: dict[str, Cell], high_hz: float) -> None:
        hexahedra = HexSettings(3, 2.0 * design.thickness_m, 0)
        settings = ReductionSettings(FACE, REACH * high_hz, hexahedra, PANEL * design.thickness_m)
        super().__init__(design.stack, design.pillar, settings, _Known(known))
        self.live = live

    def coarser(self, panel: Panel) -> None:
        """Live answers need no coarser mesh: they report no discretisation error."""

    def cell(self, panel: Panel) -> Cell:
        """The cell of a panel; one whose pillar does not stand in the middle, or of another shape, is meshed."""
        width, depth = (high - low for low, high in zip(panel.low, panel.high, strict=True))
        if panel.foot is None:
            return bare_cell((width, depth, self.stack.thickness_m), self.stack.material, FACE)
        assert self.pillar is not None
        across, along = self.live.model.box.panel
        pitch = width / across
        if panel.free or abs(along * pitch - depth) > 1e-9 or panel.halved != (0, 1):
            if not has_room(panel, self.pillar):
                raise SolverError(
                    f"the zone's middle or the plate's edge cuts the foot of a {self.pillar.shape} pillar: no live answer there"
                )
            return super().cell(panel)
        return self.live.at((self.stack.thickness_m, self.pillar.height_m, self.pillar.base_m, pitch))


class _Known:
    """Meshed cells of this session, the oldest dropped."""

    def __init__(self, cells: dict[str, Cell], most: int = 400) -> None:
        self.cells, self.most = cells, most

    def get(self, key: str) -> Cell | None:
        return self.cells.get(key)

    def put(self, key: str, cell: Cell) -> None:
        while len(self.cells) >= self.most:
            self.cells.pop(next(iter(self.cells)))
        self.cells[key] = cell


def live_modes(
    case: Case, live: LiveCell, known: dict[str, Cell], window: tuple[float, float]
) -> tuple[FloatArray, Profile]:
    """Frequencies (k,) in Hz of the column's modes within a window and their motion across the plate, at the wavenumber of the
    target mode between free ends.

    SolverError for a design outside the box, by name.
    """
    design, _ = with_room(case.design)
    reductions = LiveReductions(live, design, known, window[1])
    column = Column(design, reductions, free_kx_per_m(design), live.model.box.panels)
    frequency_hz, vectors = Chain(column, *window, live.condensed).solve(*window)
    return frequency_hz, column.profile(vectors)


def with_room(design: Design) -> tuple[Design, float]:
    """The design with as much extension as elements need beyond round feet, and what that may change of a frequency, relative.

    Where the plate's edge touches the feet it is moved by two hundredths of their radius. The frequency of what lies beyond
    the zone goes at most as its depth to the power of -2, as all of it were of a wave between the zone's edge and the plate's.
    """
    pillar = design.pillar
    if not design.rows or pillar is None or pillar.shape != "round":
        return design, 0.0
    more = (1.0 + 1e-6) * CLEAR * pillar.base_m / 2.0 - design.extension_m
    if more <= 0.0:
        return design, 0.0
    depth = design.half_span_m - design.width_m / 2.0
    return replace(design, extension_m=design.extension_m + more), 2.0 * more / depth


def half_waves(nodal_lines: int) -> float:
    """Number of half-wavelengths along the zone; rigid shapes count as the lowest bending shape."""
    return max(nodal_lines, 2) - 0.5


def boundary_error(design: Design) -> float:
    """Bound the relative overestimate of the target frequency due to few waves, polynomials and condensed rows.

    The polynomials have degree 3 along a panel's sides and degree 1 through the thickness: the strain of a bending wave that
    they miss grows as (k h)^2. The error of few waves at the two ends is divided by the number of half-wavelengths between.
    """
    k2 = free_kx_per_m(design) ** 2 + (pi / design.width_m) ** 2
    return thin_error(design.nodal_lines) + LAYERS * k2 * design.thickness_m**2


def thin_error(nodal_lines: int) -> float:
    """Bound that overestimate in the limit of a thin plate."""
    return SIDES + CONDENSED + WAVES / half_waves(nodal_lines)


def end_layer(design: Design) -> float:
    """How far the edge layers of twist at both free ends, which bending waves lack, lower the target frequency at most.

    A plate that twists carries no shear through its edge: within 0.315 h of each end the energy of twist is missing, as in
    St Venant's torsion of a flat rectangle, J = b h^3 / 3 (1 - 0.63 h / b). Its share of the
    energy of a wave cos(k x) cos(q y) is 4 D_66 k^2 q^2 over that of all curvatures, four times as much at the tip of a
    free-free beam.
    """
    k2, q2, strip = free_kx_per_m(design) ** 2, (pi / design.width_m) ** 2, strip_of(design)
    assert strip
    share = 4.0 * float(strip.stack.bending_n_m[2, 2]) * k2 * q2 / strip.wave_n_m3(k2, q2)
    return 0.63 * 4.0 * share * design.thickness_m / design.length_m / 2.0


def tried_up_to_hz(design: Design, window: tuple[float, float]) -> Callable[[float], float]:
    """Up to which frequency a column's modes at a wavenumber are trial functions, Hz.

    What bends near the ends has the zone's shape across it and a shorter wave along it: its frequency goes as k^2 + (pi/W)^2.
    """
    across = pi / design.width_m
    own = hypot(free_kx_per_m(design), across)
    return lambda kx: TRIED * window[1] * max(1.0, (hypot(kx, across) / own) ** 2)


class LiveMode(NamedTuple):
    """A mode of a live plate as the search for the target mode sees it."""

    frequency_hz: float
    strength: float
    zone_share: float
    mac: float


class LivePlate:
    """The modes of a case's whole plate, both ends free, from its column at some wavenumbers, and the target mode among them.

    SolverError for a design outside the box, by name.
    """

    def __init__(self, case: Case, live: LiveCell, known: dict[str, Cell], window: tuple[float, float]) -> None:
        (self.design, self.moved), self.window = with_room(case.design), window
        self.searched, self.top_hz = search_window_hz(self.design), TRIED * window[1]
        reductions = LiveReductions(live, self.design, known, window[1])
        panels = live.model.box.panels
        columns = [Column(self.design, reductions, float(kx), panels) for kx in wavenumbers(self.design)]
        condensed, tried_hz = Condensed(), tried_up_to_hz(self.design, window)
        chains = [Chain(one, *self.searched, condensed) for one in columns]
        vectors = [chain.solve(-1.0, tried_hz(chain.column.kx))[1] for chain in chains]
        self.plate = FinitePlate(self.design, columns, vectors, chains[0].about)
        self.modes = self.plate.modes(-1.0, self.top_hz)

    def verdict(self, zone: float = 0.0, rows: float = 0.0) -> Detuned:
        """The target mode where the zone alone and the rows alone would ring higher by relative changes."""
        frequency_hz, turn, level = self.modes.detuned(zone, rows)
        measured = zip(frequency_hz, level.strength, level.zone_share, level.mac, strict=True)
        found = search(self.searched, (0.0, self.top_hz), [LiveMode(*one) for one in measured], lambda low, high: ())
        first = int(np.count_nonzero(frequency_hz < found.reach_hz[0]))
        return Detuned(_shifted(found.verdict, first), self._tied(found, first), frequency_hz, turn, level)

    def _tied(self, found: Found[LiveMode], first: int) -> tuple[int, ...]:
        """Modes that may be the target mode, itself first: candidates that the best leads by too little for another mesh to
        agree.
        """
        best = found.verdict.index
        if best is None:
            return ()
        every = weights(found.modes)
        least = every[best] / LEAD
        may_be = [mode.mac >= MIN_MAC and mode.frequency_hz >= self.searched[0] for mode in found.modes]
        near = np.flatnonzero(np.array(may_be) & (every >= least)).tolist()
        return (first + best, *(first + i for i in near if i != best))

    def within(self, error: float) -> list[Detuned]:
        """The same over both sides of a relative error: zone and rows alike, and one against the other."""
        changes = np.linspace(-error, error, CHANGES).tolist()
        return [self.verdict(change, sign * change) for sign in (1.0, -1.0) for change in changes]


@dataclass(frozen=True)
class Detuned:
    """A verdict over modes of frequencies (k,) in Hz, vectors (k, k) among those of the plate as it is, and their measures;
    tied: the modes that may be the target mode, the verdict's first.
    """

    verdict: Verdict
    tied: tuple[int, ...]
    frequency_hz: FloatArray
    turn: FloatArray
    level: Confinement

    def rival_hz(self, within: float) -> float | None:
        """The nearest other mode that carries a share of the target shape, Hz; None where none lies so near, relative."""
        at = self.verdict.index
        if at is None:
            return None
        off = np.abs(self.frequency_hz / self.frequency_hz[at] - 1.0)
        sharing = self.level.strength >= SHARING * self.level.strength[at]
        off = np.where(sharing & (np.arange(len(off)) != at) & (off <= within), off, np.inf)
        return float(self.frequency_hz[np.argmin(off)]) if np.isfinite(off).any() else None


def _shifted(judged: Verdict, by: int) -> Verdict:
    """A verdict among modes of which so many more come first."""
    index = None if judged.index is None else judged.index + by
    return replace(judged, index=index, rivals=tuple(rival + by for rival in judged.rivals))
