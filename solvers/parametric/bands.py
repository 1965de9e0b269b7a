"""Bands of any design of the box along a path, each with how far it may lie above its mesh's, also of compressed cells.

At each wavevector and in each of its mirror sectors a basis of some fifty functions: waves' motions of the boundary,
gathered once over the box (BOUNDARY of them hold it: whatever a pillar does, its cell's sides bend smoothly), and the
design's own clamped modes and inertial answers. All pencils are small, real and dense, and are solved in one batch (pau2007).

The bases of `block` follow every boundary polynomial alike. Of the waves of some hundred designs and wavevectors, each
of unit energy, far fewer directions hold all but KEPT (sirovich1987); rigid motions stay exact. Matrices are rounded to single
precision, so that a page without Python has the same ones.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, eigh, solve_triangular

from geometry.elements import BoolArray, FloatArray, IntArray
from solvers.parametric.affine import HEIGHT, PITCH, SIDE, Sizes, theta
from solvers.parametric.block import BESIDE, RIGID, ReducedBlock, Sector, orthonormal, symmetric
from solvers.parametric.cell import ClassAtDesign, Inner, ParametricCell, rigid_span
from solvers.superelement.interface import Interface
from solvers.threads import one_thread
from solvers.waves.branches import line_gram

BOUNDARY = 20  # motions of the boundary that a sector keeps
INNER = Inner(5, 5)
FLAT = 1e-3  # of the highest frequency: slower waves are rigid-body motions but for rounding
SLOWEST = 1e-7  # scaled eigenvalue: some hundred hertz, from where on frequencies are held to their relative error
SAFETY = 2.0  # on the largest error at the wavevectors looked at closely: others lie between them
CLOSELY = 12  # every so many-th wavevector is

# of the largest energy of a direction, by how many classes there are: larger and more of them make too large a page
KEPT = {5: 1e-6, 4: 1e-5, 8: 3e-5}

INSIDE = Inner(8, 8)
FUNCTION = 1e-6  # of the largest singular value, of the boundary functions
SHARES = 9


@dataclass(frozen=True)
class BandBases:
    """What the bands of every design along a path need besides the cell: `sectors` with few boundary motions, `rich` with all.

    fractions (k, 2): wavevectors in units of pi / pitch, with labels; rich holds some of them only; count: bands; floor:
    relative error of the cell's own bases on designs that they were not made from.
    """

    fractions: FloatArray
    labels: tuple[str, ...]
    count: int
    sectors: tuple[Sector, ...]
    rich: tuple[Sector, ...]
    floor: float


@dataclass(frozen=True)
class Bands:
    """Frequencies (k, bands) in Hz, ascending; error (bands,): each may lie so much of itself above its mesh's.

    sector (k, bands): which of the path's sectors a wave belongs to; waves of one sector cross those of others alone.
    pillar, flexural (k, bands): shares of a wave's motion as `waves.branches` has them, nan for waves at rest.
    """

    frequency_hz: FloatArray
    error: FloatArray
    sector: IntArray
    pillar: FloatArray
    flexural: FloatArray

    def corrected(self, overestimate: FloatArray) -> Bands:
        """The bands less what they lie too high by, relative, (bands,)."""
        hz = self.frequency_hz / (1.0 + overestimate)
        order = np.argsort(hz, axis=1, kind="stable")
        pillar, flexural = (np.take_along_axis(each, order, axis=1) for each in (self.pillar, self.flexural))
        sector = np.take_along_axis(self.sector, order, axis=1)
        return Bands(np.take_along_axis(hz, order, axis=1), self.error, sector, pillar, flexural)


def bands(cell: ParametricCell, bases: BandBases, sizes: FloatArray | Sizes) -> Bands:
    """Compute the bands of one design.

    Parameters
    ----------
    cell : ParametricCell
        The cell, also a compressed one.
    bases : BandBases
        Path, number of bands and boundary motions.
    sizes : (float, float, float, float) or ndarray, shape (4,)
        Thickness, height, side and pitch in m.

    Returns
    -------
    Bands
        Frequencies in Hz and relative errors.

    Raises
    ------
    SolverError
        For a design outside the box, by name.
    """
    parts = cell.parts(sizes, INNER, cell.interface)
    with one_thread():
        forms = _forms(cell, parts, sizes)
        solved = [_moving(parts, forms, sector, bases.count, at) for at, sector in enumerate(bases.sectors)]
        whole = [_aside(list(each), bases.sectors, len(bases.fractions)) for each in zip(*solved, strict=True)]
        order = np.argsort(whole[0], axis=1, kind="stable")[:, : bases.count]
        values, sector, pillar, flexural = (np.take_along_axis(each, order, axis=1) for each in whole)
        error = _error(parts, bases, values)
    rest = values <= FLAT**2 * values[:, -1:]
    pillar, flexural = (np.where(rest, np.nan, share) for share in (pillar, flexural))
    hz = cell.scale.frequency(values)
    return Bands(hz, SAFETY * error + bases.floor, sector.astype(np.int64), pillar, flexural)


def _forms(
    cell: ParametricCell, parts: Sequence[ClassAtDesign], sizes: FloatArray | Sizes
) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """For each class the forms of a wave's energy in the pillar, of <u_z^2> and of <u^2> on the cell's sides."""
    out = []
    for block, part in zip(
        cell.blocks, parts, strict=False
    ):  # a class's image by exchanging x and y has none of its own
        on = block.mass_exponents[:, HEIGHT] > 0
        factors = theta(block.mass_exponents[on], sizes, cell.reference, cell.box)
        pillar = part.shapes.T @ np.tensordot(factors, block.mass[on], axes=1) @ part.shapes
        out.append((pillar, *line_forms(cell.interface, block.parity, cell.box.panel)))
    return out


def line_forms(face: Interface, parity: FloatArray, panel: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
    """Average the squares of a class's thickness-mean motion along the sides of a panel.

    Parameters
    ----------
    face : Interface
        Degrees of the boundary polynomials.
    parity : ndarray, shape (boundary, m)
        The class's own.
    panel : tuple of float
        Edges along x and y; their ratio alone matters.

    Returns
    -------
    out, whole : ndarray, shape (m, m)
        Forms of <u_z^2> and of <u^2>.
    """
    gram = line_gram(face, panel)
    each = [own.T @ gram @ own for own in (parity[axis :: 3 * face.layers] for axis in range(3))]
    return each[2], np.sum(each, axis=0)


def _moving(
    parts: Sequence[ClassAtDesign],
    forms: Sequence[tuple[FloatArray, FloatArray, FloatArray]],
    sector: Sector,
    count: int,
    number: int,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The lowest eigenvalues of a sector, its number, and the waves' shares in pillar and bending, (k, m) each."""
    own = [parts[member] for member in sector.classes]
    stiffness, mass = _pencils(own, sector.bases)
    lower = np.linalg.cholesky(mass)
    half = np.linalg.solve(lower, stiffness)
    values, turned = np.linalg.eigh(np.linalg.solve(lower, half.transpose(0, 2, 1)))
    waves = np.linalg.solve(lower.transpose(0, 2, 1), turned[:, :, :count])
    free, row, start = sector.bases.shape[2], 0, sector.bases.shape[2]
    energy = np.zeros((3, *values[:, :count].shape))
    for member, part in zip(sector.classes, own, strict=True):
        width, stop = part.parity.shape[1], start + len(part.fixed_hz)
        edge = sector.bases[:, row : row + width] @ waves[:, :free]
        motion = np.concatenate([edge, waves[:, start:stop]], axis=1)
        for total, form in zip(energy, forms[member], strict=True):
            known = motion[:, : len(form)]
            total += (known * (form @ known)).sum(axis=1)
        row, start = row + width, stop
    pillar, out, whole = energy
    shares = np.clip(pillar, 0.0, 1.0), out / np.maximum(whole, np.finfo(float).tiny)
    return values[:, :count], np.full(pillar.shape, float(number)), *shares


