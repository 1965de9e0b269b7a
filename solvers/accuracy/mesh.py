"""The error of a mesh, from coarser meshes nested in it or, for tetrahedra, from its own recovered stresses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import factorial, inf, pi
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh

from geometry.elements import FloatArray, IntArray
from geometry.hex.scenes import HexSettings
from geometry.layout import Rim
from geometry.materials import Material
from geometry.mesh import AnyMesh, Mesh, jacobians
from solvers.accuracy.singularity import (
    CLAMPED as HELD,
)
from solvers.accuracy.singularity import (
    FREE,
    Wedge,
    antiplane_exponent,
    clamped_edge_exponent,
    edge_exponent,
    rim_error,
    rim_wedges,
)
from solvers.fem.assembly import Scale
from solvers.fem.eigen import PlainPencil, factor_near
from solvers.fem.factor import Factoriser
from solvers.fem.solid import Pencil, SolidModel

if TYPE_CHECKING:
    from solvers.superelement.cell import MeshError

# -- nested meshes -----------------------------------------------------------------------------------------------------
# The error of a mesh, estimated from two coarser ones nested in it: one without the innermost layer, one of an order less.
# Where displacements go as r^a at an edge, the finer mesh still errs by a share of the innermost layer's change
# that follows from a, the order and the layers (babuska1981); away from the edge the last order changed more than any
# further one will, except for motions of a parity that it did not change: lower modes of the class show what those
# hide. A body meshed whole needs no search for coarser modes. One inverse iteration about an s amid the modes u of the
# finer mesh solves (K_c - s M_c) v = P' M u, P the prolongation of the coarser mesh's fields to the finer one, and damps
# modes farther away than they are; Rayleigh's quotients on the span of all v are the coarser
# eigenvalues to second order in what is left, paired with the modes by their overlap (boffi2010).

BELOW, APART = 0.97, 0.01  # a shift, over the lowest eigenvalue, and its least relative distance from any eigenvalue
# of the last order's change away from the edge: more than further orders change there
SMOOTH, CLAMPED_SMOOTH = 0.035, 0.02
# of the last order's change at the edge: this part may come from elsewhere and cancel the edge's
EDGE_UNCERTAINTY = 0.5
# of the share at a clamped face next to elements longer than it is thick: the layer brings the smooth boundary layer, too.
# Ten zones of `python -m studies.error_bars`, elements 2 to 2.5 thicknesses long, have 0.42 to 0.75 of it left
LONG = 0.6
# the same at a pillar's clamped foot of elements of order 3, r widths high: where it stretches 0.9 of the share is left, and
# where it bends 1 / (1 + 0.54 r^2), of twelve pillars of 0.3 to 1 width (seed 7; `python -m studies.error_bars`)
STRETCHED, BENT = 0.9, 0.54
ALMOST_SMOOTH = 0.98  # an exponent: beyond, the layer brings next to nothing of an edge
# of the own error of the elements next to the innermost one, of motion in the plane across an edge and along it: as
# finite elements about wedges show (tests/solvers/accuracy/test_rim_by_elements.py)
OUTER_ACROSS, OUTER_ALONG = 0.65, 0.35
# part of the layer's change due to motion in the plane across a rim: 74 cells of `python -m studies.error_bars` and of seeds
# 7 and 8 err least with 0.65 to 0.85, and round pillars that twist have next to none of it
ACROSS = 0.7
# uncertainty of a share in half-ranges between both, by order: the higher it is, the more the weaker singularities differ
RANGES = {3: 0.15, 4: 1.1}
BESIDE = 0.5  # of an element's size: a side of another section nearer to the foot's than that is a layer there
# of a mode's energy: least part in motions that the elements resolve badly, the source of the whole error
UNRESOLVED = 0.5
# of the last order's change in a plate thinner than its elements are long: the rest is that order two locks in bending
UNLOCKED = 0.5
LAYER = 2.106  # decay of the slowest layer in the plane along a free edge, by half a thickness: sin 2x + 2x = 0 (horgan1983)
DEGREES = 12  # of a layer's degrees beyond the order, whose energies fall faster than a geometric series
HIDDEN = 0.5  # of the largest half-width by short waves of the modes below: the part that a mode may hide
# of the share: one radial function stands for the whole of an edge
RIM_ROUGH, CLAMPED_ROUGH, LONG_ROUGH = 0.1, 0.3, 0.15


@dataclass(frozen=True)
class ErrorFractions:
    """Fractions that turn the changes of two coarser meshes into a correction and its uncertainty.

    correction: fraction of the layer's change that remains; uncertainty: of that fraction; edge: change by the order over that
    by the layer.

    doubt: uncertain fraction of the layer's change beyond the edge's part in the order's change; order: of the mesh, 0 if no
    order less was meshed; waves: fraction of the order's change away from the edge that is due to short waves.
    """

    correction: float = 0.0
    uncertainty: float = 0.0
    edge: float = 0.0
    smooth: float = SMOOTH
    doubt: float = 0.0
    order: int = 0
    waves: float = 1.0

    @property
    def rim(self) -> float:
        """Uncertain fraction of the layer's change."""
        return self.uncertainty + EDGE_UNCERTAINTY * self.smooth * self.edge

    def half_width(self, layer: FloatArray, order: FloatArray) -> FloatArray:
        """Half-width of a figure's error bar from its changes on the mesh without the layer and on that of one order less."""
        return np.asarray(self.singular_part(layer, order) + self.smooth_part(layer, order))

    def of_modes(self, values: FloatArray, layer: FloatArray, order: FloatArray) -> FloatArray:
        """Half-widths for the modes of a class, or the waves at a wavevector, with eigenvalues (k,).

        The last order may not change a mode at all; its error is then estimated from lower modes with waves as short.
        """
        away, upwards = self.smooth_part(layer, order), np.argsort(values)
        shown = np.maximum.accumulate(away[upwards])
        away[upwards] = np.maximum(away[upwards], HIDDEN * shown)
        return np.asarray(self.singular_part(layer, order) + away)

    def singular_part(self, layer: FloatArray, order: FloatArray) -> FloatArray:
        """Part of the half-width due to the edge."""
        half = self.rim * np.abs(layer)
        if not self.doubt:
            return np.asarray(half)
        return np.asarray(
            half + self.doubt * self.correction * np.maximum(np.abs(layer) - np.abs(order) / self.edge, 0.0)
        )

    def smooth_part(self, layer: FloatArray, order: FloatArray) -> FloatArray:
        """Part of the half-width due to waves away from the edge."""
        return smooth_half_width(order - self.edge * layer, self.smooth, self.order, self.waves)


