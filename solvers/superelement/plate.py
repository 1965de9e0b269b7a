"""A finite plate assembled from reduced cells: neighbours share vertex lines and sides; mirrors halve it twice where
it has them.

K = sum T_c' K_c T_c, where T_c places a cell's degrees of freedom among the plate's, with the sign of a mirror
image or zero where
the symmetry class forbids them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from operator import attrgetter
from typing import TypeVar

import numpy as np
import scipy.sparse as sp

from geometry.elements import BoolArray, ComplexArray, FloatArray, IntArray
from geometry.materials import Stack
from geometry.tiling import DIGITS, Signature, Tiling, signature
from solvers.errors import SolverError
from solvers.fem.assembly import Scale
from solvers.fem.eigen import PlainPencil
from solvers.fem.factor import Factoriser
from solvers.fem.prestress import PLACES
from solvers.fem.surface import Skin, triangles
from solvers.measures.confinement import TouchField
from solvers.superelement.cell import DROP_TOLERANCE, Cell, Expansion, PlacedCell, SurfaceRule, with_further
from solvers.superelement.clamped import softened
from solvers.superelement.interface import OFFSETS, SIDES, VERTICES, Interface
from solvers.superelement.prestress import Prestress
from solvers.superelement.supports import Action, Hold, actions, at_edge, full_panels, held_dofs, rigid_count, softness

Kept = TypeVar("Kept")
CELLS = 10  # whose touch faces are evaluated at once
WHOLE = ""  # no mirror: every panel is assembled


class AssembledPlate:
    """Cells on a tiling, restricted to one symmetry class; `symmetry` = SS, SA, AS or AA of u_z, x then y; WHOLE for all of
    them at once. `grid`: the numbers of the whole plate's degrees of freedom, where another class has made them.

    Raises SolverError for cells that do not fit, and for a class of a plate that is not its own mirror image.
    """

    def __init__(
        self, tiling: Tiling, cells: Mapping[Signature, Cell], symmetry: str, grid: Grid | None = None
    ) -> None:
        self.tiling, self.symmetry = tiling, symmetry
        if symmetry != WHOLE and not tiling.mirrored:
            raise SolverError("the plate is not its own mirror image: it has no symmetry classes")
        self.grid = grid or Grid(tiling, cells, symmetry == WHOLE)
        whole, sign = self.grid.representatives(symmetry)
        self.origin = np.unique(whole[sign != 0.0])  # of its degrees of freedom, in the grid
        self.dof = len(self.origin)
        number = np.full(self.grid.count, -1, dtype=np.int64)
        number[self.origin] = np.arange(self.dof)
        self._number, self._sign = number[whole], sign
        self.placed_cells = [self._place(i, j, number[whole], sign) for i, j in self.grid.representative_cells()]
        self.factorise = Factoriser()  # one symbolic analysis serves what shifts, softens or releases the plate
        self.holds: Sequence[Hold] = ()  # discs of the back face
        self.stack: Stack | None = None  # layers, where supports on discs are to have error bars
        # thermal stress: size of each field in each placed cell, (cells, 9), scaled
        self.stress: FloatArray | None = None

    def _place(self, i: int, j: int, number: IntArray, sign: FloatArray) -> PlacedCell:
        dofs = self.grid.dofs(i, j)
        panel = self.tiling.panel(i, j)
        copies = self.grid.copies(i, j)
        clamps = [each.edge for each in self.tiling.supports if each.kind == "clamp" and each.edge]
        clamped = any(at_edge(self.tiling, i, j, edge) for edge in clamps)
        cell, taken = self.grid.clamped_cell(i, j) if clamped else (self.grid.cell(i, j), None)
        return PlacedCell(cell, panel.middle, number[dofs], sign[dofs], copies, taken)

    @property
    def cells(self) -> list[Cell]:
        """The different cells."""
        return list({id(placed_cell.cell): placed_cell.cell for placed_cell in self.placed_cells}.values())

    def widened(self) -> AssembledPlate:
        """Return the plate with its cells' further boundary functions."""
        cells = {key: with_further(cell) for key, cell in self.grid.cells.items()}
        wide = AssembledPlate(self.tiling, cells, self.symmetry)
        wide.stress = self.stress
        return wide

    @cached_property
    def complete(self) -> AssembledPlate:
        """The plate with all boundary functions in all panels."""
        return AssembledPlate(self.tiling, self.grid.cells, self.symmetry)

    def pencil(self) -> PlainPencil:
        """K and M of the class, per whole plate."""
        mass = self.of_cells(attrgetter("mass"))
        for action in self.actions:
            mass = mass + action.mass(self.scale)
        return PlainPencil(self.stiffness(), sp.csc_array(mass), self.scale, self.rigid_count)

    def stiffness(self, less: Callable[[Cell], FloatArray] | None = None) -> sp.csc_array:
        """The stiffness of cells, less a part of it, and of supports and thermal stress, (dof, dof), in one pattern."""
        stiffness = self.of_cells(attrgetter("stiffness"), less)
        for action in self.actions:
            stiffness = stiffness + action.stiffness(self.scale)
        for hold in self.holds:
            stiffness = stiffness + self.held_stiffness(hold)
        if self.stress is not None:
            stiffness = stiffness + self.stress_stiffness(self.stress)
        return sp.csc_array(stiffness)

    def missed_at_discs(self, vectors: FloatArray, eigenvalue: FloatArray) -> FloatArray:
        """Relative error of frequencies, (k,), by elements at the rims of held discs at most: Rayleigh's quotient."""
        total = np.zeros_like(eigenvalue)
        for hold in self.holds:
            own = self._placed(hold) @ vectors
            total += hold.count * hold.missed * np.abs(np.einsum("ik,ik->k", own, hold.layer @ own))
        return np.asarray(total / (2.0 * eigenvalue))

    def missed_beneath(self, vectors: FloatArray, eigenvalue: FloatArray) -> FloatArray:
        """Relative error of frequencies, (k,), by what the panels lack of the dip beneath springs and masses on discs.

        A thin plate's waves shorter than those of w, of wavenumber q, yield 1 / (4 pi sqrt(D m) w) to a force, and at most
        8 / pi (q r)^3 of it to one spread over a disc, by its mean of such a wave. The disc dents the plate by 1 / (2 E r), or
        squeezes it by h / (pi E r^2) where it is wide.
        """
        discs = [each for each in self.actions if not each.support.edge]
        total = np.zeros_like(eigenvalue)
        if self.stack is None or not discs:
            return total
        bending, surface = float(self.stack.bending_n_m.diagonal()[:2].min()), self.stack.mass_kg_m2
        angular = 2.0 * np.pi * min(cell.dropped_hz for cell in self.cells)
        young_pa = self.stack.back.average.young_pa
        for disc in discs:
            radius, motion = disc.support.radius_m, disc.rows[2] @ vectors
            across = np.sqrt(angular * np.sqrt(surface / bending)) * radius
            waves = min(1.0, 8.0 / np.pi / across**3) / (4.0 * np.pi * np.sqrt(bending * surface) * angular)
            dent = min(0.5, self.stack.thickness_m / np.pi / radius) / (young_pa * radius)
            total += (waves + dent) * disc.force(self.scale, eigenvalue) ** 2 * (disc.weights @ motion**2)
        return np.asarray(total * self.scale.young_pa * self.scale.length_m / (2.0 * eigenvalue))

    def missed_of_stress(self, vectors: FloatArray, eigenvalue: FloatArray) -> FloatArray:
        """Relative error of frequencies, (k,), by thermal stress: what its slopes in the panels change, because there it need
        not be linear, and the largest stress of a panel over the modulus, because about feet and edges it is another one.
        """
        if self.stress is None:
            return np.zeros_like(eigenvalue)
        slopes = self.stress.copy()
        slopes[:, :: len(PLACES)] = 0.0
        own = self.stress_stiffness(slopes)
        bent = np.abs(np.einsum("ik,ik->k", vectors, own @ vectors)) / (2.0 * eigenvalue)
        return np.asarray(bent + np.abs(self.stress[:, :: len(PLACES)]).max())

    def held_stiffness(self, hold: Hold) -> sp.csc_array:
        """Stiffness of a held disc and its mirror images in the plate's degrees of freedom, (dof, dof)."""
        place = self._placed(hold)
        return sp.csc_array(hold.count * (place.T @ sp.csr_array(hold.stiffness) @ place))

    def _placed(self, hold: Hold) -> sp.csr_array:
        """Degrees of freedom of the panels about a held disc from the plate's, (n, dof)."""
        live = np.flatnonzero(self._sign[hold.dofs] != 0.0)
        at = hold.dofs[live]
        return sp.csr_array((self._sign[at], (live, self._number[at])), shape=(len(hold.dofs), self.dof))

    @property
    def scale(self) -> Scale:
        """Units of the pencil."""
        return self.placed_cells[0].cell.scale

    @property
    def rigid_count(self) -> int:
        """Rigid-body modes of the class that the supports leave."""
        return rigid_count(self.tiling, self.placed_cells[0].cell.size_m[2], self.symmetry)

    @cached_property
    def actions(self) -> list[Action]:
        """Springs, dampers and masses in the plate's degrees of freedom."""
        return actions(self.tiling, self._placed_panels, self.dof)

    @property
    def _placed_panels(self) -> list[tuple[tuple[int, int], PlacedCell]]:
        return list(zip(self.grid.representative_cells(), self.placed_cells, strict=True))

    def softness(self, value: float) -> tuple[float, float]:
        """Bounds t, f of what springs and masses of the supports add: E <= t (K + l M), F <= f (M + K / l), l scaled."""
        return softness(self.tiling, self._placed_panels, self.scale, value)

    def released(self) -> AssembledPlate | None:
        """The plate without its supports, in the same degrees of freedom; None where they hold or load some."""
        tiling = replace(self.tiling, supports=())
        held = any(each.held_axes for each in self.tiling.supports) or self.stress is not None
        if held or any(tiling.free_sides(*place) != self.tiling.free_sides(*place) for place in tiling.feet):
            return None
        plate = AssembledPlate(tiling, self.grid.cells, self.symmetry, self.grid)
        plate.factorise = self.factorise
        return plate

    def damping(self, vectors: FloatArray) -> FloatArray:
        """Scaled damping of the supports between motions (dof, k), (k, k)."""
        parts = [action.damping(self.scale, vectors) for action in self.actions if action.support.damping_n_s_m]
        return np.asarray(sum(parts, np.zeros((vectors.shape[1],) * 2)))

    def pillar_share(self, vectors: FloatArray) -> FloatArray:
        """Share of the pillars in the kinetic energy of M-orthonormal modes, (k,)."""
        mass = self.of_cells(lambda cell: cell.pillar_mass)
        return np.asarray(np.einsum("ik,ik->k", vectors, mass @ vectors))

    def lost(self, vectors: FloatArray) -> FloatArray:
        """Loss between motions, u' (sum of loss factor times stiffness) u, (k, k). SolverError for cells without it."""
        about = sum(hold.loss_factor * self.held_stiffness(hold) for hold in self.holds)
        return np.asarray(vectors.T @ ((self.of_cells(loss_of) + about) @ vectors))

    def parted(self, vectors: FloatArray) -> FloatArray:
        """Stiffness of each material between motions (dof, k), and what K has more, (materials + 1, k, k).

        SolverError for cells without the parts of their materials.
        """
        count = max(len(cell.by_material) for cell in self.cells if cell.by_material is not None)
        each = [vectors.T @ (self.of_cells(partial(part_of, number)) @ vectors) for number in range(count)]
        whole = vectors.T @ (self.of_cells(attrgetter("stiffness")) @ vectors)
        rest = whole - np.sum(each, axis=0)
        for hold in self.holds:
            each[hold.material] += vectors.T @ (self.held_stiffness(hold) @ vectors)
        return np.array([*each, rest])

    def of_cells(
        self, matrix: Callable[[Cell], FloatArray], less: Callable[[Cell], FloatArray] | None = None
    ) -> sp.csc_array:
        """The cells' matrices (cell dof, cell dof), less others, summed over the plate, (dof, dof), without mere rounding."""
        known = {id(cell): _entries(matrix(cell), less(cell) if less else None) for cell in self.cells}
        return self._summed(known[id(placed_cell.cell)] for placed_cell in self.placed_cells)

    def stress_stiffness(self, stress: FloatArray) -> sp.csc_array:
        """Geometric stiffness (dof, dof) of the stress in each placed cell, (cells, 9), scaled."""
        return self._summed(
            _entries(np.tensordot(own, prestress_of(placed_cell.cell).stiffness, 1))
            for own, placed_cell in zip(stress, self.placed_cells, strict=True)
        )

    def _summed(self, entries: Iterable[tuple[IntArray, IntArray, FloatArray]]) -> sp.csc_array:
        """Rows, columns and values of each placed cell's matrix summed over the plate, (dof, dof)."""
        rows, columns, values = [], [], []
        for placed_cell, (row, column, value) in zip(self.placed_cells, entries, strict=True):
            place, weight = placed_cell.dofs.astype(np.int32), placed_cell.coefficient
            weighted = placed_cell.copies * value * weight[row] * weight[column]
            live = weighted != 0.0
            rows.append(place[row[live]])
            columns.append(place[column[live]])
            values.append(weighted[live])
        where = (np.concatenate(rows), np.concatenate(columns))
        return sp.coo_array((np.concatenate(values), where), shape=(self.dof, self.dof)).tocsc()

    def cell_vectors(self, placed_cell: PlacedCell, vectors: FloatArray | ComplexArray) -> FloatArray:
        """A cell's degrees of freedom (cell dof, k) from the plate's (dof, k)."""
        return np.asarray(placed_cell.coefficient[:, None] * vectors[np.maximum(placed_cell.dofs, 0)])

    def touch_rule(self, placed_cell: PlacedCell) -> SurfaceRule:
        """Quadrature over a cell's touch face, parted where parts of the plate's touch face meet."""
        return self.grid.touch_rule(placed_cell.cell, placed_cell.middle)

    def touch(self, vectors: FloatArray) -> TouchField:
        """u_z over the touch faces of the cells of the class, weighted as the whole plate."""
        return self._touched(self.placed_cells, vectors)

    def touch_parts(self, vectors: FloatArray) -> Iterator[TouchField]:
        """The same, some cells after others: of many modes the whole would fill the memory."""
        for first in range(0, len(self.placed_cells), CELLS):
            yield self._touched(self.placed_cells[first : first + CELLS], vectors)

    def _touched(self, placed_cells: Sequence[PlacedCell], vectors: FloatArray) -> TouchField:
        rules = [self.touch_rule(placed_cell) for placed_cell in placed_cells]
        ends = np.cumsum([0, *(len(rule.weights) for rule in rules)])
        points, weights = np.empty((ends[-1], 2)), np.empty(ends[-1])
        values = np.empty((ends[-1], vectors.shape[1]), dtype=vectors.dtype)  # joining parts would hold them twice
        for placed_cell, rule, at in zip(placed_cells, rules, map(slice, ends[:-1], ends[1:]), strict=True):
            points[at] = rule.points[:, :2] + np.array(placed_cell.middle)
            weights[at] = rule.weights * placed_cell.copies
            values[at] = rule.values(self.cell_vectors(placed_cell, vectors))
        return TouchField(points, weights, values, self.scale.mass_kg)

    def work(self, force: FloatArray) -> FloatArray:
        """Work of forces (q,) along z at the points of `touch` on each degree of freedom, (dof,)."""
        out, first = np.zeros(self.dof), 0
        for placed_cell in self.placed_cells:
            rule = self.touch_rule(placed_cell)
            own = force[first : first + len(rule.weights)]
            np.add.at(out, np.maximum(placed_cell.dofs, 0), placed_cell.coefficient * rule.work(own))
            first += len(rule.weights)
        return out

    def skin(self, vectors: FloatArray) -> Skin:
        """Outer skin of the cells of the class."""
        points, facets, values, start = [], [], [], 0
        for placed_cell in self.placed_cells:
            expansion = self._seen(placed_cell)
            assert expansion.facets is not None
            points.append(expansion.points + np.array([*placed_cell.middle, 0.0]))
            facets.append(expansion.facets + start)
            field = np.tensordot(expansion.matrix, self.cell_vectors(placed_cell, vectors), axes=(2, 0))
            values.append(field.transpose(2, 0, 1))
            start += len(expansion.points)
        if len({part.shape[1] for part in facets}) > 1:  # tetrahedra next to bare panels of hexahedra
            facets = [triangles(part) for part in facets]
        return Skin(np.concatenate(points), np.concatenate(facets), np.concatenate(values, axis=1))

    def _seen(self, placed_cell: PlacedCell) -> Expansion:
        """A cell's skin; of one that stands on a mirror the half x >= 0 or y >= 0, whose image is the other one."""
        skin = placed_cell.cell.skin
        assert skin.facets is not None
        mirrors = [axis for axis in range(len(self.symmetry)) if abs(placed_cell.middle[axis]) < 10.0**-DIGITS]
        if not mirrors:
            return skin
        facets = skin.facets[(skin.points[skin.facets].mean(axis=1)[:, mirrors] > 0.0).all(axis=1)]
        used, local = np.unique(facets, return_inverse=True)
        return Expansion(skin.points[used], skin.matrix[used], facets=local.reshape(facets.shape))


