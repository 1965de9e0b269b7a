"""A bare rectangular panel reduced without a mesh: hierarchical polynomials, K and M from integrals over a line.

Along x and y two hats and integrated Legendre polynomials, through the thickness Legendre polynomials (szabo1991): on the sides
they are the interface's own, so that the panel joins any cell. Sizes enter as stretches alone.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import eigh

from geometry.elements import FloatArray, IntArray
from geometry.materials import Material
from solvers.fem.assembly import Scale
from solvers.fem.surface import gauss, gauss_points
from solvers.superelement.cell import Cell, Expansion
from solvers.superelement.interface import SIDES, VERTICES, Interface, bubble_functions

DEGREE, THROUGH = 5, 3  # of the inside: a few half-waves along the panel, shear and Poisson's strain through it
TRIPLES = tuple(product(range(3), repeat=2))


@lru_cache(maxsize=4)
def functions(face: Interface) -> IntArray:
    """Number the scalar functions along x, y (0 and 1 the hats, then bubbles) and through z; the interface's come first.

    Parameters
    ----------
    face : Interface
        Degrees along the sides and through the thickness.

    Returns
    -------
    ndarray of int, shape (n, 3)
        Numbers of the functions.
    """
    layers, bubbles = range(face.layers), range(2, face.along + 1)
    out = [((1 + x) // 2, (1 + y) // 2, layer) for x, y in VERTICES for layer in layers]
    out += [(at, bubble, layer) for at in range(len(SIDES) // 2) for bubble in bubbles for layer in layers]
    out += [(bubble, at, layer) for at in range(len(SIDES) // 2) for bubble in bubbles for layer in layers]
    inside = range(2, DEGREE + 1)
    return np.array(out + list(product(inside, inside, range(THROUGH + 1))))


def line_values(s: FloatArray, derived: bool) -> tuple[FloatArray, FloatArray]:
    """Evaluate the functions along a side and through the thickness on [-1, 1], or their derivatives.

    Parameters
    ----------
    s : ndarray, shape (q,)
        Places.
    derived : bool
        Derivatives instead of values.

    Returns
    -------
    along : ndarray, shape (q, DEGREE + 1)
        Hats, then bubbles.
    through : ndarray, shape (q, THROUGH + 1)
        Legendre polynomials.
    """
    if not derived:
        hats = np.column_stack([1.0 - s, 1.0 + s]) / 2.0
        return np.hstack([hats, bubble_functions(s, DEGREE)]), np.asarray(legendre.legvander(s, THROUGH), dtype=float)
    slopes = np.column_stack([legendre.legval(s, legendre.legder(row)) for row in np.eye(THROUGH + 1)])
    hats = np.column_stack([-np.ones_like(s), np.ones_like(s)]) / 2.0
    degrees = np.arange(2, DEGREE + 1)
    bubbles = legendre.legvander(s, DEGREE)[:, degrees - 1] * np.sqrt((2.0 * degrees - 1.0) / 2.0)
    return np.asarray(np.hstack([hats, bubbles]), dtype=float), np.asarray(slopes, dtype=float)


Span = tuple[float, float]
WHOLE: Span = (-1.0, 1.0)


@lru_cache(maxsize=64)
def _line_integrals(span: Span = WHOLE) -> tuple[tuple[FloatArray, ...], ...]:
    """int f g, int f' g and int f' g' over a part of [-1, 1], of the functions along a side and of those through it."""
    s, weights = gauss(DEGREE + 2, *span)
    plain, derived = line_values(s, False), line_values(s, True)
    pairs = ((plain, plain), (derived, plain), (derived, derived))
    return tuple(tuple(one[i].T @ (weights[:, None] * other[i]) for one, other in pairs) for i in (0, 1))


