"""Complex band structure of rows of cells at real frequencies, and rows between two half-plates."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial, reduce
from operator import attrgetter

import numpy as np
from scipy.linalg import eig, lu_factor, lu_solve

from geometry.elements import BoolArray, ComplexArray, FloatArray, IntArray
from solvers.errors import SolverError
from solvers.superelement.cell import Cell, ResidualModes
from solvers.superelement.lattice import Periodic
from solvers.superelement.moduli import Moduli, recombined
from solvers.superelement.plate import loss_of, part_of

# -- waves across rows -------------------------------------------------------------------------------------------------
# Complex band structure of rows of cells: all waves across the rows at a real frequency and a real wavenumber along them.
# One row's dynamic stiffness D = K - w^2 M, less the part of the discarded fixed-interface modes (`ResidualModes`), is
# condensed to its lower and upper edge; u(y + p) = lambda u(y) asks that the edges' forces balance. A row that is its
# own mirror image splits into symmetric and antisymmetric motion, and the Cayley variable tau = (1 - lambda)/(1 +
# lambda) turns the problem into a linear pencil in tau^2 of half the size: waves come in exact pairs k, -k, and no
# transfer matrix is formed (mead1973, zhong1995). Cells with the loss H of their materials have K - i H, since waves go as
# exp(i (k_y y - w t)): then every wave decays.

PROPAGATING = 1e-7  # of |log|lambda||: below it a wave carries energy and does not decay
MIRROR = 1e-9  # relative: how far a row may be from its mirror image
TINY = 1e-150
MAX_KEPT = 128  # frequencies of a row that keeps its waves, the longest unused dropped: less than a megabyte each


@dataclass(frozen=True)
class RowStiffness:
    """A row's dynamic stiffness between its lower (b) and upper (t) edge at one frequency, in the units of the cell."""

    bb: ComplexArray
    bt: ComplexArray
    tb: ComplexArray
    tt: ComplexArray


@dataclass(frozen=True)
class RowWaves:
    """The waves that go or decay towards +y, the least decaying first.

    factor (n,): lambda, |lambda| <= 1; edge (m, n): displacements of the lower edge; force (m, n): forces on it;
    dofs (cell dof, n): the cell's motion; flux (n,): power upwards, Im(force^H edge)/2, in scaled units over w (0 for
    decaying waves); stiffness: the row's own between its edges.
    """

    factor: ComplexArray
    edge: ComplexArray
    force: ComplexArray
    dofs: ComplexArray
    flux: FloatArray
    pitch_m: float
    stiffness: RowStiffness

    @property
    def wavenumber_per_m(self) -> ComplexArray:
        """k_y with lambda = exp(i k_y p); a decaying wave has Im k_y > 0, and |Re k_y| <= pi/p."""
        return np.asarray(-1j * np.log(np.where(self.factor == 0.0, TINY, self.factor)) / self.pitch_m)

    @property
    def db_per_row(self) -> FloatArray:
        """Decay over one row, -20 log10|lambda|, dB."""
        return np.asarray(-20.0 * np.log10(np.maximum(np.abs(self.factor), TINY)))