def loss_of(cell: Cell) -> FloatArray:
    """Return a cell's loss.

    Parameters
    ----------
    cell : Cell
        Reduced with its materials' loss.

    Returns
    -------
    ndarray, shape (dof, dof)
        Stiffness with each material's part times its loss factor, scaled.

    Raises
    ------
    SolverError
        If the cell was reduced without it.
    """
    return _given(cell.loss, "the loss of its materials")


def prestress_of(cell: Cell) -> Prestress:
    """Return a cell's stress fields.

    Parameters
    ----------
    cell : Cell
        Reduced with them.

    Returns
    -------
    Prestress
        Scaled.

    Raises
    ------
    SolverError
        If the cell was reduced without them.
    """
    return _given(cell.prestress, "the thermal stress of its layers")


def part_of(number: int, cell: Cell) -> FloatArray:
    """Return the part of a material in a cell's stiffness.

    Parameters
    ----------
    number : int
        Of the material, among those with which the cell was reduced.
    cell : Cell
        Reduced with the parts of its materials.

    Returns
    -------
    ndarray, shape (dof, dof)
        Stiffness of that material, scaled.

    Raises
    ------
    SolverError
        If the cell was reduced without them.
    """
    return np.asarray(_given(cell.by_material, "the parts of its materials")[number])


