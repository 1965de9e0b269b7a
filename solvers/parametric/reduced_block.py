"""A symmetry class reduced over the box of designs: the designs that its basis is made from, and the affine matrices in it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh

from geometry.elements import FloatArray, IntArray
from solvers.fem.surface import face_quadrature
from solvers.parametric.affine import AffineCell, Sizes
from solvers.parametric.bare import bare_forms, bare_parity
from solvers.parametric.block import Block
from solvers.parametric.sectors import Signs
from solvers.superelement.interface import Interface

MODES = 12  # clamped modes of every sampled design
NOVEL = 10.0  # times KEPT, beside a snapshot's unit energy: less than that a design does not add
RIGID = 1e-12  # of the largest energy of a rigid motion's inside: less is rounding
ALL = 1e-12  # of the energy: every function of a single design
KEPT = 1e-5  # of the largest: share of the snapshots' energy that a function must bring
ONCE = np.zeros((1, 6), dtype=np.int64)  # exponents of one design's own matrix
# of a bare panel's, whose stretches are the thickness and the pitch: by the derivatives across the plate, 0, 1 and 2
BARE_STIFFNESS = np.array([[1, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 1], [-1, 0, 0, 0, 0, 2]])
BARE_MASS = np.array([[1, 0, 0, 0, 0, 2]])
ASKED = 6  # clamped modes of a design that may be chosen, beside its answers to the boundary


@dataclass(frozen=True)
class ReducedBlock:
    """One class: signs under x -> -x, y -> -y, x <-> y; the first `functions` of n basis functions live on the boundary.

    stiffness (q, n, n), mass (r, n, n): the affine matrices, and the exponents of their stretches; touch (p, n): u_z at points
    of the touch face; shares (k,), coordinates (k, f, m): the boundary polynomials at ratios of the block's width to the
    panel's, themselves polynomials of that ratio of degree below k; parity (boundary, m): the polynomials among the cell's own.
    """

    signs: IntArray
    functions: int
    stiffness: FloatArray
    mass: FloatArray
    touch: FloatArray
    shares: FloatArray
    coordinates: FloatArray
    parity: FloatArray
    stiffness_exponents: IntArray
    mass_exponents: IntArray

    def boundary(self, share: float) -> FloatArray:
        """The boundary polynomials at a ratio of the block's width to the panel's among the boundary functions, (f, m)."""
        apart = share - self.shares
        others = ~np.eye(len(apart), dtype=bool)
        steps = self.shares[:, None] - self.shares
        weights = [np.prod(apart[keep] / step[keep]) for keep, step in zip(others, steps, strict=True)]
        return np.asarray(np.tensordot(weights, self.coordinates, axes=1))


def reduced_block(block: Block, designs: Iterable[Sizes], everywhere: Iterable[Sizes] = ()) -> ReducedBlock:
    """Gather what the inside does at given designs, keep what brings KEPT of the energy, and project every matrix.

    The rigid-body modes of the designs `everywhere` are among the functions, too.
    """
    basis = inner_basis(block, designs, KEPT, everywhere)
    exponents = block.cell.stiffness.exponents, block.cell.mass.exponents
    return _block(block, basis, block.forms.each("stiffness"), block.forms.each("mass"), exponents)


def block_alone(block: Block, sizes: Sizes) -> ReducedBlock:
    """The class at one design, all that its inside does there kept: one matrix of each kind, whose exponents are zero."""
    stiffness, mass = block.stretched(sizes)
    return _block(block, inner_basis(block, [sizes], ALL), [stiffness], [mass], (ONCE, ONCE))


def _block(
    block: Block,
    inner: FloatArray,
    stiffness: Iterable[sp.csc_array],
    mass: Iterable[sp.csc_array],
    exponents: tuple[IntArray, IntArray],
) -> ReducedBlock:
    whole = np.zeros((block.forms.dof, block.functions.shape[1] + inner.shape[1]))
    whole[block.on_boundary, : block.functions.shape[1]] = block.functions
    whole[block.inner, block.functions.shape[1] :] = inner
    nodal = np.asarray(block.forms.fold @ whole)
    rule = face_quadrature(block.cell.mesh, "touch")
    return ReducedBlock(
        np.array(block.signs),
        block.functions.shape[1],
        symmetric(np.array([whole.T @ (one @ whole) for one in stiffness])),
        symmetric(np.array([whole.T @ (one @ whole) for one in mass])),
        np.asarray(rule.interpolation @ nodal[2::3]),
        block.shares,
        np.array([block.functions.T @ block.traces(block.of_share(share)) for share in block.shares]),
        block.parity,
        *exponents,
    )


def bare_block(cell: AffineCell, interface: Interface, signs: Signs) -> ReducedBlock:
    """A class of the bare panel beside the pillar's: its polynomials, whose stretches are those of thickness and pitch."""
    forms, mass = bare_forms(cell.box.panel_m(cell.reference), cell.plate, interface)
    own = bare_parity(interface, signs)
    b, parity = interface.count, interface.parity_basis({0: signs[0], 1: signs[1]})
    basis = np.zeros((len(mass), parity.shape[1] + len(own)))
    basis[:b, : parity.shape[1]], basis[b + own, parity.shape[1] + np.arange(len(own))] = parity, 1.0
    stiffness = np.array([basis.T @ form @ basis for form in forms])
    return ReducedBlock(
        np.array(signs), parity.shape[1], symmetric(stiffness) / 4.0, symmetric((basis.T @ mass @ basis)[None]) / 4.0,
        np.empty((0, basis.shape[1])), np.array([0.5]), np.eye(parity.shape[1])[None], parity,
        BARE_STIFFNESS, BARE_MASS,
    )  # fmt: skip


