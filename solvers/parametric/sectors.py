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
from solvers.superelement.interface import Interface, Ties

ROOT = float(np.sqrt(0.5))
RANK = 1e-9  # of the largest singular value
Signs = tuple[int, int, int]  # under x -> -x, y -> -y, x <-> y; 0 where the last is no mirror of the class
Member = tuple[int, float]  # a class among a symmetry's members and its factor in a sector


@dataclass(frozen=True)
class Symmetry:
    """Classes of a cell that are reduced, members (those and their images), and the even and odd sector of each line of the
    zone: GX and YM under y -> -y, XM and GY under x -> -x, GM under x <-> y.
    """

    classes: tuple[Signs, ...]
    members: tuple[Signs, ...]
    sectors: dict[str, tuple[tuple[Member, ...], tuple[Member, ...]]]


ALIKE = Symmetry(
    ((1, 1, 1), (1, 1, -1), (-1, -1, 1), (-1, -1, -1), (1, -1, 0)),
    ((1, 1, 1), (1, 1, -1), (-1, -1, 1), (-1, -1, -1), (1, -1, 0), (-1, 1, 0)),
    {
        "GX": (((0, 1.0), (1, 1.0), (5, 1.0)), ((2, 1.0), (3, 1.0), (4, 1.0))),
        "XM": (((0, 1.0), (1, 1.0), (4, 1.0)), ((2, 1.0), (3, 1.0), (5, 1.0))),
        "GM": (((0, 1.0), (2, 1.0), (4, ROOT), (5, ROOT)), ((1, 1.0), (3, 1.0), (4, ROOT), (5, -ROOT))),
    },
)  # x and y may be exchanged: (-, +) is (+, -) turned over
QUARTERS: tuple[Signs, ...] = ((1, 1, 0), (1, -1, 0), (-1, 1, 0), (-1, -1, 0))
EVEN_X, EVEN_Y = ((((0, 1.0), (1, 1.0)), ((2, 1.0), (3, 1.0))), (((0, 1.0), (2, 1.0)), ((1, 1.0), (3, 1.0))))
UNLIKE = Symmetry(QUARTERS, QUARTERS, {"GX": EVEN_Y, "XM": EVEN_X, "YM": EVEN_Y, "GY": EVEN_X})


def symmetry_of(is_alike: bool) -> Symmetry:
    """The symmetry of a cell that is, or is not, its own image with x and y exchanged."""
    return ALIKE if is_alike else UNLIKE


def line_of(fraction: FloatArray) -> str:
    """The line of the zone's border that a wavevector in units of pi / pitch lies on, by its ends.

    SolverError for a wavevector inside the irreducible Brillouin zone: paths run along its sides.
    """
    x, y = np.round(fraction, 12)
    on = {"GX": y == 0.0, "XM": x == 1.0, "GM": x == y, "YM": y == 1.0, "GY": x == 0.0}
    for name, is_on in on.items():
        if is_on:
            return name
    raise SolverError(f"wavevector {x:g}, {y:g} pi/pitch: no mirror leaves it alone")


@dataclass(frozen=True)
class Sector:
    """Wavevectors of one line, and the waves of one sign under the mirror that leaves them alone.

    points (k,): their places in the path; classes: which reduced blocks take part; bases (k, rows, m): the classes'
    boundary polynomials, one below the other, from the sector's m free coordinates.
    """

    points: IntArray
    classes: tuple[int, ...]
    bases: FloatArray


def parities(face: Interface, symmetry: Symmetry) -> tuple[FloatArray, ...]:
    """Each member's polynomials among the cell's own, (boundary, m); the image of a class by exchanging x and y."""
    own = [face.parity_basis({0: x, 1: y}, diagonal) for x, y, diagonal in symmetry.classes]
    images = len(symmetry.members) - len(symmetry.classes)
    return (*own, *(one[face.diagonal()] for one in own[len(own) - images :]))


def sectors(
    face: Interface, fractions: Sequence[Sequence[float]] | FloatArray, symmetry: Symmetry = ALIKE
) -> tuple[Sector, ...]:
    """Every sector of a path's wavevectors (k, 2) in units of pi / pitch.

    SolverError for a wavevector that none of the cell's mirrors leaves alone.
    """
    return _sectors(face, tuple((float(x), float(y)) for x, y in fractions), symmetry is ALIKE)


@lru_cache(maxsize=8)
def _sectors(face: Interface, fractions: tuple[tuple[float, float], ...], is_alike: bool) -> tuple[Sector, ...]:
    symmetry = symmetry_of(is_alike)
    lines = np.array([line_of(np.array(fraction)) for fraction in fractions])
    if not set(lines) <= set(symmetry.sectors):
        raise SolverError("wavevectors along the diagonal: the cell is no image of itself with x and y exchanged")
    classes, out = parities(face, symmetry), []
    for name, pair in symmetry.sectors.items():
        points = np.flatnonzero(lines == name)
        for members in pair:
            bases = [_basis(face, symmetry, classes, members, np.pi * np.array(fractions[point])) for point in points]
            if bases:
                out.append(Sector(points, _stored(members, symmetry), np.array(bases)))
    return tuple(out)


def _stored(members: tuple[Member, ...], symmetry: Symmetry) -> tuple[int, ...]:
    """The reduced blocks behind a sector: (-, +) is (+, -) turned over, and both tied by the diagonal are one."""
    numbers = [min(number, len(symmetry.classes) - 1) for number, _ in members]
    return tuple(dict.fromkeys(numbers))


def _basis(
    face: Interface, symmetry: Symmetry, classes: tuple[FloatArray, ...], members: tuple[Member, ...], phase: FloatArray
) -> FloatArray:
    """An orthonormal real basis of the boundary motions that keep Bloch's condition in a sector, (rows, m)."""
    waves = Ties(face, [0]).closed(phase)
    pieces: dict[int, ComplexArray] = {}
    for number, factor in members:
        turn = 1.0 if symmetry.members[number][0] == symmetry.members[number][1] else -1j
        stored = min(number, len(symmetry.classes) - 1)
        pieces[stored] = pieces.get(stored, 0.0) + factor * turn * (classes[number].T @ waves)
    whole = np.vstack(list(pieces.values()))
    left, size, _ = np.linalg.svd(np.hstack([whole.real, whole.imag]), full_matrices=False)
    return np.asarray(left[:, size > RANK * size[0]])
