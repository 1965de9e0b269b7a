"""A symmetry class reduced over the box of designs: affine matrices among boundary functions and a basis of the inside."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh

from geometry.elements import FloatArray, IntArray
from solvers.fem.surface import face_quadrature
from solvers.parametric.affine import AffineForm, Sizes
from solvers.parametric.block import Block

MODES = 12  # clamped modes of every sampled design
RIGID = 1e-12  # of the largest energy of a rigid motion's inside: less is rounding
KEPT = 1e-5  # of the largest: share of the snapshots' energy that a function must bring


@dataclass(frozen=True)
class ReducedBlock:
    """One class: signs under x -> -x, y -> -y, x <-> y; the first `functions` of n basis functions live on the boundary.

    stiffness (q, n, n), mass (r, n, n), pillar_mass (s, n, n): the affine matrices; touch (p, n): u_z at points of the
    touch face; shares (k,), coordinates (k, f, m): the boundary polynomials at ratios of side to pitch, themselves
    polynomials of that ratio of degree below k; parity (boundary, m): the polynomials among the cell's own.
    """

    signs: IntArray
    functions: int
    stiffness: FloatArray
    mass: FloatArray
    pillar_mass: FloatArray
    touch: FloatArray
    shares: FloatArray
    coordinates: FloatArray
    parity: FloatArray

    def boundary(self, share: float) -> FloatArray:
        """The boundary polynomials at a ratio of side to pitch among the boundary functions, (f, m)."""
        apart = share - self.shares
        others = ~np.eye(len(apart), dtype=bool)
        steps = self.shares[:, None] - self.shares
        weights = [np.prod(apart[keep] / step[keep]) for keep, step in zip(others, steps, strict=True)]
        return np.asarray(np.tensordot(weights, self.coordinates, axes=1))


def reduced_block(block: Block, designs: Iterable[Sizes], kept: float = KEPT) -> ReducedBlock:
    """Gather what the inside does at every design, keep what brings `kept` of the energy, and project every matrix."""
    inner = inner_basis(block, designs, kept)
    whole = np.zeros((block.forms.dof, block.functions.shape[1] + inner.shape[1]))
    whole[block.on_boundary, : block.functions.shape[1]] = block.functions
    whole[block.inner, block.functions.shape[1] :] = inner
    rule = face_quadrature(block.cell.mesh, "touch")
    return ReducedBlock(
        np.array(block.signs),
        block.functions.shape[1],
        _projected(block, "stiffness", whole),
        _projected(block, "mass", whole),
        _pillar(block, block.cell.pillar_mass, whole),
        np.asarray(rule.interpolation @ (block.forms.fold @ whole)[2::3]),
        block.shares,
        np.array([block.coordinates(block.of_share(share)) for share in block.shares]),
        block.parity,
    )


def inner_basis(block: Block, designs: Iterable[Sizes], kept: float) -> FloatArray:
    """Functions of the inside (inner, r), orthonormal in the strain energy of the reference design (a POD, sirovich1987).

    The rigid motions of every design are among them, so that none meets a force.
    """
    designs = list(designs)
    stiffness, _ = block.stretched(block.cell.reference)
    energy = sp.csr_array(stiffness[block.inner][:, block.inner])
    rigid = orthonormal(np.hstack([block.rigid(sizes) for sizes in designs]), energy, RIGID)
    snapshots = np.hstack([part for sizes in designs for part in block.inner_shapes(sizes, MODES)])
    snapshots -= rigid @ (rigid.T @ (energy @ snapshots))
    return np.hstack([rigid, orthonormal(snapshots, energy, kept)])


def orthonormal(functions: FloatArray, energy: sp.csr_array, kept: float) -> FloatArray:
    """A basis of what has more than `kept` of the largest energy among functions (n, m), orthonormal in it."""
    size, turn = eigh(functions.T @ (energy @ functions), overwrite_a=True, check_finite=False)
    chosen = size > kept * size[-1]
    return np.asarray(functions @ (turn[:, chosen] / np.sqrt(size[chosen])))


def _projected(block: Block, kind: str, whole: FloatArray) -> FloatArray:
    forms = block.forms
    count = len(getattr(forms, kind))
    return symmetric(np.array([whole.T @ (forms.matrix(kind, row) @ whole) for row in np.eye(count)]))


def _pillar(block: Block, form: AffineForm, whole: FloatArray) -> FloatArray:
    nodal = np.asarray(block.forms.fold @ whole)
    nodes = len(nodal) // 3
    flat = nodal.reshape(nodes, -1)
    return symmetric(np.array([nodal.T @ np.asarray(m @ flat).reshape(nodal.shape) for m in form.matrices]))


def symmetric(matrices: FloatArray) -> FloatArray:
    return np.asarray((matrices + matrices.transpose(0, 2, 1)) / 2.0)