@lru_cache(maxsize=4)
def _reference(face: Interface, span: Span = WHOLE) -> tuple[FloatArray, FloatArray]:
    """int d_j f d_l g over span x [-1, 1]^2, (9, n, n) in the order of TRIPLES, and int f g, (n, n)."""
    chosen = functions(face)

    def line(axis: int, one: bool, other: bool) -> FloatArray:
        square, slope, both = _line_integrals(span if axis == 0 else WHOLE)[axis == 2]
        whole = both if one and other else slope if one else slope.T if other else square
        return np.asarray(whole[np.ix_(chosen[:, axis], chosen[:, axis])])

    def solid(j: int, l: int) -> FloatArray:  # noqa: E741  as in C_ijkl
        return np.asarray(np.prod([line(axis, axis == j, axis == l) for axis in range(3)], axis=0))

    return np.array([solid(j, l) for j, l in TRIPLES]), solid(-1, -1)  # noqa: E741


def _bare_matrices(
    size_m: tuple[float, float, float], material: Material, face: Interface, span: Span = WHOLE
) -> tuple[FloatArray, FloatArray]:
    """K and M (3 n, 3 n) of a panel, or of what lies within a span of [-1, 1] along x, among all its functions, component
    fastest, in units of its thickness.
    """
    (parts, mass) = bare_forms(size_m, material, face, span, apart=False)
    return parts[0], mass


def bare_forms(
    size_m: tuple[float, float, float], material: Material, face: Interface, span: Span = WHOLE, apart: bool = True
) -> tuple[list[FloatArray], FloatArray]:
    """K and M of a bare panel, or of part of it along x, among all its functions.

    Lengths are scaled by the panel's thickness. Degrees of freedom go function by function, u_x, u_y, u_z each.

    Parameters
    ----------
    size_m : (float, float, float)
        Width, depth and thickness.
    material : Material
        The plate's.
    face : Interface
        Polynomials of the sides.
    span : (float, float), optional
        Part of [-1, 1] along x; all by default.
    apart : bool, optional
        Whether K is split by its number of derivatives across the plate.

    Returns
    -------
    stiffness : list of ndarray, shape (3 n, 3 n)
        Terms with 0, 1 and 2 derivatives along z, or their sum alone.
    mass : ndarray, shape (3 n, 3 n)
        Scaled.
    """
    gradients, square = _reference(face, span)
    stretch = np.array(size_m) / size_m[2] / 2.0
    volume = float(np.prod(stretch))
    tensor = material.tensor_pa / Scale.of(size_m[2], material).young_pa
    scaled = np.array([volume / stretch[j] / stretch[l] * g for (j, l), g in zip(TRIPLES, gradients, strict=True)])  # noqa: E741
    across, count = np.array([(j, l).count(2) for j, l in TRIPLES]), 3 * len(square)  # noqa: E741
    stiffness = []
    for chosen in [across == times for times in range(3)] if apart else [across >= 0]:
        part = (chosen[:, None, None] * scaled).reshape(3, 3, *square.shape)
        whole = np.einsum("ijkl,jlfg->figk", tensor, part, optimize=True)
        stiffness.append(np.asarray(whole.reshape(count, count)))
    mass: FloatArray = np.kron(volume * square, np.eye(3)).astype(float)
    return stiffness, mass


