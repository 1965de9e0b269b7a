"""Bloch waves of reduced cells: of one cell, a phase per side, and of several that repeat, such as staggered rows.

K(k) = sum over d of K_d exp(i k.d), d in {-1, 0, 1}^2 pitches, with real K_d folded once from the reduced cell. It is
Hermitian, and real symmetric in other degrees of freedom where a half turn leaves the cell as it is.

The discarded fixed-interface modes take h(l) D from the boundary's dynamic stiffness, D their residual flexibility, h(l) near
l^2 (`ResidualModes`): the lowest waves U of the pencil are coupled once more, by diag(l) - h U^H D U.

Along a1 = (n w, 0) the n cells of width w repeat, along a2 = (s w, h) the row does, s cells further along x: staggered rows
are a lattice of one row.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from operator import attrgetter

import numpy as np
import scipy.sparse as sp
from scipy.linalg import LinAlgError, eigh

from geometry.elements import BoolArray, ComplexArray, FloatArray
from geometry.lattice import Lattice
from solvers.errors import SolverError
from solvers.fem.eigen import PlainPencil
from solvers.superelement.cell import Cell, restricted, rigid_boundary, with_further
from solvers.superelement.interface import OFFSETS, Interface, Ties
from solvers.superelement.plate import PlacedCell
from solvers.superelement.symmetry import C2Symmetry, c2_symmetry
from solvers.threads import one_thread

ROUNDING = 1e-12  # of the pencil's norms: smaller eigenvalues are rigid-body modes
EQUAL = 1e-7  # relative distance of eigenvalues that count as one
SPARE = 4  # waves above the requested ones, with which the discarded modes couple them
IN_PHASE = 1e-12  # rad: smaller phases are those of a cell that moves as its images do
TRANSLATION = 0.99  # of a wave's mass that moves as one: elastic waves are orthogonal to translations


@dataclass(frozen=True)
class Waves:
    """Lowest Bloch waves at one wavevector.

    Attributes
    ----------
    wavevector : ndarray, shape (2,)
        In rad/m.
    eigenvalue, frequency_hz : ndarray, shape (n,)
        Scaled eigenvalues, and frequencies in Hz, both ascending.
    dofs : ndarray, shape (cell dof, n)
        Cell degrees of freedom, u^H M u = 1, orthogonal except for the part of the discarded modes.
    by_modes : ndarray, shape (n,)
        Relative error bar (half-width) due to discarded fixed-interface modes; inf where unknown.
    """

    wavevector: FloatArray
    eigenvalue: FloatArray
    frequency_hz: FloatArray
    dofs: ComplexArray
    by_modes: FloatArray


class ReducedLattice:
    """The reduced cell with one vertex line, one side along each axis and the fixed-interface modes left free."""

    def __init__(self, cell: Cell) -> None:
        self.cell = cell
        ties = Ties(cell.interface, [len(cell.fixed_hz)])
        self.dof, self.column, self.offset = ties.dof, ties.column, ties.offset

    @cached_property
    def steps(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Steps d (9, 2), and K_d and M_d (9, dof^2) of a column's offset less a row's."""
        steps = np.array([(dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1)], dtype=float)
        return steps, self._folded(self.cell.stiffness), self._folded(self.cell.mass)

    def _folded(self, matrix: FloatArray) -> FloatArray:
        out = np.zeros((3, 3, self.dof, self.dof))
        groups = [np.flatnonzero((self.offset == offset).all(axis=1)) for offset in OFFSETS]
        for row, here in zip(OFFSETS, groups, strict=True):
            for column, there in zip(OFFSETS, groups, strict=True):
                step = out[1 + column[0] - row[0], 1 + column[1] - row[1]]
                step[np.ix_(self.column[here], self.column[there])] += matrix[np.ix_(here, there)]
        return out.reshape(9, -1)

    def pencil(self, wavevector: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Hermitian K(k) and M(k), (dof, dof) each."""
        stiffness, mass = self._phased(wavevector, self.dof)
        return stiffness, mass

    def boundary(self, wavevector: FloatArray, shift: float) -> ComplexArray:
        """Hermitian K(k) + s M(k) of the boundary functions alone, (free, free)."""
        stiffness, mass = self._phased(wavevector, self.dof - len(self.cell.fixed_hz))
        return np.asarray(stiffness + shift * mass)

    def _phased(self, wavevector: FloatArray, size: int) -> list[ComplexArray]:
        """K(k) and M(k) of the first `size` degrees of freedom."""
        steps, *matrices = self.steps
        angle = steps @ (self.cell.vectors_m @ np.asarray(wavevector, dtype=float))
        turn = np.vstack([np.cos(angle), np.sin(angle)])
        own = (matrix.reshape(9, self.dof, self.dof)[:, :size, :size].reshape(9, -1) for matrix in matrices)
        parts = (turn @ each for each in own)
        return [(real + 1j * imaginary).reshape(size, size) for real, imaginary in parts]

    @cached_property
    def c2_symmetry(self) -> C2Symmetry | None:
        """Half turn that makes the pencil real, found at a wavevector without symmetries; None if the cell has none."""
        turn = c2_symmetry(self.cell, self.column, self.offset)
        wavevector = np.linalg.solve(self.cell.vectors_m, [1.0, np.sqrt(2.0)])
        if turn is None or not all(turn.is_real(matrix, wavevector) for matrix in self.pencil(wavevector)):
            return None
        return turn

    def frequencies(self, wavevector: FloatArray, count: int) -> FloatArray:
        """The `count` lowest Bloch frequencies at a wavevector (2,) in rad/m, ascending, Hz (a dense solve misses none).

        Raises SolverError if the mass is not positive: more boundary functions than the mesh can distinguish.
        """
        return self.waves(wavevector, count).frequency_hz

    def waves(self, wavevector: FloatArray, count: int) -> Waves:
        """The `count` lowest waves at a wavevector (2,) in rad/m, every one counted. Errors as frequencies."""
        wavevector = np.asarray(wavevector, dtype=float)
        residual = self.cell.residual
        alone, free = self._whole_groups(*self._solve(wavevector, count + SPARE + 2), count)
        flexibility = self._flexibility(wavevector, free)
        values, turn = residual.coupled(alone, flexibility)
        values = np.where(np.abs(values) < self.rounding, 0.0, values)
        energy, own = ((turn.conj() * (part @ turn)).real.sum(axis=0) for part in (np.diag(alone), flexibility))
        by_modes = residual.bar(values, energy, own)
        dofs = self._phases(wavevector)[:, None] * (free @ turn[:, :count])[self.column]
        frequencies = self.cell.scale.frequency(values[:count])
        return Waves(wavevector, values[:count], frequencies, dofs, by_modes[:count])

    def _whole_groups(self, values: FloatArray, free: ComplexArray, count: int) -> tuple[FloatArray, ComplexArray]:
        """The waves without the last degenerate group, of which more may lie above: a part of it, in a direction that rounding
        chose, would part the degenerate waves below that it is coupled to. At least `count` stay.
        """
        if len(values) == self.dof or len(values) <= count:
            return values, free
        whole = max(degenerate(values, self.rounding)[-1].start, count)
        return values[:whole], free[:, :whole]

    def _flexibility(self, wavevector: FloatArray, free: ComplexArray) -> ComplexArray:
        """U^H D U of free degrees of freedom (dof, n), D the residual flexibility of the discarded modes."""
        count = self.cell.interface.count
        u = self._phases(wavevector)[:count, None] * free[self.column[:count]]
        return np.asarray(u.conj().T @ times(self.cell.dropped, u))

    def slopes(self, waves: Waves) -> ComplexArray:
        """d lambda / d k between the waves: u_i^H (dK/dk - lambda dM/dk - h dD/dk) u_j over the slope by lambda, Hermitian,
        (2, n, n), scaled over rad/m.

        Its diagonal is Hellmann-Feynman's derivative; in a degenerate group the eigenvalues of the group's block along a
        direction are. dT/dk_x = i r_x T with r the places of the cell's degrees of freedom from their free ones.
        """
        u, cell = waves.dofs, self.cell
        count = cell.interface.count
        stiff, heavy, lost = times(cell.stiffness, u), times(cell.mass, u), times(cell.dropped, u[:count])
        middle = (waves.eigenvalue[:, None] + waves.eigenvalue) / 2.0  # equal within a degenerate group
        own = np.einsum("in,in->n", u[:count].conj(), lost).real
        # K - m M - h(m) D depends on m through h, too: its derivative by m along u is -(1 + h'(m) u^H D u) instead of -1
        weight = 1.0 / np.sqrt(1.0 + cell.residual.slope(waves.eigenvalue) * own)
        out, places = [], self.offset @ cell.vectors_m
        for axis in (0, 1):
            turned = -1j * (places[:, axis, None] * u).conj().T
            part = (
                turned @ stiff
                - (turned @ heavy) * middle
                - (turned[:, :count] @ lost) * cell.residual.softening(middle)
            )
            out.append(weight[:, None] * (part + part.conj().T) * weight)
        return np.array(out)

    def group_velocity(self, waves: Waves) -> FloatArray:
        """d omega / d k = (d lambda / d k) / (2 omega) of each wave as it stands, m/s, (n, 2); NaN for still waves."""
        rate = np.einsum("aii->ia", self.slopes(waves)).real
        root = np.sqrt(np.where(waves.eigenvalue > self.rounding, waves.eigenvalue, np.nan))
        return np.asarray(self.cell.scale.angular * rate / (2.0 * root[:, None]))

    @cached_property
    def rounding(self) -> float:
        """Scaled eigenvalues below it are rigid-body modes."""
        return float(ROUNDING * np.abs(self.cell.stiffness).max() / np.abs(self.cell.mass).max())

    def _solve(self, wavevector: FloatArray, count: int) -> tuple[FloatArray, ComplexArray]:
        """The lowest eigenvalues (n,) of the pencil and its vectors (dof, n) of the free degrees of freedom."""
        turn, matrices = self.c2_symmetry, self.pencil(wavevector)
        stiffness, mass = (turn.turned(matrix, wavevector).real for matrix in matrices) if turn else matrices
        try:
            with one_thread():
                values, free = eigh(stiffness, mass, subset_by_index=[0, min(count, self.dof) - 1], driver="gvx")
        except LinAlgError as fault:
            face = self.cell.interface
            degrees_text = f"boundary functions of degree {face.along} along and {face.through} through the thickness"
            raise SolverError(
                f"{degrees_text} are more than the cell's mesh can hold: refine it or lower them"
            ) from fault
        free = turn.diagonal(wavevector)[:, None] * free if turn else free
        still = np.abs(values) < self.rounding
        if _in_phase(self._phases(wavevector)):
            axes = 2 if self.cell.grounded else 3
            moved = np.empty((self.dof, axes))
            moved[self.column] = rigid_boundary(self.cell)[:, :axes]
            still |= _translates(moved, matrices[1], free)
        return np.where(still, 0.0, values), free

    def _phases(self, wavevector: FloatArray) -> ComplexArray:
        return np.asarray(np.exp(1j * self.offset @ (self.cell.vectors_m @ wavevector)))

    def up_to(self, face: Interface, top_hz: float) -> ReducedLattice:
        """The lattice of the same mesh reduced to boundary functions of lower degrees and modes up to top_hz."""
        return ReducedLattice(replace(restricted(self.cell, face, top_hz), mesh_error=None, further=None))


class Periodic:
    """Reduced cells of one height and width side by side in one or several rows, repeated by a1 and a2."""

    def __init__(self, cells: Sequence[Cell], shift: int = 0, rows: int = 1) -> None:
        self.cells, self.shift, self.rows, first = tuple(cells), shift, rows, cells[0]
        self.ties = Ties(first.interface, [len(cell.fixed_hz) for cell in cells], shift, rows)
        self.dof, self.scale = self.ties.dof, first.scale
        (ax, ay), (bx, by) = first.vectors_m.tolist()
        count = len(cells) // rows
        self.lattice = Lattice((count * ax, count * ay), (rows * (bx + shift * ax), rows * (by + shift * ay)))

    @property
    def middles_m(self) -> FloatArray:
        """Positions of the cells' middles along x from the first one's, (cells,), m."""
        row, place = np.divmod(np.arange(len(self.cells)), self.ties.count)
        return np.asarray(self.cells[0].size_m[0] * (place + self.shift * row))

    def parts(self, dofs: ComplexArray) -> list[tuple[Cell, ComplexArray]]:
        """Each cell with its own of the cells' degrees of freedom (dof, n)."""
        return list(zip(self.cells, np.split(dofs, self.ties.starts[1:-1]), strict=True))

    def reduced(self, transform: ComplexArray, matrix: Callable[[Cell], FloatArray]) -> ComplexArray:
        """Hermitian sum of T_c^H A_c T_c over the cells, A_c a matrix of each."""
        return np.asarray(sum(own.conj().T @ (matrix(cell) @ own) for cell, own in self.parts(transform)))

    def at(self, wavevector: FloatArray) -> BlochPlate:
        """The cells joined at a wavevector (2,) in rad/m."""
        return BlochPlate(self, np.asarray(wavevector, dtype=float))

    def frequencies(self, wavevector: FloatArray, count: int) -> FloatArray:
        """The `count` lowest Bloch frequencies at a wavevector (2,) in rad/m, ascending, Hz (a dense solve misses none)."""
        return self.at(wavevector).waves(count)[0]


@dataclass(frozen=True)
class BlochPlate:
    """Cells joined to their images at a wavevector (2,) in rad/m, as cells are joined to a plate."""

    periodic: Periodic
    wavevector: FloatArray

    @property
    def dof(self) -> int:
        """Free degrees of freedom."""
        return self.periodic.dof

    @property
    def cells(self) -> list[Cell]:
        """The different cells."""
        return list({id(cell): cell for cell in self.periodic.cells}.values())

    @cached_property
    def placed_cells(self) -> list[PlacedCell]:
        """Every cell with the free degrees of freedom that its own follow, and their phases."""
        ties, cells = self.periodic.ties, self.periodic.cells
        phase = np.exp(1j * ties.offset @ (self.periodic.lattice.phases(self.wavevector)))
        bounds = ties.starts[1:-1]
        own = zip(cells, self.periodic.middles_m, np.split(ties.column, bounds), np.split(phase, bounds), strict=True)
        height, row = cells[0].size_m[1], ties.count
        return [
            PlacedCell(cell, (float(x), place // row * height), column, turn, 1)
            for place, (cell, x, column, turn) in enumerate(own)
        ]

    @cached_property
    def matrices(self) -> tuple[ComplexArray, ComplexArray]:
        """Hermitian K and M, (dof, dof) each."""
        if self.periodic.rows == 1:
            transform = self.periodic.ties.closed(self.periodic.lattice.phases(self.wavevector))
            stiffness, mass = (self.periodic.reduced(transform, attrgetter(name)) for name in ("stiffness", "mass"))
            return stiffness, mass
        return self._summed("stiffness"), self._summed("mass")

    def _summed(self, name: str) -> ComplexArray:
        """Sum of the cells' matrices, entry by entry: of many cells, most of a transformation is zero."""
        out = np.zeros((self.dof, self.dof), dtype=complex)
        for placed in self.placed_cells:
            phase = placed.coefficient
            entries = phase.conj()[:, None] * getattr(placed.cell, name) * phase
            np.add.at(out, np.ix_(placed.dofs, placed.dofs), entries)
        return out

    def pencil(self) -> PlainPencil:
        """Hermitian K and M, (dof, dof) each."""
        stiffness, mass = (sp.csc_array(matrix) for matrix in self.matrices)
        return PlainPencil(stiffness, mass, self.periodic.scale)

    def waves(self, count: int) -> tuple[FloatArray, ComplexArray]:
        """The `count` lowest frequencies, ascending, Hz, and the free degrees of freedom (dof, count) of the waves."""
        stiffness, mass = self.matrices
        with one_thread():
            values, waves = eigh(stiffness, mass, subset_by_index=[0, min(count, self.dof) - 1])
        still = np.abs(values) < ROUNDING * np.abs(stiffness).max() / np.abs(mass).max()
        if all(_in_phase(placed.coefficient) for placed in self.placed_cells):
            moved = np.empty((self.dof, 3))
            for placed in self.placed_cells:
                moved[placed.dofs] = rigid_boundary(placed.cell)[:, :3]
            still |= _translates(moved, mass, waves)
        return self.periodic.scale.frequency(np.where(still, 0.0, values)), waves

    def softened(self, count: int) -> FloatArray:
        """The `count` lowest frequencies, Hz, coupled once more by the discarded modes, as `ReducedLattice.waves` does."""
        stiffness, mass = self.matrices
        size = min(len(self.periodic.cells) * (count + SPARE + 2), self.dof)
        with one_thread():
            values, waves = eigh(stiffness, mass, subset_by_index=[0, size - 1])
        rounding = ROUNDING * np.abs(stiffness).max() / np.abs(mass).max()
        if len(values) < self.dof:
            values = values[: max(degenerate(values, rounding)[-1].start, count)]
        waves, flexibility = waves[:, : len(values)], np.zeros((len(values), len(values)), dtype=complex)
        for placed in self.placed_cells:
            u = self.cell_vectors(placed, waves)[: placed.cell.interface.count]
            flexibility += u.conj().T @ times(placed.cell.dropped, u)
        lowest = min((cell.residual for cell in self.cells), key=lambda modes: modes.edge)
        coupled = lowest.coupled(np.where(np.abs(values) < rounding, 0.0, values), flexibility)[0]
        return self.periodic.scale.frequency(np.where(np.abs(coupled) < rounding, 0.0, coupled)[:count])

    def cell_vectors(self, placed_cell: PlacedCell, vectors: ComplexArray) -> ComplexArray:
        """A cell's degrees of freedom (cell dof, k) from the free ones (dof, k)."""
        return np.asarray(placed_cell.coefficient[:, None] * vectors[placed_cell.dofs])

    def widened(self) -> BlochPlate:
        """Return the plate with the cells' further boundary functions."""
        cells = [with_further(cell) for cell in self.periodic.cells]
        return replace(self, periodic=Periodic(cells, self.periodic.shift, self.periodic.rows))


def _in_phase(phases: FloatArray | ComplexArray) -> bool:
    """Whether every degree of freedom moves as its images do."""
    return bool(np.abs(phases - 1.0).max() <= IN_PHASE)


def _translates(moved: FloatArray, mass: ComplexArray, waves: ComplexArray) -> BoolArray:
    """Which waves (dof, n) move the whole lattice as one along `moved` (dof, 3), (n,): they have no frequency.

    A soft neck under a heavy body has elastic waves so slow that rounding of the plate's stiffness hides them.
    """
    weighted = moved.T @ mass
    along = weighted @ waves
    return np.asarray(np.sum(along.conj() * np.linalg.solve(weighted @ moved, along), axis=0).real > TRANSLATION)


def degenerate(eigenvalue: FloatArray, rounding: float) -> list[slice]:
    """Group ascending eigenvalues that count as one.

    Parameters
    ----------
    eigenvalue : ndarray, shape (n,)
        Scaled eigenvalues, ascending.
    rounding : float
        Scaled distance below which neighbours count as one, whatever their size.

    Returns
    -------
    list of slice
        Consecutive groups that cover all eigenvalues; a simple one is a group of its own.
    """
    apart = np.diff(eigenvalue) > np.maximum(EQUAL * np.abs(eigenvalue[1:]), rounding)
    bounds = [0, *(np.flatnonzero(apart) + 1), len(eigenvalue)]
    return [slice(int(low), int(high)) for low, high in pairwise(bounds)]


def times(matrix: FloatArray, vectors: ComplexArray) -> ComplexArray:
    """Multiply real matrices by complex vectors without a complex copy of the matrices.

    Parameters
    ----------
    matrix : ndarray, shape (..., m, n)
        Real matrices.
    vectors : ndarray, shape (n, k)
        Complex vectors.

    Returns
    -------
    ndarray, shape (..., m, k)
        Complex products.
    """
    return np.asarray((matrix @ np.ascontiguousarray(vectors).view(float)).view(complex))
