"""Exponent of the singularity at an edge where wedges of elastic materials meet: displacements grow as r^a (williams1952).

In the plane normal to the edge each wedge has Airy's function r^(a+1) F, F = A cos(a+1)t + B sin(a+1)t + C cos(a-1)t +
D sin(a-1)t, and along the edge the displacement r^a (E cos at + G sin at). Faces are free or clamped, neighbours bonded:
an exponent a is where the conditions' matrix is singular. The energy's error of elements of size h at the edge goes as
h^(2 Re a).

Of any other law, u = r^a g(t) and the traction r^(a-1) s(t) on the ray t obey g' = A s - a A mn g and
s' = -a nm A s - a^2 (nn - nm A mn) g, where A = mm^-1, (uv)_ik = u_j C_ijkl v_l, n is the ray and m its normal
(barnett1973). Both pass a bonded face unchanged: the product of the wedges' transfer matrices has the conditions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import pi
from typing import NamedTuple

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from geometry.materials import Material

REAL = np.linspace(0.02, 0.98, 65)
IMAGINARY = np.linspace(0.0, 0.6, 16)
RESIDUAL = 1e-9  # smallest over largest singular value of the scaled matrix at an exponent
POINTS, STRETCH = 200, 8.0  # of the quadrature over r
STEPS = 32  # over a wedge's angle: Runge and Kutta's error is then below 1e-6
THINNED, BESIDE = 3, 0.03  # of the starting points where conditions are dear, and a second start for roots side by side
TRIPLE = 1e-4  # where three roots may be one, as at a crack, which rounding leaves apart by its cube root
FREE, CLAMPED = "free", "clamped"
Conditions = Callable[[ComplexArray], ComplexArray]


@dataclass(frozen=True)
class Wedge:
    """A wedge of material, its angle in rad."""

    material: Material
    angle: float


@lru_cache(maxsize=256)
def edge_exponent(wedges: tuple[Wedge, ...], faces: tuple[str, str] = (FREE, FREE)) -> float:
    """Compute the exponent of the singularity at an edge: the smallest real part in (0, 1), or 1 where nothing is singular.

    Where a law is not isotropic, it is the smallest over the edges along x and y, for the edge's place is not known here.

    Parameters
    ----------
    wedges : tuple of Wedge
        Bonded one to the next.
    faces : tuple of {"free", "clamped"}, optional
        Supports of the first and the last face.

    Returns
    -------
    float
        Exponent a of r^a, dimensionless.

    References
    ----------
    .. [1] williams1952 (docs/references.bib)
    """
    if any(wedge.material.constants is None for wedge in wedges):
        return min(_lowest(_transferred(each, faces), THINNED) for each in _turned(wedges, CLAMPED in faces))
    return min(_lowest(lambda a: _in_plane(a, wedges, faces)), antiplane_exponent(wedges, faces))


def rim_wedges(plate: Material, pillar: Material, wall: float = pi / 2.0) -> tuple[Wedge, Wedge]:
    """Build the wedges at the rim of a foot: a half-space of the plate, and the pillar with its wall.

    Parameters
    ----------
    plate, pillar : Material
        Materials that meet at the foot.
    wall : float, optional
        Angle that the pillar fills above its foot, in rad.

    Returns
    -------
    tuple of Wedge
        Plate, then pillar.
    """
    return Wedge(plate, pi), Wedge(pillar, wall)


def clamped_edge_exponent(material: Material) -> float:
    """Compute the exponent where a clamped face meets a free one at a right angle.

    Parameters
    ----------
    material : Material
        Of the body.

    Returns
    -------
    float
        Exponent a of r^a, dimensionless.
    """
    return edge_exponent((Wedge(material, pi / 2.0),), (CLAMPED, FREE))


@lru_cache(maxsize=256)
def antiplane_exponent(wedges: tuple[Wedge, ...], faces: tuple[str, str] = (FREE, FREE)) -> float:
    """Compute the smallest exponent in (0, 1) of displacements along the edge, or 1 where none is singular.

    Of a law that is not isotropic, whose displacements along the edge are not apart, that of its average.

    Parameters
    ----------
    wedges : tuple of Wedge
        Bonded one to the next.
    faces : tuple of {"free", "clamped"}, optional
        Supports of the first and the last face.

    Returns
    -------
    float
        Exponent a of r^a, dimensionless.
    """
    return _lowest(lambda a: _along_edge(a, wedges, faces))


def rim_error(exponent: float, order: int, factor: float, layers: int, outer_share: float = 1.0) -> float:
    """Compute the error in energy of elements with graded layers towards an edge, for r^a on [0, 1].

    Each element has its own best polynomial: the innermost one the share f^(2aL) of the error of order p without layers, the
    others what degree p - 1 leaves of the slope r^(a-1) on [f, 1], of which `outer_share` counts.

    Parameters
    ----------
    exponent : float
        a, dimensionless.
    order : int
        p.
    factor : float
        Ratio f of neighbouring layers, between 0 and 1.
    layers : int
        Number L of layers.
    outer_share : float, optional
        Factor on the error of the outer elements.

    Returns
    -------
    float
        Error in energy, dimensionless.

    Raises
    ------
    ValueError
        For a negative number of layers, or a factor outside (0, 1).

    References
    ----------
    .. [1] babuska1981 (docs/references.bib)
    """
    if layers < 0 or not 0.0 < factor < 1.0:
        raise ValueError(f"{layers} layers of factor {factor}: must be 0 or more, between 0 and 1")
    shrunk = factor ** (2.0 * exponent)
    outer = outer_share * sum(shrunk**layer for layer in range(layers)) * _best_polynomial(exponent, order, factor)
    return float(shrunk**layers * _best_polynomial(exponent, order, 0.0) + outer)


@lru_cache(maxsize=256)
def _best_polynomial(exponent: float, order: int, start: float) -> float:
    """Least integral of (r^(a-1) - q)^2 r over [start, 1] for polynomials q of degree order - 1."""
    t, weight = np.polynomial.legendre.leggauss(POINTS)
    t, weight = (t + 1.0) / 2.0, weight / 2.0
    stretch = 1.0 if start else STRETCH  # r = t^8 at the edge itself
    r = start + (1.0 - start) * t**stretch
    root = np.sqrt(weight * (1.0 - start) * stretch * t ** (stretch - 1.0) * r)
    basis = np.polynomial.legendre.legvander((2.0 * r - start - 1.0) / (1.0 - start), order - 1) * root[:, None]
    target = r ** (exponent - 1.0) * root
    residual = target - basis @ np.linalg.lstsq(basis, target, rcond=None)[0]
    return float(residual @ residual)


def _lowest(conditions: Conditions, thinned: int = 1) -> float:
    """Smallest real part of the exponents in (0, 1), from a grid of starting points; 1 without one."""

    def determinant(a: complex) -> complex:
        return complex(np.linalg.det(conditions(np.array(a))))

    def holds(root: complex) -> bool:
        residual = RESIDUAL if thinned == 1 else TRIPLE
        return REAL[0] < root.real < REAL[-1] and float(_flatness(conditions(np.array(root)))) < residual

    exponents, real, imaginary = [1.0], REAL[::thinned], IMAGINARY[::thinned]
    for i, j in _minima(_flatness(conditions(real[:, None] + 1j * imaginary))):
        for place in (real[i], real[i] - BESIDE) if thinned > 1 else (real[i],):
            with suppress(ZeroDivisionError, OverflowError, np.linalg.LinAlgError):
                root = _secant(determinant, complex(place, imaginary[j]))
                exponents += [root.real] if holds(root) else []
    return min(exponents)


def _secant(function: Callable[[complex], complex], start: complex) -> complex:
    """Root by the secant method from a starting point, without the tenth of a second that importing an optimiser takes."""
    before, here = start, start + 1e-4 * (1.0 + start)
    there = function(before)
    for _ in range(60):
        value = function(here)
        if value == there:
            break
        before, here, there = here, here - value * (here - before) / (value - there), value
        if abs(here - before) < 1e-12:
            break
    return here


def _flatness(matrices: ComplexArray) -> FloatArray:
    """Smallest over largest singular value of matrices (..., n, n) with rows of length 1."""
    values = np.linalg.svd(matrices / np.linalg.norm(matrices, axis=-1, keepdims=True), compute_uv=False)
    return np.asarray(values[..., -1] / values[..., 0])


def _minima(grid: FloatArray) -> list[tuple[int, int]]:
    """Places that no neighbour undercuts."""
    padded = np.pad(grid, 1, constant_values=np.inf)
    least = np.lib.stride_tricks.sliding_window_view(padded, (3, 3)).min(axis=(2, 3))
    return [(int(i), int(j)) for i, j in np.argwhere(grid <= least)]


def _in_plane(a: ComplexArray, wedges: Sequence[Wedge], faces: tuple[str, str]) -> ComplexArray:
    """Conditions on A, B, C, D of every wedge: tractions and displacements at the faces, scaled by the first modulus."""
    unit = wedges[0].material.as_isotropic.shear_pa

    def rows(wedge: Wedge, t: float) -> tuple[ComplexArray, ComplexArray]:
        p, m = a + 1.0, a - 1.0
        f = np.array([np.cos(p * t), np.sin(p * t), np.cos(m * t), np.sin(m * t)])
        slope = np.array([-p * np.sin(p * t), p * np.cos(p * t), -m * np.sin(m * t), m * np.cos(m * t)])
        kappa = 4.0 * (1.0 - wedge.material.as_isotropic.poisson)
        none = np.zeros_like(a)
        radial = -p * f + kappa * np.array([none, none, np.cos(m * t), np.sin(m * t)])
        hoop = -slope + kappa * np.array([none, none, np.sin(m * t), -np.cos(m * t)])
        softness = unit / wedge.material.as_isotropic.shear_pa
        return np.array([p * f, slope], dtype=complex), np.array([softness * radial, softness * hoop], dtype=complex)

    return _conditions(wedges, faces, rows)


def _along_edge(a: ComplexArray, wedges: Sequence[Wedge], faces: tuple[str, str]) -> ComplexArray:
    """Conditions on E and G of every wedge: shear and displacement along the edge."""
    unit = wedges[0].material.average.shear_pa

    def rows(wedge: Wedge, t: float) -> tuple[ComplexArray, ComplexArray]:
        stiff = wedge.material.average.shear_pa / unit
        shear = stiff * np.array([[-np.sin(a * t), np.cos(a * t)]])
        return np.asarray(shear, dtype=complex), np.array([[np.cos(a * t), np.sin(a * t)]], dtype=complex)

    return _conditions(wedges, faces, rows)


class _Sector(NamedTuple):
    """A wedge in the frame of its edge: stiffness tensor in units of the first wedge's modulus, first and last angle."""

    tensor: FloatArray
    start: float
    end: float


