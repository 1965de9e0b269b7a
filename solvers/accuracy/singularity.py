"""Exponent of the singularity at an edge where wedges of elastic materials meet: displacements grow as r^a (williams1952).

In the plane normal to the edge each wedge has Airy's function r^(a+1) F, F = A cos(a+1)t + B sin(a+1)t + C cos(a-1)t +
D sin(a-1)t, and along the edge the displacement r^a (E cos at + G sin at). Faces are free or clamped, neighbours bonded:
an exponent a is where the conditions' matrix is singular. The energy's error of elements of size h at the edge goes as
h^(2 Re a).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import pi

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from geometry.materials import Material

REAL = np.linspace(0.02, 0.98, 65)
IMAGINARY = np.linspace(0.0, 0.6, 16)
RESIDUAL = 1e-9  # smallest over largest singular value of the scaled matrix at an exponent
POINTS, STRETCH = 200, 8.0  # of the quadrature over r
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


def _lowest(conditions: Conditions) -> float:
    """Smallest real part of the exponents in (0, 1), from a grid of starting points; 1 without one."""

    def determinant(a: complex) -> complex:
        return complex(np.linalg.det(conditions(np.array(a))))

    def holds(root: complex) -> bool:
        return REAL[0] < root.real < REAL[-1] and float(_flatness(conditions(np.array(root)))) < RESIDUAL

    exponents = [1.0]
    for i, j in _minima(_flatness(conditions(REAL[:, None] + 1j * IMAGINARY))):
        with suppress(ZeroDivisionError, OverflowError, np.linalg.LinAlgError):
            root = _secant(determinant, complex(REAL[i], IMAGINARY[j]))
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
    unit = wedges[0].material.as_isotropic.shear_pa

    def rows(wedge: Wedge, t: float) -> tuple[ComplexArray, ComplexArray]:
        stiff = wedge.material.as_isotropic.shear_pa / unit
        shear = stiff * np.array([[-np.sin(a * t), np.cos(a * t)]])
        return np.asarray(shear, dtype=complex), np.array([[np.cos(a * t), np.sin(a * t)]], dtype=complex)

    return _conditions(wedges, faces, rows)


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