def shares_of(error: MeshError) -> ErrorFractions:
    """Return the error fractions of a reduced cell whose changes by coarser meshes are known.

    Parameters
    ----------
    error : MeshError
        The changes and their fractions.

    Returns
    -------
    ErrorFractions
        Correction and uncertainty.
    """
    return ErrorFractions(
        error.taken, error.spread, error.edge, doubt=EDGE_UNCERTAINTY if error.edge else 0.0, order=error.order
    )


def smooth_half_width(change: FloatArray, share: float, order: int, waves: float = 1.0) -> FloatArray:
    """Estimate the relative error of order p away from edges, for frequencies that order p - 1 overestimates by `change` more.

    Order p misses C_p (k h)^(2p) of an eigenvalue, C_p = (p! / (2p)!)^2 / (2p + 1): a change s implies
    w C_p / 2 (2 s / w C_(p-1))^(p/(p-1)) of a frequency, w = UNRESOLVED. It counts where it exceeds `share` of the change.

    Parameters
    ----------
    change : ndarray, any shape
        Relative changes by the last order.
    share : float
        Least error, as a fraction of the change.
    order : int
        p.
    waves : float, optional
        Fraction of the change that is due to waves short for the elements.

    Returns
    -------
    ndarray, shape of change
        Relative half-widths.

    References
    ----------
    .. [1] ainsworth2004 (docs/references.bib)
    """
    size = np.abs(change)
    if order < 2:
        return np.asarray(share * size)
    own, less = ((factorial(p) / factorial(2 * p)) ** 2 / (2 * p + 1) for p in (order, order - 1))
    estimated = UNRESOLVED * own / 2.0 * (2.0 * waves * size / (UNRESOLVED * less)) ** (order / (order - 1))
    return np.asarray(np.maximum(share * size, estimated))