@lru_cache(maxsize=64)
def _inside(
    size_m: tuple[float, float, float], material: Material, face: Interface
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Eigenvalues (m,) and parity (m, 2) of a panel's inside, and the panel's functions by its degrees of freedom [boundary,
    modes], (b + m, b + m).
    """
    stiffness, mass = _bare_matrices(size_m, material, face)
    b = face.count
    values, modes, parity = _modes(stiffness[b:, b:], mass[b:, b:], face)
    static = -modes @ ((modes.T @ stiffness[b:, :b]) / values[:, None])  # all modes: K_II^-1 = sum of u u' / l
    return values, parity, np.block([[np.eye(b), np.zeros((b, len(values)))], [static, modes]])


@lru_cache(maxsize=64)
def bare_strip(
    size_m: tuple[float, float, float], material: Material, face: Interface, span: Span = WHOLE
) -> tuple[FloatArray, FloatArray, Expansion]:
    """Compute K, M and touch face of a part of the panel along x in the degrees of freedom of the panel's cell.

    Parameters
    ----------
    size_m : tuple of float
        Length, width and thickness.
    material : Material
        Of the panel.
    face : Interface
        Degrees along the sides and through the thickness.
    span : tuple of float, optional
        Part of [-1, 1] along x.

    Returns
    -------
    stiffness, mass : ndarray, shape (dof, dof)
        Scaled.
    touch : Expansion
        u_z on the touch face.
    """
    _, _, shapes = _inside(size_m, material, face)
    stiffness, mass = (shapes.T @ matrix @ shapes for matrix in _bare_matrices(size_m, material, face, span))
    return stiffness, mass, _touch(size_m, face, span, shapes[2::3])


@lru_cache(maxsize=64)
def bare_cell(size_m: tuple[float, float, float], material: Material, face: Interface) -> Cell:
    """Build the panel's cell; every mode of its inside is kept.

    Parameters
    ----------
    size_m : tuple of float
        Length, width and thickness.
    material : Material
        Of the panel.
    face : Interface
        Degrees along the sides and through the thickness.

    Returns
    -------
    Cell
        Without residual flexibility.
    """
    values, parity, _ = _inside(size_m, material, face)
    stiffness, mass, touch = bare_strip(size_m, material, face)
    b, scale = face.count, Scale.of(size_m[2], material)
    return Cell(
        (stiffness + stiffness.T) / 2.0, (mass + mass.T) / 2.0, np.zeros_like(mass), face, scale, size_m,
        scale.frequency(values), parity, float("inf"), np.zeros((b, b)), touch, Expansion.nothing(len(mass)), len(mass),
    )  # fmt: skip


def _modes(stiffness: FloatArray, mass: FloatArray, face: Interface) -> tuple[FloatArray, FloatArray, IntArray]:
    """Eigenvalues (n,), modes (n, n) of the inside and the parity (n, 2) of their u_z under x -> -x and y -> -y."""
    parity = _parity(face)
    values, modes = np.zeros(len(mass)), np.zeros_like(mass)
    for signs in product((1, -1), repeat=2):
        own = np.flatnonzero((parity == signs).all(axis=1))
        here = np.ix_(own, own)
        values[own], modes[here] = eigh(stiffness[here], mass[here])
    return values, modes, parity


def _parity(face: Interface) -> IntArray:
    """Parity (n, 2) of u_z under x -> -x and y -> -y that goes with each function of the inside."""
    flips = np.array([[-1, 1], [1, -1], [1, 1]])  # of u_z = 1 for u_x, u_y, u_z
    inside = functions(face)[face.count // 3 :, None, :2]
    return np.asarray(((-1) ** inside * flips).reshape(-1, 2))


def bare_parity(face: Interface, signs: tuple[int, ...]) -> IntArray:
    """List the inside's functions of one symmetry class, counted from the inside's first.

    Parameters
    ----------
    face : Interface
        Degrees along the sides and through the thickness.
    signs : tuple of int
        Signs of the class.

    Returns
    -------
    ndarray of int, shape (n,)
        Numbers of the functions.
    """
    return np.flatnonzero((_parity(face) == signs[:2]).all(axis=1))


def _touch(size_m: tuple[float, float, float], face: Interface, span: Span, normal: FloatArray) -> Expansion:
    """u_z, the scalar functions' parts (n, dof) in it, at Gauss points of the touch face z = 0."""
    at, weights = gauss_points()
    half = (span[1] - span[0]) / 2.0
    at[:, 0] = span[0] + half * (at[:, 0] + 1.0)
    (flat, across), (_, through) = (line_values(one, False)[0] for one in at.T), line_values(np.array([-1.0]), False)
    chosen = functions(face)
    matrix = flat[:, chosen[:, 0]] * across[:, chosen[:, 1]] * through[0, chosen[:, 2]]
    points = np.column_stack([at * np.array(size_m[:2]) / 2.0, np.zeros(len(at))])
    return Expansion(points, (matrix @ normal)[:, None], half * weights * size_m[0] * size_m[1] / 4.0)
