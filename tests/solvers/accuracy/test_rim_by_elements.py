"""What elements graded towards a rim miss there, against finite elements about a wedge whose field is known."""

from __future__ import annotations

from functools import lru_cache
from math import pi
from typing import Protocol

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from geometry.elements import FloatArray
from geometry.materials import Material
from solvers.accuracy.mesh import OUTER_ACROSS, OUTER_ALONG
from solvers.accuracy.singularity import Wedge, antiplane_exponent, edge_exponent, rim_error, rim_wedges

FACTOR, REACH, POINTS = 0.15, 3, 24  # of a layer; elements from the rim to where the load is; of the quadrature there
WITHIN = 0.07  # of a share: a sum of one-dimensional errors stands for elements that share their nodes
PLATE = Material.isotropic("plate", 1e9, 1000.0, 0.3)


class Field(Protocol):
    """A field about the rim at the origin; solid is all but x > 0 > y."""

    exponent: float

    def at(self, x: FloatArray, y: FloatArray, normal: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
        """Displacements and tractions on a cut with this normal, (components, n) each."""
        ...

    def moduli(self, upper: bool) -> FloatArray:
        """C_ikjl (components, 2, components, 2) above and below y = 0."""
        ...


class Along:
    """Motion along the rim of a plate, y > 0, with a pillar of another stiffness: w = r^a cos(a t) in the plate, t from its
    free face, and a matching multiple of r^a cos(a (3 pi / 2 - t)) in the pillar.
    """

    def __init__(self, contrast: float) -> None:
        self.contrast = contrast
        self.exponent = antiplane_exponent(rim_wedges(PLATE, Material.isotropic("pillar", contrast * 1e9, 1000.0, 0.3)))

    def at(self, x: FloatArray, y: FloatArray, normal: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
        a, r, t = self.exponent, np.hypot(x, y), np.mod(np.arctan2(y, x), 2.0 * pi)
        upper = t <= pi
        size = np.where(upper, 1.0, np.cos(a * pi) / np.cos(a * pi / 2.0))
        angle, turn = np.where(upper, t, 1.5 * pi - t), np.where(upper, -1.0, 1.0)
        radial, around = (a * size * r ** (a - 1.0) * part(a * angle) for part in (np.cos, np.sin))
        slopes = radial * np.cos(t) - turn * around * np.sin(t), radial * np.sin(t) + turn * around * np.cos(t)
        stiff = np.where(upper, 1.0, self.contrast)
        return (size * r**a * np.cos(a * angle))[None], (stiff * (normal[0] * slopes[0] + normal[1] * slopes[1]))[None]

    def moduli(self, upper: bool) -> FloatArray:
        return np.eye(2)[None, :, None, :] * (1.0 if upper else self.contrast)


class Across:
    """Symmetric motion in the plane across a rim of one material, of Airy's function r^(a+1) (cos(a+1)t + C cos(a-1)t), t from
    the bisector (williams1952), in units of the shear modulus.
    """

    poisson, half = 0.3, 0.75 * pi

    def __init__(self) -> None:
        self.exponent = edge_exponent((Wedge(PLATE, 2.0 * self.half),))
        a = self.exponent
        self.second = -np.cos((a + 1.0) * self.half) / np.cos((a - 1.0) * self.half)

    def at(self, x: FloatArray, y: FloatArray, normal: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
        a, p, m, c = self.exponent, self.exponent + 1.0, self.exponent - 1.0, self.second
        r, place = np.hypot(x, y), np.mod(np.arctan2(y, x), 2.0 * pi)
        t, stretch = place - self.half, 4.0 * (1.0 - self.poisson)
        value = np.cos(p * t) + c * np.cos(m * t)
        slope = -p * np.sin(p * t) - m * c * np.sin(m * t)
        curve = -p * p * np.cos(p * t) - m * m * c * np.cos(m * t)
        outward, around = -p * value + stretch * c * np.cos(m * t), -slope + stretch * c * np.sin(m * t)
        stresses = np.array([[curve + p * value, -a * slope], [-a * slope, a * p * value]]) * r**m
        turn = np.array([[np.cos(place), -np.sin(place)], [np.sin(place), np.cos(place)]])
        moved = r**a / 2.0 * np.einsum("ijn,jn->in", turn, np.array([outward, around]))
        return moved, np.einsum("ijn,jkn,lkn,l->in", turn, stresses, turn, np.array(normal))

    def moduli(self, upper: bool) -> FloatArray:
        eye, lame = np.eye(2), 2.0 * self.poisson / (1.0 - 2.0 * self.poisson)
        shear = np.einsum("ij,kl->ikjl", eye, eye) + np.einsum("il,kj->ikjl", eye, eye)
        return np.asarray(lame * np.einsum("ik,jl->ikjl", eye, eye) + shear)


FIELDS: dict[str, Field] = {"across": Across()} | {f"along {c}": Along(c) for c in (0.2, 1.0, 5.0)}


def ends(layers: int) -> FloatArray:
    half = np.concatenate([[0.0], FACTOR ** np.arange(layers, 0, -1.0), np.arange(1.0, REACH + 1)])
    return np.concatenate([-half[:0:-1], half])


@lru_cache
def missed(name: str, order: int, layers: int) -> float:
    """Energy's error, relative, of rectangles under the exact field's tractions at the outer boundary."""
    field, lines = FIELDS[name], ends(layers)
    nodes, (points, weights) = -np.cos(pi * np.arange(order + 1) / order), np.polynomial.legendre.leggauss(POINTS)
    basis = np.linalg.inv(np.polynomial.legendre.legvander(nodes, order))
    value = np.polynomial.legendre.legvander(points, order) @ basis
    slope = np.polynomial.legendre.legval(points, np.polynomial.legendre.legder(np.eye(order + 1))).T @ basis
    products = [[one.T @ (weights[:, None] * other) for other in (value, slope)] for one in (value, slope)]
    across, middle, parts = (len(lines) - 1) * order + 1, len(lines) // 2, field.moduli(True).shape[0]
    load, energy, entries = np.zeros((across**2, parts)), 0.0, []
    for i, j in np.ndindex(len(lines) - 1, len(lines) - 1):
        if i >= middle > j:
            continue
        corners, sizes = (lines[[i, i + 1]], lines[[j, j + 1]]), np.diff(lines)[[i, j]] / 2.0
        place = ((j * order + np.arange(order + 1))[:, None] * across + i * order + np.arange(order + 1)).ravel()
        own = np.zeros((len(place), parts, len(place), parts))
        for k, m in np.ndindex(2, 2):  # derivatives of the one function and of the other
            along_x = products[k == 0][m == 0] * sizes[0] / sizes[0] ** ((k == 0) + (m == 0))
            along_y = products[k == 1][m == 1] * sizes[1] / sizes[1] ** ((k == 1) + (m == 1))
            own += np.einsum("ij,ab->aibj", field.moduli(j >= middle)[:, k, :, m], np.kron(along_y, along_x))
        rows = (place[:, None] * parts + np.arange(parts)).ravel()
        entries.append((np.repeat(rows, len(rows)), np.tile(rows, len(rows)), own.ravel()))
        for axis, side in np.ndindex(2, 2):
            if (i, j)[axis] != (0, len(lines) - 2)[side]:
                continue
            cut, run = np.full(POINTS, corners[axis][side]), corners[1 - axis][0] + sizes[1 - axis] * (points + 1.0)
            x, y = (cut, run) if axis == 0 else (run, cut)
            moved, pulled = field.at(x, y, (float((2 * side - 1) * (1 - axis)), float((2 * side - 1) * axis)))
            edge = place.reshape(order + 1, order + 1)[:, -side] if axis == 0 else place.reshape(order + 1, -1)[-side]
            np.add.at(load, edge, value.T @ (pulled * weights * sizes[1 - axis]).T)
            energy += float((moved * pulled * weights).sum() * sizes[1 - axis])
    rows, columns, values = (np.concatenate(each) for each in zip(*entries, strict=True))
    matrix = sp.csc_array((values, (rows, columns)), shape=(load.size,) * 2)
    used, first = np.unique(rows), parts * (across * (across - 1))
    held = [first] if parts == 1 else [first, first + 1, first + parts * (across - 1) + 1]  # rigid-body motions
    free = np.setdiff1d(used, held)
    return float(1.0 - load.ravel()[free] @ spsolve(matrix[free][:, free], load.ravel()[free]) / energy)


@pytest.mark.parametrize(("order", "layers"), [(3, 1), (4, 1)])
@pytest.mark.parametrize("name", FIELDS)
def test_the_share_left_of_a_layers_change_is_what_elements_leave(name: str, order: int, layers: int) -> None:
    outer = OUTER_ACROSS if name == "across" else OUTER_ALONG
    fine, coarse = (missed(name, order, each) for each in (layers, layers - 1))
    own, other = (rim_error(FIELDS[name].exponent, order, FACTOR, each, outer) for each in (layers, layers - 1))
    assert 0.0 < fine < coarse < 0.02
    assert own / (other - own) == pytest.approx(fine / (coarse - fine), rel=WITHIN)