class Row:
    """Cells repeated along x with a fixed phase exp(i k_x a1); the edges y- and y+ are free to meet neighbours.

    Of shifted rows the upper edge stands in the order of the next one's lower edge, and without the phase of the shift: what is
    left from row to row is exp(i k_y p_y). moduli: of cells with the stiffness of each material, taken at each frequency.
    """

    def __init__(self, cells: Cell | Periodic, kx_per_m: float, moduli: Moduli | None = None) -> None:
        self.periodic, self.moduli = cells if isinstance(cells, Periodic) else Periodic([cells]), moduli
        self.cell, self.kx, ties = self.periodic.cells[0], kx_per_m, self.periodic.ties
        self.edge, self.inner = ties.edge, ties.inside
        self.transform = ties.open(self.periodic.lattice.phases(np.array([kx_per_m, 0.0])))

    @cached_property
    def stiffness(self) -> ComplexArray:
        """Hermitian K of [lower edge, upper edge, inner]."""
        return self.periodic.reduced(self.transform, attrgetter("stiffness"))

    @cached_property
    def mass(self) -> ComplexArray:
        """Hermitian M of [lower edge, upper edge, inner]."""
        return self.periodic.reduced(self.transform, attrgetter("mass"))

    @cached_property
    def _flexibility(self) -> list[tuple[ResidualModes, ComplexArray]]:
        """Hermitian residual flexibility of each cell's discarded fixed-interface modes, numbered likewise."""
        parts = [(cell, own[: len(cell.dropped)]) for cell, own in self.periodic.parts(self.transform)]
        return [(cell.residual, np.asarray(own.conj().T @ (cell.dropped @ own))) for cell, own in parts]

    @cached_property
    def loss(self) -> ComplexArray | None:
        """Hermitian loss of [lower edge, upper edge, inner]; None for cells without it."""
        if any(cell.loss is None for cell in self.periodic.cells):
            return None
        return self.periodic.reduced(self.transform, loss_of)

    @cached_property
    def by_material(self) -> ComplexArray:
        """Hermitian stiffness of each material, (materials, n, n)."""
        count = len(self.moduli.materials) if self.moduli else 0
        return np.array([self.periodic.reduced(self.transform, partial(part_of, number)) for number in range(count)])

    def dynamic(self, value: float) -> ComplexArray:
        """Dynamic stiffness at a scaled eigenvalue, Hermitian without loss."""
        if self.moduli:
            return self._at_moduli(self.moduli, value)
        softer = sum(float(left_out.softening(value)) * part for left_out, part in self._flexibility)
        elastic = np.asarray(self.stiffness - value * self.mass - softer)
        return elastic if self.loss is None else np.asarray(elastic - 1j * self.loss)

    def _at_moduli(self, moduli: Moduli, value: float) -> ComplexArray:
        """`dynamic` with the moduli at its frequency; stiffer cells have discarded modes at higher eigenvalues."""
        tone = float(self.cell.scale.frequency(np.array(value)))
        middle = moduli.middle(tone)
        softer = sum(
            float(ResidualModes(middle * left_out.edge).softening(value)) / middle * part
            for left_out, part in self._flexibility
        )
        stiffness = recombined(moduli.factors(tone).conj(), self.stiffness, self.by_material)
        return np.asarray(stiffness - value * self.mass - softer)

    @cached_property
    def mirror_sign(self) -> FloatArray:
        """Signs of an edge's degrees of freedom under the mirror y -> -y: -1 for u_y."""
        sign = np.ones(self.edge)
        sign[1::3] = -1.0
        return sign

    def condensed(self, frequency_hz: float) -> tuple[RowStiffness, ComplexArray]:
        """Stiffness between the edges, and the inner degrees of freedom (inner, 2 m) per unit of the edges' motion.

        Raises SolverError where the frequency falls on a resonance of the row with both edges clamped.
        """
        dynamic = self.dynamic(self.cell.scale.eigenvalue(frequency_hz))
        n = 2 * self.edge
        inner, coupling = dynamic[n:, n:], dynamic[n:, :n]
        factors = lu_factor(inner)
        pivots = np.abs(np.diag(factors[0]))
        if pivots.min() < 1e-13 * pivots.max():
            raise SolverError(
                f"{frequency_hz:.6g} Hz is a resonance of the row with its edges clamped: shift it slightly"
            )
        follow = -lu_solve(factors, coupling)
        edges = dynamic[:n, :n] + dynamic[:n, n:] @ follow
        if not (self.moduli.is_lossy if self.moduli else self.loss is not None):
            edges = (edges + edges.conj().T) / 2.0
        m = self.edge
        return RowStiffness(edges[:m, :m], edges[:m, m:], edges[m:, :m], edges[m:, m:]), np.asarray(follow)

    def waves(self, frequency_hz: float) -> RowWaves:
        """Every wave towards +y at a frequency in Hz: as many as an edge has degrees of freedom. Errors as condensed."""
        if not frequency_hz > 0.0:
            raise SolverError(f"frequency = {frequency_hz} Hz: must be above 0")
        try:
            stiffness, follow = self.condensed(frequency_hz)
        except SolverError:
            stiffness, follow = self.condensed(frequency_hz * (1.0 + 1e-9))
        factor, edge = _paired(stiffness, self.mirror_sign) if self._symmetric(stiffness) else _general(stiffness)
        force = stiffness.bb @ edge + stiffness.bt @ (edge * factor)
        flux = np.imag(np.einsum("ik,ik->k", force.conj(), edge)) / 2.0
        decaying = np.abs(np.log(np.maximum(np.abs(factor), TINY))) > PROPAGATING
        factor, edge, force, flux = _upwards(factor, edge, force, flux, decaying, stiffness, self.mirror_sign)
        motion = np.vstack([edge, edge * factor])
        dofs = self.transform @ np.vstack([motion, follow @ motion])
        order = _least_decay_first(factor)
        pitch_m = self.periodic.lattice.a2_m[1]
        return RowWaves(factor[order], edge[:, order], force[:, order], dofs[:, order], flux[order], pitch_m, stiffness)

    def _symmetric(self, d: RowStiffness) -> bool:
        sign = self.mirror_sign
        size = np.abs(d.bb).max()
        same = np.abs(sign[:, None] * d.bb * sign - d.tt).max() + np.abs(sign[:, None] * d.bt * sign - d.tb).max()
        return bool(same < MIRROR * size)