def _lowest(
    parts: Sequence[ClassAtDesign], bases: FloatArray, count: int
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """At each wavevector the lowest eigenvalues (count,), the waves' free boundary coordinates and their inner functions."""
    for stiffness, mass in zip(*_pencils(parts, bases), strict=True):
        values, waves = eigh(stiffness, mass, subset_by_index=(0, min(count, len(mass)) - 1), driver="gvx")
        yield np.asarray(values), waves[: bases.shape[2]], waves[bases.shape[2] :]


def _pencils(parts: Sequence[ClassAtDesign], bases: FloatArray) -> tuple[FloatArray, FloatArray]:
    """K and M of [free boundary coordinates, inner functions] at each wavevector, (k, m, m)."""
    free, inner = bases.shape[2], sum(len(part.fixed_hz) for part in parts)
    stiffness, mass = (np.zeros((len(bases), free + inner, free + inner)) for _ in range(2))
    row, start = 0, free
    for part in parts:
        width, stop = part.parity.shape[1], start + len(part.fixed_hz)
        own = bases[:, row : row + width]
        turned = own.transpose(0, 2, 1)
        for whole, matrix in zip((stiffness, mass), part.own[:2], strict=True):
            whole[:, :free, :free] += turned @ (matrix[:width, :width] @ own)
            coupling = turned @ matrix[:width, width:]
            whole[:, :free, start:stop] = coupling
            whole[:, start:stop, :free] = coupling.transpose(0, 2, 1)
            whole[:, start:stop, start:stop] = matrix[width:, width:]
        row, start = row + width, stop
    return stiffness, mass


def band_bases(
    cell: ParametricCell,
    fractions: FloatArray,
    labels: tuple[str, ...],
    count: int,
    designs: Sequence[Sizes],
    floor: float,
) -> BandBases:
    """Gather the boundary motions of the waves of given designs.

    Parameters
    ----------
    cell : ParametricCell
        Reduced over the box.
    fractions : ndarray, shape (k, 2)
        Wavevectors in units of pi / pitch.
    labels : tuple of str
        One per wavevector, empty between labelled points.
    count : int
        Number of bands.
    designs : sequence of tuple of float
        In m.
    floor : float
        Relative error of a frequency that is always added.

    Returns
    -------
    BandBases
        For `bands`.
    """
    whole = cell.sectors(fractions)
    waves = [_boundary_waves(cell, whole, count, sizes) for sizes in designs]
    middle = cell.parts(cell.reference, INNER, cell.interface)
    few = []
    for number, sector in enumerate(whole):
        gathered = np.concatenate([known[number] for known in waves], axis=2)
        energy, mass = _pencils([middle[member] for member in sector.classes], sector.bases)
        free = sector.bases.shape[2]
        metric = (energy + BESIDE * mass)[:, :free, :free]
        most = BOUNDARY * (1 + (len(sector.classes) == len(cell.blocks)))  # no mirror parts these waves
        kept = [_pod(own, root, most) for own, root in zip(gathered, metric, strict=True)]
        few.append(replace(sector, bases=sector.bases @ np.array(kept)))
    return BandBases(fractions, labels, count, tuple(few), rich_sectors(cell, fractions, labels), floor)


def rich_sectors(cell: ParametricCell, fractions: FloatArray, labels: tuple[str, ...]) -> tuple[Sector, ...]:
    """Sectors with all boundary motions at some of the wavevectors.

    Parameters
    ----------
    cell : ParametricCell
        The cell.
    fractions : ndarray, shape (k, 2)
        Wavevectors of the path in units of pi / pitch.
    labels : tuple of str
        Label of each wavevector, empty for none.

    Returns
    -------
    tuple of Sector
        At the labelled wavevectors, at every CLOSELY-th and at the middle one of each sector.
    """
    labelled = np.array([bool(label) for label in labels])
    return tuple(_some(sector, labelled[sector.points]) for sector in cell.sectors(fractions))


def own_error(cell: ParametricCell, alone: Sequence[ParametricCell], designs: Sequence[Sizes], count: int) -> float:
    """Compute the largest relative excess of the cell's frequencies over those of cells made for each design alone.

    Parameters
    ----------
    cell : ParametricCell
        Reduced over the box.
    alone : sequence of ParametricCell
        One per design.
    designs : sequence of tuple of float
        In m.
    count : int
        Number of bands.

    Returns
    -------
    float
        Relative.
    """
    points = cell.box.path(2).wavevectors / np.pi
    of, worst = cell.sectors(points), 0.0

    def solved(each: ParametricCell, sizes: Sizes) -> FloatArray:
        own = [_eigenvalues(each.parts(sizes, INNER, each.interface), sector) for sector in of]
        return _merged(own, of, len(points), count)

    for one, sizes in zip(alone, designs, strict=True):
        ours, theirs = solved(cell, sizes), solved(one, sizes)
        moving = theirs > FLAT**2 * theirs[:, -1:]
        worst = max(worst, float(0.5 * np.abs(ours[moving] / theirs[moving] - 1.0).max()))
    return worst


def compressed(cell: ParametricCell, of: Sequence[Sector], count: int, designs: Sequence[Sizes]) -> ParametricCell:
    """Reduce the cell further, to a basis made from the lowest waves of the designs at the sectors' wavevectors.

    Parameters
    ----------
    cell : ParametricCell
        Reduced over the box.
    of : sequence of Sector
        Wavevectors and boundary motions.
    count : int
        Number of waves.
    designs : sequence of tuple of float
        In m.

    Returns
    -------
    ParametricCell
        With fewer functions.
    """
    rigid: list[list[FloatArray]] = [[] for _ in cell.blocks]
    moving: list[list[FloatArray]] = [[] for _ in cell.blocks]
    with one_thread():
        for sizes in designs:
            parts = cell.parts(sizes, INSIDE, cell.interface)
            for number, block in enumerate(cell.blocks):
                span = rigid_span(block.parity, cell.interface, cell.box, sizes)
                rigid[number].append(parts[number].shapes[block.functions :, : len(span)] @ span)
            for sector in of:
                for number, motion in _inside(cell, parts, sector, count):
                    moving[number].append(motion)
        blocks = [_block(cell, *own) for own in zip(cell.blocks, rigid, moving, strict=True)]
    return replace(cell, blocks=tuple(blocks))


def _single(values: FloatArray) -> FloatArray:
    """Values as single precision holds them."""
    return np.asarray(values, dtype=np.float32).astype(float)


def _error(parts: Sequence[ClassAtDesign], bases: BandBases, values: FloatArray) -> FloatArray:
    """Relative excess of each band's frequency at the wavevectors of `rich`, that of its neighbours counted too, (bands,)."""
    solved = [_corrected(parts, sector, bases.count) for sector in bases.rich]
    better = _merged(solved, bases.rich, len(bases.fractions), bases.count)
    known = np.isfinite(better).all(axis=1)
    ours, theirs = values[known], better[known]
    moving = theirs > FLAT**2 * theirs[:, -1:]
    excess = np.where(moving, 0.5 * np.abs(ours / np.where(moving, theirs, 1.0) - 1.0), 0.0).max(axis=0)
    return np.asarray(np.max([excess, np.append(excess[1:], 0.0), np.append(0.0, excess[:-1])], axis=0))


def _merged(solved: list[FloatArray], of: Sequence[Sector], points: int, count: int) -> FloatArray:
    """The sectors' eigenvalues together, (points, count); infinite where none was asked for."""
    return np.asarray(np.sort(_aside(solved, of, points), axis=1)[:, :count])


def _aside(solved: list[FloatArray], of: Sequence[Sector], points: int) -> FloatArray:
    """What the sectors have at each wavevector one after another, infinite beyond, (points, n)."""
    width, known = max(values.shape[1] for values in solved), np.zeros(points, dtype=np.int64)
    out = np.full((points, 2, width), np.inf)
    for values, sector in zip(solved, of, strict=True):
        out[sector.points, known[sector.points], : values.shape[1]] = values
        known[sector.points] += 1
    return out.reshape(points, -1)


def _eigenvalues(parts: Sequence[ClassAtDesign], sector: Sector) -> FloatArray:
    """Every eigenvalue of a sector at each of its wavevectors, (k, m)."""
    stiffness, mass = _pencils([parts[number] for number in sector.classes], sector.bases)
    lower = np.linalg.cholesky(mass)
    half = np.linalg.solve(lower, stiffness)
    return np.asarray(np.linalg.eigvalsh(np.linalg.solve(lower, half.transpose(0, 2, 1))))


def _corrected(parts: Sequence[ClassAtDesign], sector: Sector, count: int) -> FloatArray:
    """Eigenvalues less what the inner functions left out take from them, to first order: l - l^2 u'Du, (k, count)."""
    own = [parts[number] for number in sector.classes]
    out = []
    for basis, (values, edge, _) in zip(sector.bases, _lowest(own, sector.bases, count), strict=True):
        free, row, taken = basis @ edge, 0, np.zeros(len(values))
        for part in own:
            piece = free[row : row + part.parity.shape[1]]
            taken += np.einsum("ij,ij->j", piece, part.lost @ piece)
            row += len(piece)
        out.append(values - values**2 * taken)
    return np.array(out)


def _some(sector: Sector, labelled: BoolArray) -> Sector:
    """The labelled wavevectors of a sector, every CLOSELY-th and the one in its middle."""
    place = np.arange(len(labelled))
    chosen = labelled | (place % CLOSELY == CLOSELY // 2) | (place == len(place) // 2)
    return Sector(sector.points[chosen], sector.classes, sector.bases[chosen])


def _boundary_waves(cell: ParametricCell, of: Sequence[Sector], count: int, sizes: Sizes) -> list[FloatArray]:
    """For each sector the boundary coordinates of one design's lowest waves of unit energy, (k, m, count)."""
    with one_thread():
        parts = cell.parts(sizes, INNER, cell.interface)
        solved = (_lowest([parts[member] for member in sector.classes], sector.bases, count) for sector in of)
        return [
            np.array([edge / np.sqrt(np.maximum(values, 0.0) + SLOWEST) for values, edge, _ in sector])
            for sector in solved
        ]


def _pod(waves: FloatArray, metric: FloatArray, most: int) -> FloatArray:
    """So many motions that hold most of the waves' energy, (m, most), orthonormal in it (sirovich1987)."""
    root = cholesky(metric)
    left, _, _ = np.linalg.svd(root @ waves, full_matrices=False)
    return np.asarray(solve_triangular(root, left[:, :most]))


def _inside(
    cell: ParametricCell, parts: Sequence[ClassAtDesign], sector: Sector, count: int
) -> list[tuple[int, FloatArray]]:
    """Each class's block and what its inside does in the lowest waves of unit energy, (inside, waves)."""
    own, out = [parts[number] for number in sector.classes], []
    for basis, (values, edge, inner) in zip(sector.bases, _lowest(own, sector.bases, count), strict=True):
        size, row, start = np.sqrt(np.maximum(values, 0.0) + SLOWEST), 0, 0
        free, inner = basis @ (edge / size), inner / size
        for number, part in zip(sector.classes, own, strict=True):
            width, modes = part.parity.shape[1], len(part.fixed_hz)
            motion = np.vstack([free[row : row + width], inner[start : start + modes]])
            stored = min(number, len(cell.blocks) - 1)
            out.append((stored, part.shapes[cell.blocks[stored].functions :] @ motion))
            row, start = row + width, start + modes
    return out


def _block(
    cell: ParametricCell, block: ReducedBlock, rigid: list[FloatArray], moving: list[FloatArray]
) -> ReducedBlock:
    f, box = block.functions, cell.box
    low, high = (np.array(edge) for edge in (box.low, box.high))
    most = high[SIDE] / (box.foot.widest * high[SIDE] + box.clearance_m)
    shares = box.foot.reach * np.linspace(low[SIDE] / high[PITCH] / box.narrow, most, SHARES)
    left, size, _ = np.linalg.svd(np.hstack([block.boundary(share) for share in shares]), full_matrices=False)
    boundary = left[:, size > FUNCTION * size[0]]
    energy = np.tensordot(np.ones(len(block.stiffness)), block.stiffness, axes=1)[f:, f:]
    known = any(part.size for part in rigid)
    still = orthonormal(np.hstack(rigid), energy, RIGID) if known else np.empty((len(energy), 0))
    inner = np.hstack([still, _leading(np.hstack(moving), still, energy, KEPT[len(cell.blocks)])])
    whole = np.zeros((block.stiffness.shape[1], boundary.shape[1] + inner.shape[1]))
    whole[:f, : boundary.shape[1]], whole[f:, boundary.shape[1] :] = boundary, inner

    def turned(matrices: FloatArray) -> FloatArray:
        return _single(symmetric(np.array([whole.T @ matrix @ whole for matrix in matrices])))

    return replace(
        block, functions=boundary.shape[1], stiffness=turned(block.stiffness), mass=turned(block.mass),
        touch=_single(block.touch @ whole), coordinates=_single(boundary.T @ block.coordinates),
    )  # fmt: skip


def _leading(waves: FloatArray, still: FloatArray, energy: FloatArray, kept: float) -> FloatArray:
    """The directions of many motions (n, k) that hold all but `kept`, orthonormal in the energy and to `still`."""
    root = np.linalg.cholesky(energy)
    turned = root.T @ (waves - still @ (still.T @ (energy @ waves)))
    size, directions = np.linalg.eigh(turned @ turned.T)
    return np.asarray(np.linalg.solve(root.T, directions[:, size > kept * size[-1]]))
