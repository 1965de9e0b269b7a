"""A finite-element mesh with named regions and faces, its checks, and hexahedra cut into tetrahedra."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property
from itertools import permutations
from typing import Any

import numpy as np

from geometry.elements import TET_EDGES, Element, FloatArray, IntArray, element
from geometry.errors import MeshError

FLAT = 1e-12  # relative deviation below which an element counts as affine
CHUNK = 4096  # elements a time: bounds the memory of a check


class _Named:
    """Common part of meshes of one and of several element kinds: counts and named regions and faces."""

    nodes: FloatArray
    regions: dict[str, IntArray]
    faces: dict[str, Any]

    @property
    def blocks(self) -> tuple[Mesh, ...]:
        """The mesh as blocks of one element kind each, on the same nodes."""
        raise NotImplementedError

    @property
    def dof(self) -> int:
        """Displacement degrees of freedom before any constraint."""
        return 3 * len(self.nodes)

    @property
    def cell_count(self) -> int:
        """Number of elements."""
        return sum(len(block.cells) for block in self.blocks)

    def facets_of(self, face: str) -> tuple[IntArray, ...]:
        """Facets of a named face by shape. Raises MeshError for a name the mesh does not have."""
        if face not in self.faces:
            raise MeshError(f"the mesh has no face '{face}'; it has {', '.join(sorted(self.faces))}")
        facets = self.faces[face]
        return facets if isinstance(facets, tuple) else (facets,)

    def nodes_of(self, face: str) -> IntArray:
        """Sorted node indices of a named face. Raises MeshError for a name the mesh does not have."""
        return np.unique(np.concatenate([part.ravel() for part in self.facets_of(face)]))

    @cached_property
    def sha256(self) -> str:
        """Hash of nodes, cells, regions and faces: a mesh is an input of a case."""
        digest = hashlib.sha256(b"".join(self._about()))
        faces = {name: np.concatenate([part.ravel() for part in self.facets_of(name)]) for name in self.faces}
        for named in (self.regions, faces):
            for name in sorted(named):
                digest.update(name.encode() + named[name].tobytes())
        return digest.hexdigest()

    def _about(self) -> list[bytes]:
        """Header of the hash."""
        raise NotImplementedError

    @property
    def standing(self) -> tuple[str, ...]:
        """Regions of the pillars."""
        return tuple(name for name in self.regions if name == "pillar" or name.startswith("section"))

    def region_of_cells(self) -> dict[str, IntArray]:
        """Regions, or the whole mesh as `body` when none is named."""
        return self.regions or {"body": np.arange(self.cell_count)}


@dataclass(frozen=True)
class Mesh(_Named):
    """Nodes (n, 3) in m, cells (e, k) of one element kind, named regions (cell indices) and faces (m, kf node indices).

    `spans` holds the elements' edge lengths (e, 3) in m when every element is a box along the axes.
    """

    nodes: FloatArray
    cells: IntArray
    kind: str
    order: int
    regions: dict[str, IntArray] = field(default_factory=dict)
    faces: dict[str, IntArray] = field(default_factory=dict)
    spans: FloatArray | None = None

    @property
    def element(self) -> Element:
        """The reference element."""
        return element(self.kind, self.order)

    @property
    def blocks(self) -> tuple[Mesh, ...]:
        """The mesh itself."""
        return (self,)

    def _about(self) -> list[bytes]:
        return [f"{self.kind}{self.order}".encode(), self.nodes.tobytes(), self.cells.tobytes()]


@dataclass(frozen=True)
class MixedMesh(_Named):
    """Blocks of several element kinds and one order on the same nodes (n, 3) in m.

    `regions` count elements over the blocks one after another; `faces` hold a named face's facets by shape.
    """

    nodes: FloatArray
    parts: tuple[Mesh, ...]
    regions: dict[str, IntArray] = field(default_factory=dict)
    faces: dict[str, tuple[IntArray, ...]] = field(default_factory=dict)

    @property
    def blocks(self) -> tuple[Mesh, ...]:
        """The blocks."""
        return self.parts

    @property
    def kind(self) -> str:
        """The kinds, such as hex+wedge."""
        return "+".join(block.kind for block in self.parts)

    @property
    def order(self) -> int:
        """Order of every element."""
        return self.parts[0].order

    def _about(self) -> list[bytes]:
        return [block.sha256.encode() for block in self.parts]


AnyMesh = Mesh | MixedMesh


def jacobians(mesh: Mesh, cells: IntArray, at: FloatArray) -> FloatArray:
    """Compute the Jacobian matrices d x_j / d xi_m of elements at reference points.

    Parameters
    ----------
    mesh : Mesh
        Mesh in m.
    cells : ndarray, shape (e,)
        Numbers of the elements.
    at : ndarray, shape (q, 3)
        Reference points.

    Returns
    -------
    ndarray, shape (e, q, 3, 3)
        Entry [..., m, j] is d x_j / d xi_m in m.
    """
    _, gradient = mesh.element.shape(at)
    return np.asarray(np.einsum("qkm,ekj->eqmj", gradient, mesh.nodes[mesh.cells[cells]], optimize=True))


def cell_volumes(mesh: Mesh) -> FloatArray:
    """Compute the volume of every element by quadrature.

    Parameters
    ----------
    mesh : Mesh
        Mesh in m.

    Returns
    -------
    ndarray, shape (e,)
        Volumes in m^3.
    """
    if mesh.spans is not None:
        return np.asarray(mesh.spans.prod(axis=1))
    rule = mesh.element.quadrature
    volumes = np.empty(len(mesh.cells))
    for part in _parts(len(mesh.cells)):
        volumes[part] = np.linalg.det(jacobians(mesh, part, rule.points)) @ rule.weights
    return volumes


def is_affine(mesh: Mesh) -> FloatArray:
    """Find the elements that are affine images of the reference element.

    Parameters
    ----------
    mesh : Mesh
        Mesh in any unit.

    Returns
    -------
    ndarray, shape (e,)
        Mask of the affine elements.
    """
    if mesh.spans is not None or (mesh.order == 1 and mesh.kind == "tet"):
        return np.ones(len(mesh.cells), dtype=bool)
    corners = mesh.element.points
    basis = np.column_stack([np.ones(len(corners)), corners])
    project = np.eye(len(corners)) - basis @ np.linalg.pinv(basis)
    deviation = np.abs(np.einsum("ak,ekj->eaj", project, mesh.nodes[mesh.cells])).max(axis=(1, 2))
    size = np.ptp(mesh.nodes[mesh.cells], axis=1).max(axis=1)
    return np.asarray(deviation <= FLAT * size)


@dataclass(frozen=True)
class MeshReport:
    """Results of the checks: volumes in m3, the smallest ratio of Jacobian minimum to maximum in an element."""

    cells: int
    nodes: int
    volume_m3: float
    worst_jacobian_ratio: float


def check_mesh(mesh: AnyMesh, volume_m3: float | None = None, tolerance: float = 1e-3) -> MeshReport:
    """Check Jacobians at the quadrature points, orphan nodes, and the volume.

    Parameters
    ----------
    mesh : Mesh or MixedMesh
        Mesh in m.
    volume_m3 : float, optional
        Exact volume in m^3, such as that of the CAD solid.
    tolerance : float, optional
        Allowed relative difference of the volume.

    Returns
    -------
    MeshReport
        Counts, volume and the worst Jacobian ratio.

    Raises
    ------
    MeshError
        Naming the worst element, the orphan or the difference of the volumes.
    """
    if not np.isfinite(mesh.nodes).all():
        raise MeshError("the mesh has a node that is not a number")
    unused = np.setdiff1d(np.arange(len(mesh.nodes)), np.concatenate([block.cells.ravel() for block in mesh.blocks]))
    if len(unused):
        raise MeshError(f"{len(unused)} orphan node(s), the first is node {unused[0]}: no element uses it")
    ratio = min(_sound(block) for block in mesh.blocks)
    volume = float(sum(cell_volumes(block).sum() for block in mesh.blocks))
    if volume_m3 is not None and abs(volume - volume_m3) > tolerance * volume_m3:
        off = volume / volume_m3 - 1.0
        raise MeshError(f"mesh volume differs from the solid's by {off:+.2e}, allowed is {tolerance:.0e}")
    return MeshReport(mesh.cell_count, len(mesh.nodes), volume, ratio)


def _sound(mesh: Mesh) -> float:
    """The worst Jacobian ratio of a block. Raises MeshError where it is not above 0."""
    ratio, worst = _worst_jacobian(mesh)
    if not ratio > 0.0:
        centre = 1e3 * mesh.nodes[mesh.cells[worst]].mean(axis=0)
        place = ", ".join(f"{c:.3f}" for c in centre)
        raise MeshError(f"element {worst} at ({place}) mm is inverted or flat: Jacobian ratio {ratio:.2e}, must be > 0")
    return ratio


def _worst_jacobian(mesh: Mesh) -> tuple[float, int]:
    """Smallest (signed minimum / maximum magnitude) of det J over one element's quadrature points, and where."""
    if mesh.spans is not None:
        worst = int(mesh.spans.min(axis=1).argmin())
        return (1.0 if mesh.spans[worst].min() > 0.0 else -1.0), worst
    points = np.vstack([mesh.element.quadrature.points, mesh.element.points])
    best, worst = np.inf, 0
    for part in _parts(len(mesh.cells)):
        determinants = np.linalg.det(jacobians(mesh, part, points))
        ratios = determinants.min(axis=1) / np.maximum(np.abs(determinants).max(axis=1), 1e-300)
        here = int(ratios.argmin())
        if ratios[here] < best:
            best, worst = float(ratios[here]), int(part[here])
    return best, worst