def _least_decay_first(factor: ComplexArray) -> IntArray:
    """The order of waves of factors (n,) by their decay; those that decay alike, as pairs k, -k* do, by their phase."""
    decay = -np.log(np.maximum(np.abs(factor), TINY))
    order = np.argsort(decay, kind="stable")
    alike = np.cumsum(np.diff(decay[order], prepend=decay[order[0]]) > PROPAGATING)
    return np.asarray(order[np.lexsort((-np.angle(factor[order]), alike))])


class KeptRow(Row):
    """A row that keeps its waves by frequency: the plate beside the rows is the same whatever pillars stand on it."""

    def __init__(self, cells: Cell | Periodic, kx_per_m: float, moduli: Moduli | None = None) -> None:
        super().__init__(cells, kx_per_m, moduli)
        self.waves = lru_cache(MAX_KEPT)(super().waves)  # type: ignore[method-assign]

    @property
    def same(self) -> tuple[object, ...]:
        """Key, equal for rows with the same waves."""
        own = [
            (cell.size_m, cell.interface, cell.scale, cell.dropped_hz, *(part.tobytes() for part in matrices))
            for cell in self.periodic.cells
            for matrices in ((cell.stiffness, cell.mass, cell.dropped, *([] if cell.loss is None else [cell.loss])),)
        ]
        return self.kx, self.periodic.shift, self.moduli, *own