def largest(half_widths: FloatArray) -> float | None:
    """Return the largest of some half-widths.

    Parameters
    ----------
    half_widths : ndarray, any shape
        NaN where unknown.

    Returns
    -------
    float or None
        Relative, as given; None without any, or if one is unknown.
    """
    return None if not half_widths.size or np.isnan(half_widths).any() else float(half_widths.max())


def rim_shares(
    plate: Material, pillar: Material, mesh: HexSettings, *more: Rim, wall: float = pi / 2.0, step_m: float = inf
) -> ErrorFractions:
    """Compute the error fractions at the rims of a foot and of further rims.

    They lie between those of displacements normal to the rim and along it.

    Parameters
    ----------
    plate, pillar : Material
        Materials that meet at the foot.
    mesh : HexSettings
        Order, layers and element size.
    *more : Rim
        Further rims.
    wall : float, optional
        Angle that the pillar fills above its foot, in rad.
    step_m : float, optional
        Distance of the sides of further sections from those of the foot.

    Returns
    -------
    ErrorFractions
        Correction and uncertainty, as fractions of the change between meshes.

    References
    ----------
    .. [1] williams1952 (docs/references.bib)
    """
    rims = [_edges(rim_wedges(plate, pillar, wall)), *(_rim_edges(rim) for rim in more)]
    shares = _shares(rims, mesh, RIM_ROUGH, RANGES.get(mesh.order, 1.0))
    # on a side so near the coarser mesh has a layer, too: up to half of the change is missing
    missing = shares.correction if step_m < BESIDE * mesh.size_m else 0.0
    return replace(shares, uncertainty=shares.uncertainty + missing, doubt=EDGE_UNCERTAINTY)


def clamped_shares(
    material: Material, mesh: HexSettings, *more: Rim, thickness_m: float = inf, width_m: float = inf
) -> ErrorFractions:
    """Compute the error fractions at the edges of a clamped face and at further rims.

    Parameters
    ----------
    material : Material
        Of the clamped body.
    mesh : HexSettings
        Order, layers and element size.
    *more : Rim
        Further rims.
    thickness_m : float, optional
        Thickness of the face.
    width_m : float, optional
        Width of a pillar's foot.

    Returns
    -------
    ErrorFractions
        Correction and uncertainty, as fractions of the change between meshes.

    References
    ----------
    .. [1] williams1952 (docs/references.bib)
    """
    clamped = clamped_edge_exponent(material)
    rims = [(Edge(clamped, OUTER_ACROSS, 1.0, clamped),), *(_rim_edges(rim) for rim in more)]
    is_long = mesh.size_m > thickness_m
    shares = replace(_shares(rims, mesh, LONG_ROUGH if is_long else CLAMPED_ROUGH), smooth=CLAMPED_SMOOTH)
    if not is_long:  # of a pillar of sections, the share stands for their rims, too, which no smooth layer reaches
        return shares if more else replace(shares, correction=_beside_a_layer(mesh, width_m) * shares.correction)
    shares = replace(shares, waves=UNLOCKED)
    return (
        replace(shares, correction=LONG * shares.correction, uncertainty=LONG * shares.uncertainty)
        if mesh.layers
        else shares
    )