def _given(value: Kept | None, what: str) -> Kept:
    if value is None:
        raise SolverError(f"the cell was reduced without {what}")
    return value


def _entries(matrix: FloatArray, less: FloatArray | None = None) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows, columns and values of a cell's matrix, less another one, without the rounding left in entries that symmetry makes
    zero; the other one's rounding is larger.
    """
    size = np.sqrt(np.abs(np.diag(matrix)))
    least = DROP_TOLERANCE * np.outer(size, size)
    kept = np.abs(matrix) > least
    if less is not None:
        kept |= np.abs(less) > 100.0 * least
        matrix = matrix - less
    row, column = np.nonzero(kept)
    return row, column, matrix[row, column]


def _fit(tiling: Tiling, cells: Mapping[Signature, Cell]) -> None:
    """Raise SolverError unless all cells share boundary functions, units and thickness, and each fills its panel."""
    first = next(iter(cells.values()))
    for key, cell in cells.items():
        same = cell.interface == first.interface and cell.scale == first.scale
        if not same or abs(cell.size_m[2] - first.size_m[2]) > 1e-9 * first.size_m[2]:
            raise SolverError(
                f"cells do not fit together: {cell.interface} next to {first.interface}, or different thicknesses"
            )
        if not np.allclose(cell.size_m[:2], np.array(key[:2], dtype=float), rtol=0.0, atol=1e-8):
            raise SolverError(f"a cell of {cell.size_m[:2]} m does not fill its panel of {key[:2]} m")


class Grid:
    """Numbers of the whole plate's degrees of freedom, and the action of the two mirrors on them; `whole`: no panel stands
    for its image; `kept`: mask of the boundary functions, (interface.count,), that bare panels away from feet need.
    """

    def __init__(
        self, tiling: Tiling, cells: Mapping[Signature, Cell], whole: bool = False, kept: BoolArray | None = None
    ) -> None:
        self.tiling, self.cells, self.whole, self.kept = tiling, cells, whole, kept
        _fit(tiling, cells)
        self.nx, self.ny = len(tiling.x) - 1, len(tiling.y) - 1
        self.interface: Interface = next(iter(cells.values())).interface
        corner, side = self.interface.vertex_block, self.interface.side_block
        shapes = (self.nx + 1, self.ny + 1, corner), (self.nx + 1, self.ny, side), (self.nx, self.ny + 1, side)
        starts = np.cumsum([0, *(int(np.prod(shape)) for shape in shapes)])
        # of the vertex lines, of the sides on lines x = x[i] and of those on lines y = y[j], degrees of freedom last
        self._corners, self._beside_x, self._beside_y = (
            start + np.arange(np.prod(shape)).reshape(shape) for start, shape in zip(starts, shapes, strict=False)
        )
        modes = [len(self.cell(i, j).fixed_hz) for i in range(self.nx) for j in range(self.ny)]
        self.mode_start = starts[-1] + np.concatenate([[0], np.cumsum(modes)])
        self.count = int(self.mode_start[-1])
        self._touch_rules: dict[tuple[float, ...], SurfaceRule] = {}
        self._softened: dict[int, tuple[Cell, float]] = {}

    def touch_rule(self, cell: Cell, middle_m: tuple[float, float]) -> SurfaceRule:
        """Quadrature over the touch face of a cell about a middle (x, y), one for all that the same lines cross."""
        cuts, lines = (
            [line - middle for line in lines if abs(line - middle) < size / 2.0]
            for lines, middle, size in zip(
                (self.tiling.cuts_m, self.tiling.lines_m), middle_m, cell.size_m, strict=False
            )
        )
        key = (id(cell), *(round(line, DIGITS) for line in lines), np.inf, *(round(cut, DIGITS) for cut in cuts))
        if key not in self._touch_rules:
            self._touch_rules[key] = cell.touch.rule(lines, cuts)
        return self._touch_rules[key]

    def cell(self, i: int, j: int) -> Cell:
        """The reduction of panel (i, j); that of its mirror image for panels on the negative sides of a mirrored plate."""
        return self.cells[signature(self.tiling.panel(*self.positive(i, j)))]

    def clamped_cell(self, i: int, j: int) -> tuple[Cell, float]:
        """The reduction of panel (i, j) at a clamped edge without most of what its elements miss there, and how much it is."""
        cell = self.cell(i, j)
        if id(cell) not in self._softened:
            self._softened[id(cell)] = softened(cell)
        return self._softened[id(cell)]

    def positive(self, i: int, j: int) -> tuple[int, int]:
        """The panel whose reduction serves (i, j): its image where x, y > 0, itself on a plate without mirrors."""
        if self.whole:
            return i, j
        return max(i, self.nx - 1 - i), max(j, self.ny - 1 - j)

    def dofs(self, i: int, j: int) -> IntArray:
        """Degrees of freedom of panel (i, j) in the order of its cell."""
        corners = [self._corners[i + dx, j + dy] for dx, dy in OFFSETS]
        sides = [self._beside_x[i, j], self._beside_x[i + 1, j], self._beside_y[i, j], self._beside_y[i, j + 1]]
        first, last = self.mode_start[i * self.ny + j :][:2]
        return np.concatenate([*corners, *sides, np.arange(first, last)])

    def copies(self, i: int, j: int) -> int:
        """Number of panels that a representative one stands for."""
        if self.whole:
            return 1
        return (1 if 2 * i == self.nx - 1 else 2) * (1 if 2 * j == self.ny - 1 else 2)

    def representative_cells(self) -> list[tuple[int, int]]:
        """Panels to assemble."""
        return self.tiling.representatives(self.whole)

    def representatives(self, symmetry: str) -> tuple[IntArray, FloatArray]:
        """Master and coefficient of every degree of freedom: u[d] = sign[d] u[where[d]]; 0 where it must vanish."""
        here = np.arange(self.count)
        where, sign = here, np.where(self._idle(), 0.0, 1.0)
        for axis, mark in enumerate(symmetry):
            image, flip = self._mirrors[axis]
            flip = flip if mark == "S" else -flip
            beyond, forbidden = image > here, (image == here) & (flip < 0.0)
            factor = np.where(beyond, flip, np.where(forbidden, 0.0, 1.0))
            sign, where = sign * factor[where], np.where(beyond, image, here)[where]
        return where, sign

    def _idle(self) -> BoolArray:
        """Bubbles on the free sides of cells, and vertex lines between two of them, which carry nothing; what supports hold;
        what bare panels do without.
        """
        idle = self._spared()
        for i in range(self.nx):
            for j in range(self.ny):
                free, dofs = set(self.tiling.free_sides(i, j)), self.dofs(i, j)
                for side in free:
                    idle[dofs[self.interface.side(SIDES.index(side))]] = True
                for index, (x, y) in enumerate(VERTICES):
                    if {"x+" if x > 0 else "x-", "y+" if y > 0 else "y-"} <= free:
                        idle[dofs[self.interface.vertex(index)]] = True
        for held in held_dofs(self.tiling, self._corners, self._beside_x, self._beside_y):
            idle[held] = True
        return idle

    def _spared(self) -> BoolArray:
        """Functions that bare panels do without, unless a neighbour needs them."""
        spared, others = np.zeros(self.count, dtype=bool), np.zeros(self.count, dtype=bool)
        if self.kept is not None:
            full = full_panels(self.tiling)
            for i in range(self.nx):
                for j in range(self.ny):
                    own = self.dofs(i, j)[: self.interface.count]
                    if (i, j) in full:
                        others[own] = True
                    else:
                        spared[own[~self.kept]] = True
        return spared & ~others

    @cached_property
    def _mirrors(self) -> tuple[tuple[IntArray, FloatArray], ...]:
        """Both mirrors, which every symmetry class needs."""
        return self._mirror(0), self._mirror(1)

    def _mirror(self, axis: int) -> tuple[IntArray, FloatArray]:
        """The mirror normal to an axis on the whole plate's degrees of freedom: u'[d] = sign[d] u[image[d]]."""
        image, sign = np.arange(self.count), np.ones(self.count)
        local, flips = self.interface.mirror(axis)
        for i in range(self.nx):
            for j in range(self.ny):
                other = (self.nx - 1 - i, j) if axis == 0 else (i, self.ny - 1 - j)
                mine, theirs = self.dofs(i, j), self.dofs(*other)
                boundary = self.interface.count
                image[mine[:boundary]] = theirs[:boundary][local]
                sign[mine[:boundary]] = flips
                image[mine[boundary:]] = theirs[boundary:]
                if other == (i, j):
                    sign[mine[boundary:]] = self.cell(i, j).fixed_parity[:, axis]
        return image, sign
