"""Which designs a class's basis is made from: one after another the one whose motions those before tell worst (binev2011).

Asked on a coarser mesh of the same topology, where every design's motions cost little and lie beside each other as they do on
the finer one.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geometry.elements import FloatArray
from solvers.parametric.affine import Sizes
from solvers.parametric.block import Block

MODES = 6  # clamped modes of every design, beside its answers to the boundary


def chosen(block: Block, designs: Sequence[Sizes], missed: float) -> list[Sizes]:
    """The first design, then as many as it takes until no motion of unit strain energy of any design has more than `missed`
    of that energy outside the span of those chosen.
    """
    left = dict(zip(designs, _motions(block, designs), strict=True))
    taken: list[Sizes] = []
    worst = designs[0]
    while left:
        taken.append(worst)
        span = _orthonormal(left.pop(worst))
        left = {sizes: motions - span @ (span.T @ motions) for sizes, motions in left.items()}
        energy = {sizes: float(np.einsum("ij,ij->j", motions, motions).max()) for sizes, motions in left.items()}
        worst = max(energy, key=lambda sizes: energy[sizes], default=worst)
        if energy.get(worst, 0.0) <= missed:
            break
    return taken


def _motions(block: Block, designs: Sequence[Sizes]) -> list[FloatArray]:
    """What the inside does at each design, in coordinates in which the strain energy of the reference design is the length;
    rigid-body modes, which every basis has, taken out.
    """
    stiffness, _ = block.stretched(block.cell.reference)
    root = np.linalg.cholesky(stiffness[block.inner][:, block.inner].toarray()).T
    still = _orthonormal(root @ np.hstack([block.rigid(sizes) for sizes in designs]))
    out = []
    for sizes in designs:
        motions = root @ np.hstack(block.inner_shapes(sizes, MODES))
        out.append(motions - still @ (still.T @ motions))
    return out


def _orthonormal(motions: FloatArray) -> FloatArray:
    left, size, _ = np.linalg.svd(motions, full_matrices=False)
    return np.asarray(left[:, size > 1e-9 * size[0]])