def _beside_a_layer(mesh: HexSettings, width_m: float) -> float:
    """Part of the share at a pillar's clamped foot that is the edge's; the rest of it is the smooth layer at its end."""
    if mesh.order != 3 or mesh.layers != 1:
        return 1.0
    high = (mesh.pillar_size_m or mesh.size_m) / width_m
    return (STRETCHED + 1.0 / (1.0 + BENT * high**2)) / 2.0 if high > 0.0 else 1.0


def held_shares(material: Material, mesh: HexSettings) -> ErrorFractions:
    """Compute the error fractions at the rim of a disc of a face that is held: r^(1/2) where the law is isotropic.

    Parameters
    ----------
    material : Material
        Of the body.
    mesh : HexSettings
        Order, layers and element size.

    Returns
    -------
    ErrorFractions
        What the finer mesh still errs by, as a fraction of the change between meshes, and its uncertainty.

    References
    ----------
    .. [1] williams1952 (docs/references.bib)
    """
    return _shares([_edges((Wedge(material, pi),), (HELD, FREE))], mesh, CLAMPED_ROUGH)


@dataclass(frozen=True)
class Edge:
    """A singularity: its exponent, the part of the outer elements in the error, and its weight among others where it is alike.

    alike: exponent of the same edge in one material, for which the weight, a part of the layer's change, is known.
    """

    exponent: float
    outer: float
    weight: float
    alike: float

    def changes(self, mesh: HexSettings) -> tuple[float, float, float, float]:
        """Errors of the mesh, without its innermost layer and of an order less, and the weight of the layer's change.

        Motions are as large as in one material; a regular one, along the rim of a soft pillar, changes nothing.
        """
        less = replace(mesh, order=mesh.order - 1)
        meshes = mesh, mesh.coarser if mesh.layers else less, less
        own, coarse, lower = (self._error(each, self.exponent) for each in meshes)
        there = self._error(meshes[1], self.alike) - self._error(mesh, self.alike)
        return own, coarse, lower, self.weight * (coarse - own) / there

    def _error(self, mesh: HexSettings, exponent: float) -> float:
        return rim_error(exponent, mesh.order, mesh.factor, mesh.layers - mesh.skipped, self.outer)


def _rim_edges(rim: Rim) -> tuple[Edge, Edge]:
    return _edges((Wedge(*rim[0]), Wedge(*rim[1])))


def _edges(wedges: tuple[Wedge, ...], faces: tuple[str, str] = (FREE, FREE)) -> tuple[Edge, Edge]:
    """Singularities in the plane across an edge and along it, both exponents slightly below the regular value 1."""
    one = tuple(replace(each, material=wedges[0].material) for each in wedges)
    (across, alike), (along, too) = (
        [min(exponent(each, faces), ALMOST_SMOOTH) for each in (wedges, one)]
        for exponent in (edge_exponent, antiplane_exponent)
    )
    return Edge(across, OUTER_ACROSS, ACROSS, alike), Edge(along, OUTER_ALONG, 1.0 - ACROSS, too)


def _shares(rims: Sequence[tuple[Edge, ...]], mesh: HexSettings, rough: float, ranges: float = 1.0) -> ErrorFractions:
    """Weighted mean of the singularities of some rims, any of which may have all of a mode's change.

    The singularities' range (times `ranges`), a rough part, and how far one rim alone is from all of them are the uncertainty.
    """
    left, order, weights = zip(*(_of_rim(rim, mesh) for rim in rims), strict=True)
    all_left, all_order, every = (np.concatenate(each) for each in (left, order, weights))
    middle, at_edge = (float(np.average(each, weights=every)) for each in (all_left, all_order))
    alone = [np.average(one, weights=own) for one, own in zip(left, weights, strict=True)]
    unlike = float(max(abs(each - middle) for each in alone))
    spread = ranges * float(np.ptp(all_left)) / 2.0 + rough * middle + unlike
    taken = middle if mesh.layers else 0.0  # without layers the edge's share of the change is unknown
    return ErrorFractions(taken, spread + middle - taken, at_edge, order=mesh.order)