def _turned(wedges: Sequence[Wedge], held: bool) -> list[list[_Sector]]:
    """Sectors of the wedges at every edge that differs from the others: about a foot on the back of a plate, or, `held`, where
    a pillar's foot or a long side of a zone is clamped.
    """
    x, y, z = np.eye(3)
    pairs = [(along, z if held else -z) for along in (x, -x, y, -y)]
    pairs += [(along, aside) for along in (z, -z) for aside in (y, -y)] if held else []
    scale, ends = wedges[0].material.average.shear_pa, np.cumsum([0.0, *(wedge.angle for wedge in wedges)])
    known: dict[bytes, list[_Sector]] = {}
    for along, aside in pairs:
        frame = np.array([along, aside, np.cross(along, aside)])
        own = [
            np.einsum("ia,jb,kc,ld,abcd->ijkl", *4 * [frame], wedge.material.tensor_pa / scale, optimize=True)
            for wedge in wedges
        ]
        sectors = [_Sector(*each) for each in zip(own, ends[:-1], ends[1:], strict=True)]
        known[(np.round(own, 9) + 0.0).tobytes()] = sectors
    return list(known.values())


def _transferred(sectors: Sequence[_Sector], faces: tuple[str, str]) -> Conditions:
    """Conditions on displacement and traction of the first face: what it and the last one must not have, (..., 6, 6)."""
    known = [_rays(sector) for sector in sectors]
    held, barred = (slice(0, 3) if face == CLAMPED else slice(3, 6) for face in faces)

    def conditions(a: ComplexArray) -> ComplexArray:
        whole = np.eye(6, dtype=complex)
        for own, step in known:
            whole = _product(_steps(np.asarray(a, dtype=complex), own, step)) @ whole
        first = np.broadcast_to(np.eye(6, dtype=complex)[held], (*whole.shape[:-2], 3, 6))
        return np.concatenate([first, whole[..., barred, :]], axis=-2)

    return conditions


