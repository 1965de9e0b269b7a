"""The parametric cell again, in a basis of what waves do inside: a tenth of the numbers, most of the accuracy.

The bases of `reduced_block` follow every boundary polynomial alike. Of the waves of some hundred designs and wavevectors, each
of unit energy, far fewer directions hold all but KEPT (sirovich1987); rigid motions stay exact. Matrices are rounded to single
precision, so that a page without Python has the same ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geometry.elements import FloatArray
from solvers.parametric.affine import PITCH, SIDE, Sizes
from solvers.parametric.bands import SLOWEST, lowest
from solvers.parametric.cell import ClassAtDesign, Inner, ParametricCell, rigid_span
from solvers.parametric.reduced_block import RIGID, ReducedBlock, orthonormal, symmetric
from solvers.parametric.sectors import Sector
from solvers.threads import one_thread

# of the largest energy of a direction, by how many classes there are: larger and more of them make too large a page
KEPT = {5: 1e-6, 4: 1e-5, 8: 3e-5}
INSIDE = Inner(8, 8)
FUNCTION = 1e-6  # of the largest singular value, of the boundary functions
SHARES = 9


def compressed(cell: ParametricCell, of: Sequence[Sector], count: int, designs: Sequence[Sizes]) -> ParametricCell:
    """The cell in a basis made from the lowest `count` waves of the designs at the sectors' wavevectors."""
    rigid: list[list[FloatArray]] = [[] for _ in cell.blocks]
    moving: list[list[FloatArray]] = [[] for _ in cell.blocks]
    with one_thread():
        for sizes in designs:
            parts = cell.parts(sizes, INSIDE, cell.interface)
            for number, block in enumerate(cell.blocks):
                span = rigid_span(block.parity, cell.interface, cell.box, sizes)
                rigid[number].append(parts[number].shapes[block.functions :, : len(span)] @ span)
            for sector in of:
                for number, motion in _inside(cell, parts, sector, count):
                    moving[number].append(motion)
        blocks = [_block(cell, *own) for own in zip(cell.blocks, rigid, moving, strict=True)]
    return replace(cell, blocks=tuple(blocks))


def _inside(
    cell: ParametricCell, parts: Sequence[ClassAtDesign], sector: Sector, count: int
) -> list[tuple[int, FloatArray]]:
    """Each class's block and what its inside does in the lowest waves of unit energy, (inside, waves)."""
    own, out = [parts[number] for number in sector.classes], []
    for basis, (values, edge, inner) in zip(sector.bases, lowest(own, sector.bases, count), strict=True):
        size, row, start = np.sqrt(np.maximum(values, 0.0) + SLOWEST), 0, 0
        free, inner = basis @ (edge / size), inner / size
        for number, part in zip(sector.classes, own, strict=True):
            width, modes = part.parity.shape[1], len(part.fixed_hz)
            motion = np.vstack([free[row : row + width], inner[start : start + modes]])
            stored = min(number, len(cell.blocks) - 1)
            out.append((stored, part.shapes[cell.blocks[stored].functions :] @ motion))
            row, start = row + width, start + modes
    return out


def _block(
    cell: ParametricCell, block: ReducedBlock, rigid: list[FloatArray], moving: list[FloatArray]
) -> ReducedBlock:
    f, box = block.functions, cell.box
    low, high = (np.array(edge) for edge in (box.low, box.high))
    most = high[SIDE] / (box.foot.widest * high[SIDE] + box.clearance_m)
    shares = box.foot.reach * np.linspace(low[SIDE] / high[PITCH] / box.narrow, most, SHARES)
    left, size, _ = np.linalg.svd(np.hstack([block.boundary(share) for share in shares]), full_matrices=False)
    boundary = left[:, size > FUNCTION * size[0]]
    energy = np.tensordot(np.ones(len(block.stiffness)), block.stiffness, axes=1)[f:, f:]
    known = any(part.size for part in rigid)
    still = orthonormal(np.hstack(rigid), energy, RIGID) if known else np.empty((len(energy), 0))
    inner = np.hstack([still, _leading(np.hstack(moving), still, energy, KEPT[len(cell.blocks)])])
    whole = np.zeros((block.stiffness.shape[1], boundary.shape[1] + inner.shape[1]))
    whole[:f, : boundary.shape[1]], whole[f:, boundary.shape[1] :] = boundary, inner

    def turned(matrices: FloatArray) -> FloatArray:
        return single(symmetric(np.array([whole.T @ matrix @ whole for matrix in matrices])))

    return replace(
        block, functions=boundary.shape[1], stiffness=turned(block.stiffness), mass=turned(block.mass),
        touch=single(block.touch @ whole), coordinates=single(boundary.T @ block.coordinates),
    )  # fmt: skip


def _leading(waves: FloatArray, still: FloatArray, energy: FloatArray, kept: float) -> FloatArray:
    """The directions of many motions (n, k) that hold all but `kept`, orthonormal in the energy and to `still`."""
    root = np.linalg.cholesky(energy)
    turned = root.T @ (waves - still @ (still.T @ (energy @ waves)))
    size, directions = np.linalg.eigh(turned @ turned.T)
    return np.asarray(np.linalg.solve(root.T, directions[:, size > kept * size[-1]]))


def single(values: FloatArray) -> FloatArray:
    """Values as single precision holds them."""
    return np.asarray(values, dtype=np.float32).astype(float)
