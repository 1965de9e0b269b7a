"""What of a pillar stays alike while it grows: its section over its width, and the quarter cell's mesh around it.

A round or hexagonal section stands in a square block of the plate that grows with it, so that beyond the block every stretch
is along the axes, as it is for a section made of boxes (rozza2008).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from geometry.elements import FloatArray, IntArray
from geometry.hex.boxes import Boxes, hex_mesh
from geometry.hex.grading import Grading, grid_lines
from geometry.layout import Pillar
from geometry.mesh import Mesh

BLOCK = 1.1  # width of a round or hexagonal pillar's block over the pillar's largest
CORNERS = 2.0 / np.sqrt(3.0)  # width of a hexagon across corners over that across flats
CORE = 0.5  # half-width of the middle of a disc over its radius
NOTCH = 0.42  # of the radius: where the middle's corner lies along x and y
UNDER, BESIDE = 2, 3  # numbers of the stretches of block and clearance: solvers/parametric/affine.py

Map = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class FixedMesh:
    """Order and elements of the one topology: even intervals of each part, layers graded towards the pillar's foot."""

    order: int = 3
    under: int = 1
    beside: int = 2
    through: int = 1
    along: int = 4
    layers: int = 2
    factor: float = 0.2


@dataclass(frozen=True)
class Foot:
    """A section over its width: round, hexagonal, or a square or cross with arms so wide; the width of the tip over that of the
    foot.
    """

    round: bool = False
    arm: float = 1.0
    taper: float = 1.0
    hexagonal: bool = False

    @property
    def is_alike(self) -> bool:
        """Whether the section is its own image with x and y exchanged."""
        return not self.hexagonal

    @property
    def footprint(self) -> float:
        """Largest extent of the foot over its width: a hexagon's is across corners, along x."""
        return float(CORNERS) if self.hexagonal else 1.0

    @property
    def reach(self) -> float:
        """Width of the block that grows with the pillar, over the pillar's."""
        return BLOCK * self.footprint if self.round or self.hexagonal else 1.0

    @property
    def widest(self) -> float:
        """Largest extent at any height over the width of the foot."""
        return max(1.0, self.taper) * self.footprint

    @property
    def area(self) -> float:
        """Area of the foot over its width squared."""
        if self.hexagonal:
            return float(np.sqrt(0.75))
        return float(np.pi / 4.0) if self.round else 1.0 - (1.0 - self.arm) ** 2

    @property
    def volume(self) -> float:
        """Volume over width squared times height."""
        return self.area * (1.0 + self.taper + self.taper**2) / 3.0


SQUARE = Foot()


def foot_of(pillar: Pillar) -> Foot | None:
    """The section of a pillar that grows with its width; None for one that does not."""
    if pillar.fillet_m or pillar.tip or pillar.faces == 2:
        return None
    known = {
        "square": Foot(),
        "tapered": Foot(taper=pillar.form.taper),
        "cross": Foot(arm=pillar.form.size_m("arm_m") / pillar.base_m),
        "round": Foot(round=True),
        "hexagonal": Foot(hexagonal=True),
    }
    return known.get(pillar.shape)


def quarter_mesh(foot: Foot, sizes: tuple[float, float, float, float], mesh: FixedMesh) -> tuple[Mesh, IntArray]:
    """The quarter cell x, y >= 0, z = 0 the touch face, of thickness, height, width and pitch in m; for each element which
    stretch acts along x, y and z, (e, 3).
    """
    t, h, _, _ = sizes
    z = np.concatenate(
        [_part(0.0, t, mesh.through, (False, True), mesh), _part(t, t + h, mesh.along, (True, False), mesh)[1:]]
    )
    patches = list(_plan(foot, sizes, mesh))
    return _tapered(_joined(patches, z, t, mesh.order), foot, t, h), _stretched(patches, z, t)


@dataclass(frozen=True)
class _Patch:
    """A rectangle of elements in plan: lines of its own two coordinates, what takes these to places, and what grows it.

    inside (nu, nv): whether the pillar stands on an element; grows: the number of the stretch along x and along y.
    """

    u: FloatArray
    v: FloatArray
    place: Map
    inside: FloatArray
    grows: tuple[int, int]


def _plan(foot: Foot, sizes: tuple[float, float, float, float], mesh: FixedMesh) -> Iterator[_Patch]:
    if foot.round:
        return _disc(sizes, mesh)
    return _hexagon(foot, sizes, mesh) if foot.hexagonal else _bars(foot, sizes, mesh)