def _rays(sector: _Sector) -> tuple[tuple[FloatArray, FloatArray, FloatArray, FloatArray], float]:
    """A, A mn, nm A and nn - nm A mn at the ends and middles of the steps, (2 STEPS + 1, 3, 3) each, and a step's angle."""
    t = np.linspace(sector.start, sector.end, 2 * STEPS + 1)
    zero = np.zeros_like(t)
    n, m = np.stack([np.cos(t), np.sin(t), zero], -1), np.stack([-np.sin(t), np.cos(t), zero], -1)
    nn, nm, mn, mm = (np.einsum("qj,ijkl,ql->qik", u, sector.tensor, v) for u in (n, m) for v in (n, m))
    soft = np.linalg.inv(mm)
    return (soft, soft @ mn, nm @ soft, nn - nm @ soft @ mn), (sector.end - sector.start) / STEPS


def _steps(a: ComplexArray, own: tuple[FloatArray, ...], step: float) -> ComplexArray:
    """Transfer matrices of Runge and Kutta's steps, (..., STEPS, 6, 6)."""
    soft, before, after, stiff = own
    a = a[..., None, None, None]
    slope = np.zeros((*a.shape[:-3], len(soft), 6, 6), dtype=complex)
    slope[..., :3, :3], slope[..., :3, 3:] = -a * before, soft
    slope[..., 3:, :3], slope[..., 3:, 3:] = -(a**2) * stiff, -a * after
    first, middle, last = slope[..., :-2:2, :, :], slope[..., 1::2, :, :], slope[..., 2::2, :, :]
    one = np.eye(6)
    second = middle @ (one + step / 2.0 * first)
    third = middle @ (one + step / 2.0 * second)
    fourth = last @ (one + step * third)
    return np.asarray(one + step / 6.0 * (first + 2.0 * second + 2.0 * third + fourth))


