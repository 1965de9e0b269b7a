"""Bloch's condition in the classes' own coordinates: for each wavevector of a path real bases of its mirror sectors.

The half turn about the middle followed by conjugation leaves the waves at k among themselves, so that classes even under
that turn have real coordinates and the others imaginary ones (wigner1932); a mirror that leaves k alone parts the waves
into even and odd. A bare panel beside the pillar's has its coordinates about its own middle, times the phase there. Neither
the phases nor the bases know the design.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from geometry.elements import ComplexArray, FloatArray, IntArray
from geometry.lattice import Lattice
from solvers.errors import SolverError
from solvers.parametric.affine import IN_LINE
from solvers.superelement.interface import Interface, Ties

ROOT = float(np.sqrt(0.5))
RANK = 1e-9  # of the largest singular value
Signs = tuple[int, int, int]  # under x -> -x, y -> -y, x <-> y; 0 where the last is no mirror of the class
Member = tuple[int, float]  # a class among a symmetry's members and its factor in a sector


@dataclass(frozen=True)
class Symmetry:
    """Classes of a cell that are reduced, members (those and their images), and the even and odd sector of each line of the
    zone: GX and YM under y -> -y, XM and GY under x -> -x, GM under x <-> y; all waves together elsewhere, where allowed.

    Of two panels the second one's classes come last.
    """

    classes: tuple[Signs, ...]
    members: tuple[Signs, ...]
    sectors: Mapping[str, tuple[tuple[Member, ...], tuple[Member, ...]]]


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
LINES = {"GX": EVEN_Y, "XM": EVEN_X, "YM": EVEN_Y, "GY": EVEN_X}
UNLIKE = Symmetry(QUARTERS, QUARTERS, LINES)
INSIDE = ""  # name of no line


def _twice(members: tuple[Member, ...]) -> tuple[Member, ...]:
    """The classes of both panels, which a mirror leaves where they are."""
    return members + tuple((number + len(QUARTERS), factor) for number, factor in members)


STAGGERED = Symmetry(
    2 * QUARTERS,
    2 * QUARTERS,
    {name: (_twice(even), _twice(odd)) for name, (even, odd) in LINES.items()}
    | {INSIDE: (_twice(tuple((number, 1.0) for number in range(len(QUARTERS)))), ())},
)  # the zone's oblique sides are left alone by no mirror


def symmetry_of(lattice: Lattice, is_alike: bool) -> Symmetry:
    """The symmetry of rows in line whose cell is, or is not, its own image with x and y exchanged, or of staggered rows."""
    return STAGGERED if lattice.is_centred else ALIKE if is_alike else UNLIKE


def line_of(fraction: FloatArray, lattice: Lattice, symmetry: Symmetry) -> str:
    """The line of the zone that a wavevector in units of pi / pitch lies on and that a mirror leaves alone, by its ends.

    SolverError for any other wavevector of rows in line: paths run along the sides of the irreducible Brillouin zone.
    """
    (x, y), (end_x, end_y) = np.round(fraction, 12), np.round(np.diag(lattice.reciprocal_per_m) / (2.0 * np.pi), 12)
    end_x = end_x * (1 + lattice.is_centred)
    on = {"GX": y == 0.0, "XM": x == end_x, "GM": x == y, "YM": y == end_y, "GY": x == 0.0, INSIDE: True}
    for name, is_on in on.items():
        if is_on and name in symmetry.sectors:
            return name
    raise SolverError(f"wavevector {x:g}, {y:g} pi/pitch: no mirror of the cell leaves it alone")


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
    face: Interface,
    fractions: Sequence[Sequence[float]] | FloatArray,
    lattice: Lattice = IN_LINE,
    is_alike: bool = True,
) -> tuple[Sector, ...]:
    """Every sector of a path's wavevectors (k, 2) in units of pi / pitch.

    SolverError for a wavevector of rows in line that none of the cell's mirrors leaves alone.
    """
    return _sectors(face, tuple((float(x), float(y)) for x, y in fractions), lattice, is_alike)


@lru_cache(maxsize=8)
def _sectors(
    face: Interface, fractions: tuple[tuple[float, float], ...], lattice: Lattice, is_alike: bool
) -> tuple[Sector, ...]:
    symmetry = symmetry_of(lattice, is_alike)
    lines = np.array([line_of(np.array(fraction), lattice, symmetry) for fraction in fractions])
    classes, out = parities(face, symmetry), []
    for name, pair in symmetry.sectors.items():
        points = np.flatnonzero(lines == name)
        phases = [lattice.phases(np.pi * np.array(fractions[point])) for point in points]
        for members in pair:
            bases = [_basis(face, symmetry, classes, members, phase) for phase in phases if members]
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
    """An orthonormal real basis of the boundary motions that keep Bloch's condition in a sector, (rows, m).

    phase (2,): of the lattice vectors.
    """
    count = 1 + (symmetry is STAGGERED)
    panels = np.split(Ties(face, [0] * count, count - 1).closed(phase), count)
    pieces: dict[int, ComplexArray] = {}
    for number, factor in members:
        panel = number // len(QUARTERS) if count > 1 else 0
        turn = np.exp(-1j * phase[0] * panel / count)
        turn = turn * (1.0 if symmetry.members[number][0] == symmetry.members[number][1] else -1j)
        stored = min(number, len(symmetry.classes) - 1)
        pieces[stored] = pieces.get(stored, 0.0) + factor * turn * (classes[number].T @ panels[panel])
    whole = np.vstack(list(pieces.values()))
    return _range(np.hstack([whole.real, whole.imag]), apart=count > 1)


def _range(whole: FloatArray, apart: bool) -> FloatArray:
    """An orthonormal basis of a matrix's range; apart: of each set of rows that no column ties to others, mostly zeros."""
    moved = np.where(np.abs(whole) > RANK, 1.0, 0.0) if apart else np.ones_like(whole)
    count, label = connected_components(csr_array(moved @ moved.T))
    found = []
    for rows in (np.flatnonzero(label == number) for number in range(count)):
        left, size, _ = np.linalg.svd(whole[rows], full_matrices=False)
        basis = np.zeros((len(whole), len(size)))
        basis[rows] = left
        found.append((basis, size))
    basis, size = np.hstack([each for each, _ in found]), np.concatenate([each for _, each in found])
    return np.asarray(basis[:, size > RANK * size.max()])
