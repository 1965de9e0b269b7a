"""Bloch's condition in the classes' own coordinates: for each wavevector of a path real bases of two mirror sectors.

The half turn about the middle followed by conjugation leaves the waves at k among themselves, so that classes even under
that turn have real coordinates and the others imaginary ones (wigner1932); a mirror that leaves k alone parts the waves
into even and odd. Neither the phases nor the bases know the design.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from geometry.elements import ComplexArray, FloatArray, IntArray
from solvers.errors import SolverError
from solvers.parametric.block import CLASSES
from solvers.superelement.interface import Interface
from solvers.superelement.lattice import boundary_phases

ROOT = float(np.sqrt(0.5))
RANK = 1e-9  # of the largest singular value
Member = tuple[int, float]  # a class of MEMBERS and its factor in a sector
MEMBERS = (*CLASSES, (-1, 1, 0))
SECTORS: dict[str, tuple[tuple[Member, ...], tuple[Member, ...]]] = {
    "y": (((0, 1.0), (1, 1.0), (5, 1.0)), ((2, 1.0), (3, 1.0), (4, 1.0))),
    "x": (((0, 1.0), (1, 1.0), (4, 1.0)), ((2, 1.0), (3, 1.0), (5, 1.0))),
    "d": (((0, 1.0), (2, 1.0), (4, ROOT), (5, ROOT)), ((1, 1.0), (3, 1.0), (4, ROOT), (5, -ROOT))),
}  # by the mirror that leaves the wavevector alone: even, odd


def mirror_at(fraction: FloatArray) -> str:
    """The mirror y -> -y, x -> -x or x <-> y that leaves a wavevector in units of pi / pitch alone.

    SolverError for a wavevector inside the irreducible triangle: paths run along its sides.
    """
    x, y = np.round(fraction, 12)
    if y == 0.0:
        return "y"
    if x == 1.0:
        return "x"
    if x == y:
        return "d"
    raise SolverError(f"wavevector {x:g}, {y:g} pi/pitch: no mirror leaves it alone")


@dataclass(frozen=True)
class Sector:
    """Wavevectors that share a mirror, and the waves of one sign under it.

    points (k,): their places in the path; classes: which reduced blocks take part; bases (k, rows, m): the classes'
    boundary polynomials, one below the other, from the sector's m free coordinates.
    """

    points: IntArray
    classes: tuple[int, ...]
    bases: FloatArray


def parities(face: Interface) -> tuple[FloatArray, ...]:
    """Each class's polynomials among the cell's own, (boundary, m); that of (-, +) by exchanging x and y."""
    own = [face.parity_basis({0: x, 1: y}, diagonal) for x, y, diagonal in CLASSES]
    return (*own, own[-1][face.diagonal()])


def sectors(face: Interface, fractions: Sequence[Sequence[float]] | FloatArray) -> tuple[Sector, ...]:
    """Every sector of a path's wavevectors (k, 2) in units of pi / pitch."""
    return _sectors(face, tuple((float(x), float(y)) for x, y in fractions))


@lru_cache(maxsize=8)
def _sectors(face: Interface, fractions: tuple[tuple[float, float], ...]) -> tuple[Sector, ...]:
    mirrors = np.array([mirror_at(np.array(fraction)) for fraction in fractions])
    classes, out = parities(face), []
    for name, pair in SECTORS.items():
        points = np.flatnonzero(mirrors == name)
        for members in pair:
            bases = [_basis(face, classes, members, np.pi * np.array(fractions[point])) for point in points]
            if bases:
                out.append(Sector(points, _stored(members), np.array(bases)))
    return tuple(out)


def _stored(members: tuple[Member, ...]) -> tuple[int, ...]:
    """The reduced blocks behind a sector: (-, +) is (+, -) turned over, and both tied by the diagonal are one."""
    numbers = [min(number, len(CLASSES) - 1) for number, _ in members]
    return tuple(dict.fromkeys(numbers))


def _basis(
    face: Interface, classes: tuple[FloatArray, ...], members: tuple[Member, ...], phase: FloatArray
) -> FloatArray:
    """An orthonormal real basis of the boundary motions that keep Bloch's condition in a sector, (rows, m)."""
    waves = boundary_phases(face, phase)
    pieces: dict[int, ComplexArray] = {}
    for number, factor in members:
        turn = 1.0 if MEMBERS[number][0] == MEMBERS[number][1] else -1j
        stored = min(number, len(CLASSES) - 1)
        pieces[stored] = pieces.get(stored, 0.0) + factor * turn * (classes[number].T @ waves)
    whole = np.vstack(list(pieces.values()))
    left, size, _ = np.linalg.svd(np.hstack([whole.real, whole.imag]), full_matrices=False)
    return np.asarray(left[:, size > RANK * size[0]])
