"""How many modes the meshes behind an assembled plate have where its reduced pencil has so many: a count, not an estimate.

The meshes coupled at their boundary functions have the boundary's dynamic stiffness S and the interiors' own eigenvalues,
N = N(S) + sum N(interior), both below lambda (wittrick1971). Every interior mode up to Lambda is kept, so the reduced pencil
counts the interiors' whole; what modes left out take from S is bounded (`Cell.dropped`) and only lowers it. Hence
N_reduced <= N <= N of the pencil with that bound taken from its stiffness.
"""

from __future__ import annotations

import numpy as np

from geometry.elements import FloatArray
from solvers.fem.eigen import PlainPencil, SymmetricPencil, count_below
from solvers.superelement.cell import Cell
from solvers.superelement.plate import AssembledPlate


def more_below(
    plate: AssembledPlate, pencil: SymmetricPencil, edge_hz: float, reduced: int | None = None
) -> int | None:
    """How many more modes the assembled meshes have at most below a frequency than the reduced pencil; None without a bound.

    `reduced`: the reduced pencil's own count there, rigid-body modes included, where it is known already.
    """
    value = pencil.scale.eigenvalue(edge_hz)
    if not all(np.isfinite(placed_cell.cell.growth(value)) for placed_cell in plate.placed_cells):
        return None

    def lost(cell: Cell) -> FloatArray:
        return cell.on_boundary(value**2 * float(cell.growth(value)) * cell.dropped)

    softer = PlainPencil(
        (pencil.stiffness - plate.of_cells(lost)).tocsc(), pencil.mass, pencil.scale, pencil.rigid_count
    )
    own = count_below(pencil, edge_hz) if reduced is None else reduced
    return count_below(softer, edge_hz) - own