def _part(low: float, high: float, count: int, ends: tuple[bool, bool], mesh: FixedMesh, less: int = 0) -> FloatArray:
    layers = max(mesh.layers - less, 0)
    return grid_lines({low: ends[0], high: ends[1]}, Grading((high - low) / count, layers, mesh.factor))


def _straight(u: FloatArray, v: FloatArray) -> FloatArray:
    return np.column_stack([u, v])


def _bars(foot: Foot, sizes: tuple[float, float, float, float], mesh: FixedMesh) -> Iterator[_Patch]:
    """Square or cross: lines along the axes."""
    _, _, a, p = sizes
    edges = [0.0, foot.arm * a / 2.0, a / 2.0] if foot.arm < 1.0 else [0.0, a / 2.0]
    inner = [_part(low, high, mesh.under, (low > 0.0, True), mesh) for low, high in pairwise(edges)]
    under = np.concatenate([[0.0], *(one[1:] for one in inner)])
    beside = _part(a / 2.0, p / 2.0, mesh.beside, (True, False), mesh)
    middle = (under[1:] + under[:-1]) / 2.0 < foot.arm * a / 2.0
    stands = (middle[:, None] | middle).astype(float)
    for u, v, grows in _four(under, beside):
        inside = stands if grows == (UNDER, UNDER) else np.zeros((len(u) - 1, len(v) - 1))
        yield _Patch(u, v, _straight, inside, grows)


def _four(under: FloatArray, beside: FloatArray) -> Iterator[tuple[FloatArray, FloatArray, tuple[int, int]]]:
    """Block, both arms of the plate beside it, and its corner."""
    yield under, under, (UNDER, UNDER)
    yield beside, under, (BESIDE, UNDER)
    yield under, beside, (UNDER, BESIDE)
    yield beside, beside, (BESIDE, BESIDE)


def _disc(sizes: tuple[float, float, float, float], mesh: FixedMesh) -> Iterator[_Patch]:
    """A round foot: its middle, a ring up to the rim, what fills the block, and the plate beside it."""
    _, _, a, p = sizes
    radius, block = a / 2.0, BLOCK * a / 2.0
    turn = np.linspace(0.0, 1.0, mesh.under + 1)
    ring, fill = _part(0.0, 1.0, 1, (False, True), mesh), _filling(mesh)

    def middle(u: FloatArray, v: FloatArray) -> FloatArray:
        return radius * np.column_stack([CORE * u * (1.0 - v) + NOTCH * u * v, CORE * v * (1.0 - u) + NOTCH * v * u])

    def arc(v: FloatArray) -> FloatArray:
        return radius * np.column_stack([np.cos(np.pi / 4.0 * v), np.sin(np.pi / 4.0 * v)])

    def around(u: FloatArray, v: FloatArray) -> FloatArray:
        return _between(middle(np.ones_like(v), v), arc(v), u)

    def beyond(u: FloatArray, v: FloatArray) -> FloatArray:
        return _between(arc(v), block * np.column_stack([np.ones_like(v), v]), u)

    yield _Patch(turn, turn, middle, 1.0 + _empty(turn, turn), (UNDER, UNDER))
    for lines, place, stands in ((ring, around, 1.0), (fill, beyond, 0.0)):
        yield _Patch(lines, turn, place, stands + _empty(lines, turn), (UNDER, UNDER))
        yield _Patch(turn, lines, _exchanged(place), stands + _empty(turn, lines), (UNDER, UNDER))
    yield from _around(block * turn, block, p, mesh)


def _hexagon(foot: Foot, sizes: tuple[float, float, float, float], mesh: FixedMesh) -> Iterator[_Patch]:
    """A hexagonal foot, whose quarter has four corners; what fills the block, and the plate beside it."""
    _, _, a, p = sizes
    flat, corner, block = a / 2.0, CORNERS * a / 2.0, foot.reach * a / 2.0
    inner, fill = _part(0.0, 1.0, mesh.under, (False, True), mesh), _filling(mesh)

    def quarter(u: FloatArray, v: FloatArray) -> FloatArray:
        return np.column_stack([corner * u * (1.0 - v / 2.0), flat * v])

    def beyond(u: FloatArray, v: FloatArray) -> FloatArray:
        return _between(quarter(np.ones_like(v), v), block * np.column_stack([np.ones_like(v), v]), u)

    def above(u: FloatArray, v: FloatArray) -> FloatArray:
        return _between(quarter(u, np.ones_like(u)), block * np.column_stack([u, np.ones_like(u)]), v)

    yield _Patch(inner, inner, quarter, 1.0 + _empty(inner, inner), (UNDER, UNDER))
    yield _Patch(fill, inner, beyond, _empty(fill, inner), (UNDER, UNDER))
    yield _Patch(inner, fill, above, _empty(inner, fill), (UNDER, UNDER))
    yield from _around(block * inner, block, p, mesh)