def _parts(count: int) -> list[IntArray]:
    return np.array_split(np.arange(count), max(1, -(-count // CHUNK)))


# -- hexahedra cut into tetrahedra -------------------------------------------------------------------------------------
# Hexahedra of order 1 or 2 cut into tetrahedra of the same order on the same nodes.

PER_HEXAHEDRON = 6


def split_hexahedra(mesh: Mesh) -> Mesh:
    """Cut every hexahedron into six tetrahedra along its diagonal from the lowest to the highest corner.

    Neighbours cut their common face along the same diagonal, so the mesh conforms; no node is added or lost.

    Parameters
    ----------
    mesh : Mesh
        Hexahedra of order 1 or 2.

    Returns
    -------
    Mesh
        Tetrahedra of the same order on the same nodes.

    Raises
    ------
    ValueError
        For another element.

    References
    ----------
    .. [1] kuhn1960 (docs/references.bib)
    """
    if mesh.kind != "hex" or mesh.order not in (1, 2):
        raise ValueError(f"only hexahedra of order 1 or order 2 are split, not {mesh.kind} of order {mesh.order}")
    local, triangles = _tetrahedra(mesh.order), _triangles(mesh.order)
    cells = mesh.cells[:, local].reshape(-1, local.shape[1])
    parts = np.arange(PER_HEXAHEDRON)
    regions = {name: (PER_HEXAHEDRON * old[:, None] + parts).ravel() for name, old in mesh.regions.items()}
    faces = {name: nodes[:, triangles].reshape(-1, triangles.shape[1]) for name, nodes in mesh.faces.items()}
    return Mesh(mesh.nodes, cells, "tet", mesh.order, regions, faces)


def _tetrahedra(order: int) -> IntArray:
    """Local nodes of the six tetrahedra, (6, 4 or 10): one path along the axes for each order of taking them."""
    local = []
    for axes in permutations(range(3)):
        steps = np.vstack([np.zeros(3, dtype=np.int64), np.cumsum(np.eye(3, dtype=np.int64)[list(axes)], axis=0)])
        corners = order * steps
        if np.linalg.det(corners[1:] - corners[0]) < 0.0:
            corners = corners[[0, 2, 1, 3]]
        local.append(_numbered(corners, corners[TET_EDGES].sum(axis=1) // 2, order))
    return np.array(local)


def _triangles(order: int) -> IntArray:
    """Local nodes of a face's two triangles, (2, 3 or 6)."""
    local = []
    for corners in (np.array([[0, 0], [1, 0], [1, 1]]), np.array([[0, 0], [1, 1], [0, 1]])):
        local.append(_numbered(order * corners, order * (corners + np.roll(corners, -1, axis=0)) // 2, order))
    return np.array(local)


def _numbered(corners: IntArray, middles: IntArray, order: int) -> IntArray:
    """Numbers of places on an element's own grid, the first axis fastest; the middles where the order has them."""
    places = np.vstack([corners, middles]) if order == 2 else corners
    return np.asarray(places @ (order + 1) ** np.arange(places.shape[1]))
