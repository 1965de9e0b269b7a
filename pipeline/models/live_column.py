"""Columns of cells from the parametric cell: what the explorer drags and the search ranks designs by."""

from __future__ import annotations

from geometry.elements import FloatArray
from geometry.hex.boxes import HexSettings, Panel
from geometry.hex.panels import has_room
from geometry.layout import Design
from pipeline.case.model import Case
from solvers.errors import SolverError
from solvers.measures.confinement import Profile
from solvers.parametric.affine import Sizes
from solvers.parametric.bare import bare_cell
from solvers.parametric.cell import Inner, ParametricCell
from solvers.parametric.chain import Chain, Condensed
from solvers.superelement.build import Reductions
from solvers.superelement.cell import Cell
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.waves.column import Column

FACE, INNER = (
    Interface(3, 2),
    Inner(3, 3),
)  # of rows and column: a few half-waves of the plate, far below the tenth band
REACH = 6.0  # fixed-interface modes of panels that are meshed, in the top of the window
PANEL = 3.0  # thicknesses: longest bare panel


class LiveCell:
    """The cell of rows and column, the last one kept with its condensed rows: both ask for the same design, and so do plates
    of a cloud.
    """

    def __init__(self, model: ParametricCell) -> None:
        self.model = model
        self.condensed: Condensed = {}
        self._last: tuple[Sizes, Cell] | None = None

    def at(self, sizes: Sizes) -> Cell:
        """The cell of a design. SolverError for one outside the box, by name."""
        last = self._last
        if last is None or last[0] != sizes:
            last = self._last = sizes, self.model.at(sizes, INNER, FACE)
            self.condensed.clear()
        return last[1]


class LiveReductions(Reductions):
    """Reductions whose cells with a pillar come from the parametric cell and whose bare panels are polynomials."""

    def __init__(self, live: LiveCell, design: Design, known: dict[str, Cell], high_hz: float) -> None:
        hexahedra = HexSettings(3, 2.0 * design.thickness_m, 0)
        settings = ReductionSettings(FACE, REACH * high_hz, hexahedra, PANEL * design.thickness_m)
        super().__init__(design.thickness_m, design.material, design.pillar, settings, _Known(known))
        self.live = live

    def coarser(self, panel: Panel) -> None:
        """Nobody asks a live answer for the error of its mesh."""

    def cell(self, panel: Panel) -> Cell:
        """The cell of a panel; one whose pillar does not stand in the middle of a square is meshed."""
        width, depth = (high - low for low, high in zip(panel.low, panel.high, strict=True))
        if panel.foot is None:
            return bare_cell((width, depth, self.thickness_m), self.material, FACE)
        assert self.pillar is not None
        if panel.free or abs(width - depth) > 1e-9 or panel.halved != (0, 1):
            if not has_room(panel, self.pillar):
                raise SolverError(
                    f"a row's cell is cut at the foot of a {self.pillar.shape} pillar: no live answer there"
                )
            return super().cell(panel)
        return self.live.at((self.thickness_m, self.pillar.height_m, self.pillar.base_m, width))


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
    """Frequencies (k,) in Hz of the column's modes within a window and their motion across the plate.

    SolverError for a design outside the box, by name.
    """
    reductions = LiveReductions(live, case.design, known, window[1])
    column = Column(case.design, reductions, case.kx_wanted_per_m)
    frequency_hz, vectors = Chain(column, *window, live.condensed).solve(*window)
    return frequency_hz, column.profile(vectors)