def _paired(d: RowStiffness, sign: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """A row that is its own mirror image: eigenvalues tau^2 of a pencil of the edge's size, lambda = (1-tau)/(1+tau).

    With q = (a, b) by the sign under the mirror, K_s = D_bb + D_bt S, K_t = D_bb - D_bt S, G = K_t - K_s:
    [K_s,aa  -G_ab; 0  K_t,bb] (a, tau b) = tau^2 [K_t,aa  0; -G_ba  K_s,bb] (a, tau b).
    """
    even, odd = np.flatnonzero(sign > 0), np.flatnonzero(sign < 0)
    together, apart = d.bb + d.bt * sign, d.bb - d.bt * sign
    coupling, back = ((apart - together)[np.ix_(*ends)] for ends in ((even, odd), (odd, even)))
    none, evens, odds = np.zeros_like(coupling), np.ix_(even, even), np.ix_(odd, odd)
    left = np.block([[together[evens], -coupling], [none.T, apart[odds]]])
    right = np.block([[apart[evens], none], [-back, together[odds]]])
    scale = np.abs(left).max()
    (alpha, beta), vectors = eig(left / scale, right / scale, homogeneous_eigvals=True)
    root = _root(alpha, beta)
    tau_over, one = root  # tau = tau_over / one, kept as a ratio where it is infinite
    factor = (one - tau_over) / (one + tau_over)
    edge = np.empty((len(sign), len(factor)), dtype=complex)
    edge[even] = vectors[: len(even)] * tau_over
    edge[odd] = vectors[len(even) :] * one
    still = np.abs(tau_over) < 1e-9 * np.abs(one)  # lambda = 1: the even part cannot be had from the ratio
    edge[np.ix_(even, np.flatnonzero(still))] = vectors[: len(even), still]
    return factor, edge / np.linalg.norm(edge, axis=0)


def _root(alpha: ComplexArray, beta: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """tau = sqrt(alpha/beta) with Re tau >= 0 as numerator and denominator of like size."""
    size = np.maximum(np.abs(alpha), np.abs(beta))
    alpha, beta = alpha / size, beta / size
    small = np.abs(beta) < np.abs(alpha)
    inverse = np.sqrt(np.where(small, beta / np.where(small, alpha, 1.0), 1.0))
    direct = np.sqrt(np.where(small, 1.0, alpha / np.where(small, 1.0, beta)))
    return np.where(small, 1.0, direct), np.where(small, inverse, 1.0)


def _general(d: RowStiffness) -> tuple[ComplexArray, ComplexArray]:
    """Any row: the quadratic pencil (lambda^2 D_bt + lambda (D_bb + D_tt) + D_tb) q = 0, waves with |lambda| <= 1."""
    m = len(d.bb)
    scale = np.abs(d.bb).max()
    zero, one = np.zeros((m, m)), np.eye(m)
    left = np.block([[zero, one], [-d.tb / scale, -(d.bb + d.tt) / scale]])
    right = np.block([[one, zero], [zero, d.bt / scale]])
    (alpha, beta), vectors = eig(left, right, homogeneous_eigvals=True)
    order = np.argsort(np.abs(alpha) / np.maximum(np.abs(beta), TINY), kind="stable")
    inner = order[: np.count_nonzero(np.abs(alpha) <= np.abs(beta) * (1.0 + 10.0 * PROPAGATING))]
    edge = vectors[:m, inner]
    return alpha[inner] / beta[inner], edge / np.linalg.norm(edge, axis=0)


def _upwards(
    factor: ComplexArray, edge: ComplexArray, force: ComplexArray, flux: FloatArray, decaying: BoolArray, d: RowStiffness,
    sign: FloatArray,
) -> tuple[ComplexArray, ComplexArray, ComplexArray, FloatArray]:  # fmt: skip
    """Select from each propagating pair the wave that carries energy towards +y; decaying waves keep |lambda| <= 1."""
    flux = np.where(decaying, 0.0, flux)
    paired = len(factor) == len(sign)
    down = ~decaying & (flux < 0.0)
    if not paired:
        keep = decaying & (np.abs(factor) < 1.0) | (~decaying & (flux > 0.0))
        return factor[keep], edge[:, keep], force[:, keep], flux[keep]
    factor, edge, force, flux = factor.copy(), edge.copy(), force.copy(), flux.copy()
    # the mirror image of a wave downwards goes upwards: its lower edge is the image of the upper one
    factor[down] = 1.0 / factor[down]
    edge[:, down] = sign[:, None] * edge[:, down] / factor[down]
    force[:, down] = d.bb @ edge[:, down] + d.bt @ (edge[:, down] * factor[down])
    flux[down] = np.imag(np.einsum("ik,ik->k", force[:, down].conj(), edge[:, down])) / 2.0
    factor[~decaying] /= np.abs(factor[~decaying])
    return factor, edge, force, flux


# -- rows between half-plates ------------------------------------------------------------------------------------------
# Rows between two half-plates: the parts of a wave from the zone that are reflected, transmitted and converted.
# The rows are joined by their dynamic stiffness (never by transfer matrices); each half-plate answers with the waves
# that leave: f = F Phi^-1 q. Powers of the propagating waves add up to the incoming one's (mace2005).


@dataclass(frozen=True)
class Scattering:
    """Shares of the incoming power in each propagating wave of the half-plates, (n,): reflected and transmitted."""

    reflected: FloatArray
    transmitted: FloatArray


def chain(rows: Iterable[RowStiffness]) -> RowStiffness:
    """Join rows, which may differ, into one stack.

    Parameters
    ----------
    rows : iterable of RowStiffness
        At least one row at the same frequency, the lowest first.

    Returns
    -------
    RowStiffness
        Dynamic stiffness between the lower edge of the first row and the upper edge of the last.
    """
    return reduce(_joined, rows)


def _joined(lower: RowStiffness, upper: RowStiffness) -> RowStiffness:
    """Two stacks sharing an edge, which carries no outer force."""
    # forces on the shared edge balance: (tt + bb) q = -(tb q_below + bt q_above)
    middle = lower.tt + upper.bb
    follow = np.linalg.solve(middle, np.hstack([lower.tb, upper.bt]))
    m = len(middle)
    down, up = follow[:, :m], follow[:, m:]
    return RowStiffness(lower.bb - lower.bt @ down, -lower.bt @ up, -upper.tb @ down, upper.tt - upper.tb @ up)


def scatter(rows: RowStiffness, half: RowWaves, sign: FloatArray, incoming: int) -> Scattering:
    """Scatter a wave of the lower half-plate at rows above which the same plate goes on.

    The unknowns are r, t of q_0 = phi + S Phi r and q_N = Phi t: -f_phi + S F r + D_bb q_0 + D_bt q_N = 0,
    D_tb q_0 + D_tt q_N + F t = 0.

    Parameters
    ----------
    rows : RowStiffness
        Dynamic stiffness of the rows between their outermost edges.
    half : RowWaves
        All waves towards +y of the plate without pillars, at the same frequency and wavenumber along x.
    sign : ndarray, shape (m,)
        Signs S of an edge's degrees of freedom under the mirror y -> -y.
    incoming : int
        Index of the incoming wave phi in `half`.

    Returns
    -------
    Scattering
        Shares of the incoming power in the propagating waves, in their order in `half`.

    Raises
    ------
    SolverError
        If the incoming wave does not propagate.

    References
    ----------
    .. [1] mace2005 (docs/references.bib)
    """
    if not half.flux[incoming] > 0.0:
        raise SolverError("the incoming wave carries no energy: choose a frequency above its cut-off")
    phi, force = half.edge, half.force
    image, image_force = sign[:, None] * phi, sign[:, None] * force
    left = np.block([[image_force + rows.bb @ image, rows.bt @ phi], [rows.tb @ image, rows.tt @ phi + force]])
    right = np.concatenate([force[:, incoming] - rows.bb @ phi[:, incoming], -rows.tb @ phi[:, incoming]])
    size = np.abs(left).max(axis=0)
    answer: ComplexArray = np.linalg.solve(left / size, right) / size
    count = phi.shape[1]
    going = half.flux > 0.0
    power = half.flux / half.flux[incoming]
    reflected, transmitted = np.abs(answer[:count]) ** 2 * power, np.abs(answer[count:]) ** 2 * power
    return Scattering(reflected[going], transmitted[going])