def _of_rim(edges: tuple[Edge, ...], mesh: HexSettings) -> FloatArray:
    """Of each of k singularities: what is left of the layer's change, the order's change over it, and its weight, (3, k)."""
    changes = (edge.changes(mesh) for edge in edges)
    return np.transpose(
        [(own / (coarse - own), (lower - own) / (coarse - own), part) for own, coarse, lower, part in changes]
    )


Body = TypeVar("Body")


@dataclass(frozen=True)
class Nested(Generic[Body]):
    """A body on a coarser mesh, and the prolongation (fine nodes, coarse nodes) of its fields to the finer one."""

    body: Body
    transfer: sp.csr_array


@dataclass(frozen=True)
class CoarserMeshes:
    """Error estimate from the mesh without the innermost layer and the mesh of one order less.

    A mesh without layers has no `layer`: all that the order changes counts as the edge's.
    """

    layer: Nested[SolidModel] | None
    order: Nested[SolidModel]
    shares: ErrorFractions

    def errors(
        self, symmetry: str | None, pencil: Pencil, vectors: FloatArray, values: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Relative correction (downwards) and error bar (half-width) of frequencies, (k,) each.

        vectors: M-orthonormal modes (dof, k) of a symmetry class; values: their eigenvalues (k,).
        """
        layer, order = (
            _rise(each, symmetry, pencil, vectors, values) for each in (self.layer or self.order, self.order)
        )
        return self.shares.correction * layer, self.shares.of_modes(values, layer, order)


def layer_share(reach: float, order: int, steps: int = 1) -> float:
    """Compute the error of order p in a layer exp(-a s), relative to the change by the last orders.

    Degree n has (2n + 1) i_n(a h / 2)^2 of the strain energy, i_n the modified spherical Bessel function, and order p all
    degrees below p. A larger a leaves more: the slowest layers, which reach farthest, carry most of the energy.

    Parameters
    ----------
    reach : float
        a h / 2, with h the length of an element (dimensionless).
    order : int
        p.
    steps : int, optional
        Number of orders whose change is the reference.

    Returns
    -------
    float
        Dimensionless.
    """
    from scipy.special import spherical_in  # slow to import

    degrees = np.arange(order - steps, order + DEGREES)
    energy = (2 * degrees + 1) * spherical_in(degrees, reach) ** 2
    return float(energy[steps:].sum() / energy[:steps].sum())


def regular_share(order: int) -> float:
    """Compute the error of order p of a regular motion relative to the last order's change; it goes as p^(-2p).

    Parameters
    ----------
    order : int
        p.

    Returns
    -------
    float
        Dimensionless.

    References
    ----------
    .. [1] babuska1981 (docs/references.bib)
    """
    return 1.0 / ((order / (order - 1.0)) ** (2 * order) - 1.0)


@dataclass(frozen=True)
class LowerOrders:
    """Error estimate of a body without singular edges from meshes of one and of two orders less.

    Waves inside, edges and their layers, which end within the body's smallest dimension d, leave a share of the last
    order's change: waves by their length, edges by the order's own rate, layers by the length of an element over d. Across d a
    single element has odd and even motions: the last order serves one kind only, the last two both.
    along, across: longest element in the plane and across d, over d.
    """

    order: Nested[SolidModel]
    lower: Nested[SolidModel]
    degree: int
    along: float
    across: float

    def errors(
        self, symmetry: str | None, pencil: Pencil, vectors: FloatArray, values: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Correction and half-widths as in `CoarserMeshes.errors`; the correction is 0."""
        one, two = (_rise(each, symmetry, pencil, vectors, values) for each in (self.order, self.lower))
        return np.zeros_like(values), self.half_width(one, two)

    def half_width(self, one: FloatArray, two: FloatArray) -> FloatArray:
        """Relative error bar (half-width) of a frequency from its changes on meshes of one and two orders less."""
        share = regular_share(self.degree) + layer_share(LAYER * self.along, self.degree)
        hidden = layer_share(LAYER * self.across, self.degree, 2) * np.abs(two)
        return np.asarray(smooth_half_width(one, 0.0, self.degree) + share * np.abs(one) + hidden)


def _rise(
    coarser: Nested[SolidModel], symmetry: str | None, pencil: Pencil, vectors: FloatArray, values: FloatArray
) -> FloatArray:
    """Relative excess of a coarser mesh's frequencies over those of the modes, (k,)."""
    theirs = coarser_eigenvalues(pencil, coarser.body.pencil(symmetry), coarser.transfer, vectors, values)
    return np.asarray((theirs / values - 1.0) / 2.0)


def coarser_eigenvalues(
    fine: Pencil, coarse: Pencil, transfer: sp.csr_array, vectors: FloatArray, values: FloatArray
) -> FloatArray:
    """Compute the eigenvalues on a coarser mesh of modes of a finer one.

    Parameters
    ----------
    fine, coarse : Pencil
        With the same supports and mirrors.
    transfer : sparse array, shape (fine nodes, coarse nodes)
        Interpolation between the meshes.
    vectors : ndarray, shape (dof, k)
        M-orthonormal modes on the finer mesh.
    values : ndarray, shape (k,)
        Their scaled eigenvalues.

    Returns
    -------
    ndarray, shape (k,)
        Scaled as `fine`.
    """
    prolonged = sp.csr_array(sp.kron(transfer, sp.eye_array(3), format="csr"))[np.flatnonzero(fine.free)]
    return prolonged_eigenvalues(fine, coarse, prolonged[:, np.flatnonzero(coarse.free)], vectors, values)


def prolonged_eigenvalues(
    fine: PlainPencil, coarse: PlainPencil, prolonged: sp.csr_array, vectors: FloatArray, values: FloatArray
) -> FloatArray:
    """Compute the eigenvalues on a coarser mesh, as `coarser_eigenvalues`, from the prolongation between the pencils.

    Parameters
    ----------
    fine, coarse : PlainPencil
        Scaled K and M of both meshes.
    prolonged : sparse array, shape (fine dof, coarse dof)
        The prolongation.
    vectors : ndarray, shape (dof, k)
        M-orthonormal modes on the finer mesh.
    values : ndarray, shape (k,)
        Their scaled eigenvalues.

    Returns
    -------
    ndarray, shape (k,)
        Scaled as `fine`.
    """
    from scipy.optimize import linear_sum_assignment  # slow to import

    unit = (fine.scale.angular / coarse.scale.angular) ** 2
    factor, _ = factor_near(coarse, amid(values) * unit, Factoriser())
    moved, _ = np.linalg.qr(factor.solve(np.ascontiguousarray(prolonged.T @ (fine.mass @ vectors))))
    stiffness, mass = (moved.T @ (part @ moved) for part in (coarse.stiffness, coarse.mass))
    eigenvalues, turn = eigh((stiffness + stiffness.T) / 2.0, (mass + mass.T) / 2.0)
    overlap = vectors.T @ (fine.mass @ (prolonged @ (moved @ turn)))
    _, partner = linear_sum_assignment(-np.abs(overlap))
    return np.asarray(eigenvalues[partner] / unit)


def amid(values: FloatArray) -> float:
    """Choose a shift between eigenvalues, or below them, next to their middle and clear of each.

    Parameters
    ----------
    values : ndarray, shape (k,)
        Scaled eigenvalues above 0.

    Returns
    -------
    float
        Scaled.
    """
    known = np.sort(values)
    between = np.concatenate([BELOW * known[:1], (known[1:] + known[:-1]) / 2.0])
    clear = np.abs(between[:, None] / known - 1.0).min(axis=1)
    chosen = between[clear >= min(APART, float(clear.max()))]
    return float(chosen[np.argmin(np.abs(chosen - (known[0] + known[-1]) / 2.0))])


# -- recovered stresses ------------------------------------------------------------------------------------------------
# The error of a mesh of tetrahedra, estimated by stress recovery: continuous stresses stand for the true ones.
# Of the continuous fields s* that are linear in each tetrahedron of one material, the one nearest to the computed
# stresses s in the energy's norm loses int (s - s*) : C^-1 (s - s*) = u'Ku - b'(C x M^-1) b, with b_a = int N_a e(u)
# of the strains e and M_ab = int N_a N_b over linear N (zienkiewicz1987). An eigenvalue lies as far above the true
# one as the energy of the error of its mode (boffi2010), of which this loss is most.

# of the loss: the error was 0.65 to 0.9 times it in bodies of one material, 0.6 to 1.6 times where plate and pillar differ,
# and from once to 2.2 times it at clamped edges (`python -m studies.error_bars`); no more than the whole leaves K positive
ALIKE, UNLIKE, CLAMPED = ErrorFractions(0.8, 0.25), ErrorFractions(1.0, 0.65), ErrorFractions(1.5, 0.75)
# a single element through a bending plate recovers stresses less well: the error was 0.75 to 1.85 times the loss in free rings
THIN, THIN_UNLIKE = ErrorFractions(1.25, 0.75), ErrorFractions(1.25, 0.9)
STRAINS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
ELEMENTS = 4096  # at a time


@dataclass(frozen=True)
class StressRecovery:
    """Error estimate of a mesh of tetrahedra by stress recovery, with a material for each region, in the units of a scale.

    clamped: whether faces are held, at whose edges most is missed. thin: whether a single element reaches through a plate that
    bends.
    """

    mesh: AnyMesh
    materials: dict[str, Material]
    scale: Scale
    clamped: bool = False
    thin: bool = False

    @property
    def shares(self) -> ErrorFractions:
        """Fraction of the energy loss that counts as the error, and its uncertainty."""
        if self.clamped:
            return CLAMPED
        alike, unlike = (THIN, THIN_UNLIKE) if self.thin else (ALIKE, UNLIKE)
        return unlike if len({self.materials[name] for name in self.mesh.region_of_cells()}) > 1 else alike

    def energy(self, shapes: FloatArray) -> FloatArray:
        """Energy of the continuous stresses of motions (3n, m), (m, m): u'Ku less their loss."""
        total = np.zeros((shapes.shape[1],) * 2)
        for elastic, strains, weights in self._projected(shapes):
            total += sum(elastic[i, j] * (strains[i].T @ weights[j]) for i, j in zip(*np.nonzero(elastic), strict=True))
        return total

    def energies(self, shapes: FloatArray) -> FloatArray:
        """Diagonal of `energy`, (m,)."""
        return np.asarray(
            sum(
                np.einsum("ij,iam,jam->m", elastic, strains, weights)
                for elastic, strains, weights in self._projected(shapes)
            )
        )

    def errors(
        self, symmetry: str | None, pencil: Pencil, vectors: FloatArray, values: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Relative correction (downwards) and error bar (half-width) of frequencies, (k,) each.

        vectors: M-orthonormal modes (dof, k) of a symmetry class; values: their eigenvalues (k,).
        """
        field = pencil.expand(vectors)
        shapes = field.reshape(-1, field.shape[2])
        loss = (values - self.energies(shapes)) / (2.0 * values)
        taken, half = self.shares.correction * loss, self.shares.uncertainty * np.abs(loss)
        for group in _that_mix(values, loss):
            own = values[group]
            lost = np.diag(own) - self.energy(shapes[:, group])
            lost = (lost + lost.T) / 2.0
            best, mixed = np.linalg.eigh(np.diag(own) - self.shares.correction * lost)
            taken[group] = 1.0 - np.sqrt(np.maximum(best, 0.0) / own)
            half[group] = self.shares.uncertainty * np.abs((mixed * (lost @ mixed)).sum(axis=0)) / (2.0 * own)
        return taken, half

    def _projected(self, shapes: FloatArray) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
        """C (6, 6), b (6, corners, m) and M^-1 b of each material."""
        field = shapes.reshape(len(self.mesh.nodes), 3, -1)
        for own in self._by_material:
            strains = np.stack([sum(part @ field[:, axis] for part, axis in own.parts(each)) for each in STRAINS])
            yield own.elastic, strains, np.stack([own.solve(strain) for strain in strains])

    @cached_property
    def _by_material(self) -> list[_Recovered]:
        """The elements of each material; a region of the same material goes on in the next one."""
        by_material: dict[Material, list[IntArray]] = {}
        for name, cells in self.mesh.region_of_cells().items():
            by_material.setdefault(self.materials[name], []).append(cells)
        (mesh,) = self.mesh.blocks
        return [
            _Recovered(mesh, np.concatenate(cells), material, self.scale) for material, cells in by_material.items()
        ]


def _that_mix(values: FloatArray, loss: FloatArray) -> list[IntArray]:
    """Modes, in ascending order, that lie no farther apart than the loss of one of them, group by group.

    What one mode lacks on a mesh is partly the shape of such a neighbour, so that they are corrected together.
    """
    order = np.argsort(values, kind="stable")
    apart = np.diff(values[order]) / (2.0 * values[order][1:])
    reach = np.maximum(np.abs(loss[order][1:]), np.abs(loss[order][:-1]))
    groups = np.split(order, np.flatnonzero(apart > reach) + 1)
    return [group for group in groups if len(group) > 1]


class _Recovered:
    """int N_a d/dx_k over quadratic fields (corners, n) and M over linear N, of one material's elements."""

    def __init__(self, mesh: Mesh, cells: IntArray, material: Material, scale: Scale) -> None:
        self.elastic = np.array(material.stiffness_pa) / scale.young_pa  # the order of STRAINS
        corners, local = np.unique(mesh.cells[cells, :4], return_inverse=True)
        rows = local.reshape(-1, 4)
        slope, mass = _integrals(mesh, cells, scale.length_m)
        self.slopes = [_summed(part, rows, mesh.cells[cells], (len(corners), len(mesh.nodes))) for part in slope]
        factor = Factoriser()(sp.csc_array(_summed(mass, rows, rows, (len(corners),) * 2)))
        self.solve = factor.solve

    def parts(self, strain: tuple[int, int]) -> Iterator[tuple[sp.csr_array, int]]:
        """Slopes and the displacements that they act on, of a strain."""
        first, second = strain
        yield self.slopes[second], first
        if first != second:
            yield self.slopes[first], second


def _integrals(mesh: Mesh, cells: IntArray, length_m: float) -> tuple[FloatArray, FloatArray]:
    """Integrals of every element: N_a dF_b/dx_k (3, e, 4, nodes), N_a N_b (e, 4, 4); N linear, F the mesh's functions."""
    rule = mesh.element.quadrature
    linear = np.column_stack([1.0 - rule.points.sum(axis=1), rule.points])
    _, gradient = mesh.element.shape(rule.points)
    slopes, masses = [], []
    for some in np.array_split(cells, -(-len(cells) // ELEMENTS)):
        jacobian = jacobians(mesh, some, rule.points) / length_m
        weight = np.linalg.det(jacobian) * rule.weights
        slope = np.linalg.inv(jacobian) @ gradient.transpose(0, 2, 1)  # (e, q, 3, nodes)
        slopes.append(np.einsum("eq,qa,eqkb->keab", weight, linear, slope, optimize=True))
        masses.append(np.einsum("eq,qa,qb->eab", weight, linear, linear, optimize=True))
    return np.concatenate(slopes, axis=1), np.concatenate(masses)


def _summed(values: FloatArray, rows: IntArray, columns: IntArray, shape: tuple[int, int]) -> sp.csr_array:
    """Element matrices (e, a, b) assembled over shared nodes."""
    across, down = np.broadcast_arrays(columns[:, None, :], rows[:, :, None])
    return sp.csr_array(sp.coo_array((values.ravel(), (down.ravel(), across.ravel())), shape=shape))