def _filling(mesh: FixedMesh) -> FloatArray:
    """Lines from a pillar's rim to the edge of its block."""
    return _part(0.0, 1.0, 1, (True, False), mesh, less=1)


def _around(under: FloatArray, block: float, pitch: float, mesh: FixedMesh) -> Iterator[_Patch]:
    """The plate beside a block of so many lines."""
    beside = _part(block, pitch / 2.0, mesh.beside, (True, False), mesh)
    for u, v, grows in [*_four(under, beside)][1:]:
        yield _Patch(u, v, _straight, _empty(u, v), grows)


def _empty(u: FloatArray, v: FloatArray) -> FloatArray:
    return np.zeros((len(u) - 1, len(v) - 1))


def _between(start: FloatArray, end: FloatArray, share: FloatArray) -> FloatArray:
    return np.asarray(start + share[:, None] * (end - start))


def _exchanged(place: Map) -> Map:
    """The mirror image under x <-> y."""
    return lambda u, v: place(v, u)[:, ::-1]


def _joined(patches: list[_Patch], z: FloatArray, thickness: float, order: int) -> Mesh:
    """One mesh of all patches pulled up along z, nodes in the same place made one."""
    nodes, cells, pillar, spans, total = [], [], [], [], 0
    for patch in patches:
        own = hex_mesh(_boxes(patch, z, thickness), order)
        nodes.append(np.column_stack([patch.place(own.nodes[:, 0], own.nodes[:, 1]), own.nodes[:, 2]]))
        cells.append(own.cells + total)
        pillar.append(np.isin(np.arange(len(own.cells)), own.regions.get("pillar", np.empty(0, dtype=int))))
        spans.append(own.spans if own.spans is not None else np.empty((0, 3)))
        total += len(own.nodes)
    places = np.concatenate(nodes)
    _, first, same = np.unique(
        np.round(places / (1e-9 * np.abs(places).max())).astype(np.int64),
        axis=0,
        return_index=True,
        return_inverse=True,
    )
    standing = np.concatenate(pillar)
    regions = {"plate": np.flatnonzero(~standing), "pillar": np.flatnonzero(standing)}
    lengths = np.concatenate(spans) if all(patch.place is _straight for patch in patches) else None
    joined = Mesh(places[first], same.ravel()[np.concatenate(cells)], "hex", order, regions, {}, lengths)
    return replace(joined, faces=_outer(joined))


def _boxes(patch: _Patch, z: FloatArray, thickness: float) -> Boxes:
    high = (z[1:] + z[:-1]) / 2.0 > thickness
    region = np.where(high, np.where(patch.inside[:, :, None] > 0.0, 1, -1), 0)
    return Boxes(patch.u, patch.v, z, region, ("plate", "pillar"))


def _outer(mesh: Mesh) -> dict[str, IntArray]:
    """The facets in the planes that bound the quarter, by name."""
    (local,) = mesh.element.facets
    facets = np.concatenate([mesh.cells[:, face] for face in local])
    low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    near = 1e-9 * (high - low)
    names = (("x-", 0, low), ("x+", 0, high), ("y-", 1, low), ("y+", 1, high), ("touch", 2, low), ("top", 2, high))
    flat = {
        name: (np.abs(mesh.nodes[:, axis] - end[axis]) <= near[axis])[facets].all(axis=1) for name, axis, end in names
    }
    return {name: facets[on] for name, on in flat.items()}


def _tapered(mesh: Mesh, foot: Foot, thickness: float, height: float) -> Mesh:
    """The mesh with the pillar narrowed or widened linearly towards its tip."""
    if foot.taper == 1.0:
        return mesh
    above = np.maximum(mesh.nodes[:, 2] - thickness, 0.0) / height
    wide = 1.0 + (foot.taper - 1.0) * above
    return replace(mesh, nodes=mesh.nodes * np.column_stack([wide, wide, np.ones_like(wide)]), spans=None)


def _stretched(patches: list[_Patch], z: FloatArray, thickness: float) -> IntArray:
    """For each element the numbers of the stretches along x, y and z."""
    rows = []
    for patch in patches:
        region = _boxes(patch, z, thickness).region.transpose(2, 1, 0)  # elements come x fastest
        own = region[region >= 0]
        rows.append(np.column_stack([np.full(len(own), patch.grows[0]), np.full(len(own), patch.grows[1]), own]))
    return np.concatenate(rows)
