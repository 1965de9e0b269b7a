"""Bloch waves of reduced cells side by side that repeat along two lattice vectors, such as staggered rows.

Along a1 = (n w, 0) the n cells of width w repeat, along a2 = (s w, h) the row does, s cells further along x: staggered rows
are a lattice of one row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh

from geometry.elements import ComplexArray, FloatArray
from geometry.lattice import Lattice
from solvers.fem.eigen import PlainPencil
from solvers.superelement.cell import Cell, with_further
from solvers.superelement.interface import Ties
from solvers.superelement.lattice import ROUNDING
from solvers.superelement.plate import PlacedCell
from solvers.threads import one_thread


class Periodic:
    """Reduced cells of one height and width side by side, repeated by a1 and a2."""

    def __init__(self, cells: Sequence[Cell], shift: int = 0) -> None:
        self.cells, self.shift, first = tuple(cells), shift, cells[0]
        self.ties = Ties(first.interface, [len(cell.fixed_hz) for cell in cells], shift)
        self.dof, self.scale = self.ties.dof, first.scale
        width, height = first.size_m[:2]
        self.lattice = Lattice((len(cells) * width, 0.0), (shift * width, height))

    @property
    def middles_m(self) -> FloatArray:
        """Where the cells' middles stand along x, from the first one's, (cells,)."""
        return np.asarray(self.lattice.a1_m[0] / len(self.cells) * np.arange(len(self.cells)))

    def parts(self, dofs: ComplexArray) -> list[tuple[Cell, ComplexArray]]:
        """Each cell with its own of the cells' degrees of freedom (dof, n)."""
        return list(zip(self.cells, np.split(dofs, self.ties.starts[1:-1]), strict=True))

    def reduced(self, transform: ComplexArray, name: str) -> ComplexArray:
        """Hermitian sum of T_c^H A_c T_c over the cells, A_c their `stiffness` or `mass`."""
        return np.asarray(sum(own.conj().T @ (getattr(cell, name) @ own) for cell, own in self.parts(transform)))

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
        return [PlacedCell(cell, (float(x), 0.0), column, turn, 1) for cell, x, column, turn in own]

    @cached_property
    def matrices(self) -> tuple[ComplexArray, ComplexArray]:
        """Hermitian K and M, (dof, dof) each."""
        transform = self.periodic.ties.closed(self.periodic.lattice.phases(self.wavevector))
        return self.periodic.reduced(transform, "stiffness"), self.periodic.reduced(transform, "mass")

    def pencil(self) -> PlainPencil:
        """The same."""
        stiffness, mass = (sp.csc_array(matrix) for matrix in self.matrices)
        return PlainPencil(stiffness, mass, self.periodic.scale)

    def waves(self, count: int) -> tuple[FloatArray, ComplexArray]:
        """The `count` lowest frequencies, ascending, Hz, and the free degrees of freedom (dof, count) of the waves."""
        stiffness, mass = self.matrices
        with one_thread():
            values, waves = eigh(stiffness, mass, subset_by_index=[0, min(count, self.dof) - 1])
        rounding = ROUNDING * np.abs(stiffness).max() / np.abs(mass).max()
        return self.periodic.scale.frequency(np.where(np.abs(values) < rounding, 0.0, values)), waves

    def cell_vectors(self, placed_cell: PlacedCell, vectors: ComplexArray) -> ComplexArray:
        """A cell's degrees of freedom (cell dof, k) from the free ones (dof, k)."""
        return np.asarray(placed_cell.coefficient[:, None] * vectors[placed_cell.dofs])

    def widened(self) -> BlochPlate:
        """The same with the further boundary functions that the cells know."""
        cells = [with_further(cell) for cell in self.periodic.cells]
        return replace(self, periodic=Periodic(cells, self.periodic.shift))