def inner_basis(block: Block, designs: Iterable[Sizes], kept: float, everywhere: Iterable[Sizes] = ()) -> FloatArray:
    """Functions of the inside (inner, r), orthonormal in the strain energy of the reference design (a POD, sirovich1987).

    The rigid-body modes of every design are among them, so that none meets a force. What a design's snapshots add to those of
    the designs before widens the space; the decomposition is of all snapshots' coordinates in it.
    """
    designs = list(designs)
    stiffness, _ = block.stretched(block.cell.reference)
    energy = sp.csr_array(stiffness[block.inner][:, block.inner])
    space = orthonormal(np.hstack([block.rigid(sizes) for sizes in (*designs, *everywhere)]), energy, RIGID)
    rigid, known = space.shape[1], []
    for sizes in designs:
        snapshots = np.hstack(block.inner_shapes(sizes, MODES))
        weighted = energy @ snapshots
        new = orthonormal(snapshots - space @ (space.T @ weighted), energy, 0.0, NOVEL * kept)
        space = np.hstack([space, new])
        known.append(space.T @ weighted)
    coordinates = np.zeros((space.shape[1] - rigid, sum(one.shape[1] for one in known)))
    for one, column in zip(known, np.cumsum([0, *(one.shape[1] for one in known[:-1])]), strict=True):
        coordinates[: len(one) - rigid, column : column + one.shape[1]] = one[rigid:]
    size, turn = eigh(coordinates @ coordinates.T)
    return np.hstack([space[:, :rigid], space[:, rigid:] @ turn[:, size > kept * size[-1]]])


def orthonormal(functions: FloatArray, energy: sp.csr_array, kept: float, least: float = 0.0) -> FloatArray:
    """A basis of what has more than `kept` of the largest energy, and `least`, among functions (n, m), orthonormal in it."""
    size, turn = eigh(functions.T @ (energy @ functions), overwrite_a=True, check_finite=False)
    chosen = size > max(kept * size[-1], least)
    return np.asarray(functions @ (turn[:, chosen] / np.sqrt(size[chosen])))


def symmetric(matrices: FloatArray) -> FloatArray:
    return np.asarray((matrices + matrices.transpose(0, 2, 1)) / 2.0)


# -- designs -----------------------------------------------------------------------------------------------------------
# One design after another, the next the one whose motions those before tell worst (binev2011). Asked on a coarser mesh of the
# same topology, where every design's motions cost little and lie beside each other as they do on the finer one.


def chosen(block: Block, designs: Sequence[Sizes], missed: float) -> list[Sizes]:
    """The first design, then as many as it takes until no motion of unit strain energy of any design has more than `missed`
    of that energy outside the span of those chosen.
    """
    left = dict(zip(designs, _motions(block, designs), strict=True))
    taken: list[Sizes] = []
    worst = designs[0]
    while left:
        taken.append(worst)
        span = _span(left.pop(worst))
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
    still = _span(root @ np.hstack([block.rigid(sizes) for sizes in designs]))
    out = []
    for sizes in designs:
        motions = root @ np.hstack(block.inner_shapes(sizes, ASKED))
        out.append(motions - still @ (still.T @ motions))
    return out


def _span(motions: FloatArray) -> FloatArray:
    left, size, _ = np.linalg.svd(motions, full_matrices=False)
    return np.asarray(left[:, size > 1e-9 * size[0]])