def _product(steps: ComplexArray) -> ComplexArray:
    """Product of a power of two of matrices (..., n, 6, 6), the first one applied first."""
    while steps.shape[-3] > 1:
        steps = steps[..., 1::2, :, :] @ steps[..., ::2, :, :]
    return np.asarray(steps[..., 0, :, :])


def _conditions(
    wedges: Sequence[Wedge],
    faces: tuple[str, str],
    rows: Callable[[Wedge, float], tuple[ComplexArray, ComplexArray]],
) -> ComplexArray:
    """Free or clamped outer faces, equal tractions and displacements where wedges meet, (..., n, n)."""
    out: list[ComplexArray] = []
    ends = ((wedges[0], 0.0, faces[0], 0), (wedges[-1], wedges[-1].angle, faces[1], len(wedges) - 1))
    for wedge, t, face, number in ends:
        out.extend(_placed(rows(wedge, t)[face == CLAMPED], number, len(wedges)))
    for number, (one, other) in enumerate(pairwise(wedges)):
        for here, there in zip(rows(one, one.angle), rows(other, 0.0), strict=True):
            out.extend(_placed(here, number, len(wedges)) - _placed(there, number + 1, len(wedges)))
    return np.moveaxis(np.array(out), (0, 1), (-2, -1))


def _placed(block: ComplexArray, number: int, count: int) -> ComplexArray:
    """Rows (rows, width, ...) of one wedge among the columns of all of them."""
    width = block.shape[1]
    out = np.zeros((len(block), count * width, *block.shape[2:]), dtype=complex)
    out[:, number * width : (number + 1) * width] = block
    return out
