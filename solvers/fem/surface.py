"""Integrals over a named face: interpolation to quadrature points and their weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np
import scipy.sparse as sp
from numpy.polynomial import legendre

from geometry.elements import TRIANGLES, BoolArray, Element, FloatArray, IntArray, corner_ring, element
from geometry.mesh import AnyMesh, Mesh
from solvers.fem import quadrature

# Dunavant's rule of degree 4 on the unit triangle, from its two orbits (dunavant1985)
_TRIANGLE = ((0.44594849091596489, 0.22338158967801147), (0.09157621350977073, 0.10995174365532187))

BENT = 1e-3  # of an edge's length: how far its nodes lie off the chord


@dataclass(frozen=True)
class FaceQuadrature:
    """Points (q, 3) in m, weights (q,) in m2, and the sparse interpolation (q, n) from nodes to points."""

    points: FloatArray
    weights: FloatArray
    interpolation: sp.csr_array


@dataclass(frozen=True)
class Frame:
    """A frame that a face is measured in: origin (3,) in m, and right-handed axes as rows (3, 3), z into the body."""

    origin_m: FloatArray
    axes: FloatArray

    def places(self, points: FloatArray) -> FloatArray:
        """Points (n, 3), m, in the frame."""
        return np.asarray((points - self.origin_m) @ self.axes.T)


@dataclass(frozen=True)
class Skin:
    """An outer surface that moves: points (p, 3) in m, facets (m, corners), displacements (k, p, 3)."""

    points: FloatArray
    facets: IntArray
    displacement: FloatArray

    def unfolded(self, symmetry: str | None) -> Skin:
        """The whole body from its quarter x, y >= 0 of a symmetry class (SS to AA, of u_z), or itself."""
        skin = self
        for axis, mark in enumerate(symmetry or ""):
            flip = np.ones(3)
            flip[axis] = -1.0
            image = flip * skin.displacement * (1.0 if mark == "S" else -1.0)
            facets = np.concatenate([skin.facets, skin.facets[:, ::-1] + len(skin.points)])
            points = np.concatenate([skin.points, skin.points * flip])
            skin = Skin(points, facets, np.concatenate([skin.displacement, image], axis=1))
        return skin


def face_quadrature(mesh: AnyMesh, face: str, lines_m: Sequence[float] = ()) -> FaceQuadrature:
    """Quadrature over a named face, exact for squared displacements on flat faces; no facet's rule straddles a line y = const
    of `lines_m`, so that sums over the points on one side of it are integrals over that side.

    Raises MeshError for a face that the mesh does not have.
    """
    return joined([facet_quadrature(mesh.nodes, facets, mesh.order, lines_m) for facets in mesh.facets_of(face)])


def joined(parts: list[FaceQuadrature]) -> FaceQuadrature:
    """One rule over several sets of facets on the same nodes."""
    if len(parts) == 1:
        return parts[0]
    points, weights = (np.concatenate([getattr(part, name) for part in parts]) for name in ("points", "weights"))
    return FaceQuadrature(points, weights, sp.csr_array(sp.vstack([part.interpolation for part in parts])))


def facet_quadrature(nodes: FloatArray, faces: IntArray, order: int, lines_m: Sequence[float] = ()) -> FaceQuadrature:
    """The same over facets (f, k) of one shape on nodes (n, 3) in m."""
    if not len(lines_m):
        return _uncut(nodes, faces, order)
    solid, own = _solid(faces.shape[1], order)
    straight = quadrature.is_straight(nodes[faces], solid.points[own, :2])
    cut = quadrature.may_be_cut(nodes[faces][:, :, 1], straight, lines_m)
    rules = _cut_rules(nodes, faces[cut], order, np.sort(lines_m), straight[cut]) if cut.any() else []
    return joined([_uncut(nodes, faces[~cut], order), *rules])


def _uncut(nodes: FloatArray, faces: IntArray, order: int) -> FaceQuadrature:
    """The same rule on every facet."""
    if faces.shape[1] in TRIANGLES:
        at, weights = _dunavant()
    else:
        line, weight = legendre.leggauss(order + 1)
        at = np.column_stack([np.tile(line, len(line)), np.repeat(line, len(line))])
        weights = np.asarray(np.kron(weight, weight))
    return _mapped(nodes, faces, *_shape(_solid(faces.shape[1], order), at), weights)


def _mapped(
    nodes: FloatArray, faces: IntArray, value: FloatArray, slopes: FloatArray, weights: FloatArray
) -> FaceQuadrature:
    """A rule by its shape functions (q, k), their slopes (2, q, k) and reference weights (q,), on facets (f, k)."""
    corners = nodes[faces]
    points = np.einsum("qk,fkj->fqj", value, corners)
    tangents = np.einsum("mqk,fkj->mfqj", slopes, corners)
    area = np.linalg.norm(np.cross(tangents[0], tangents[1]), axis=2) * weights
    rows = np.repeat(np.arange(points.shape[0] * points.shape[1]), value.shape[1])
    columns = np.repeat(faces[:, None, :], len(weights), axis=1).ravel()
    data = np.broadcast_to(value, (len(faces), *value.shape)).ravel()
    matrix = sp.csr_array((data, (rows, columns)), shape=(len(faces) * len(weights), len(nodes)))
    return FaceQuadrature(points.reshape(-1, 3), area.ravel(), matrix)


def _cut_rules(
    nodes: FloatArray, faces: IntArray, order: int, lines_m: FloatArray, straight: BoolArray
) -> list[FaceQuadrature]:
    """A rule of its own for every facet that lines may cut."""
    is_triangle, rules = faces.shape[1] in TRIANGLES, []
    shape = partial(_shape, _solid(faces.shape[1], order))
    whole = quadrature.TRIANGLE if is_triangle else quadrature.SQUARE
    for facet, flat in zip(faces, straight.tolist(), strict=True):
        at, weights = quadrature.CutFacet(shape, order, nodes[facet, 1], lines_m, flat).rule(whole)
        rules.append(_mapped(nodes, facet[None], *shape(at), weights))
    return rules


def _solid(count: int, order: int) -> tuple[Element, IntArray]:
    """The element that has a facet of so many nodes at its least z, and which of its nodes these are, in the facet's order."""
    solid = element("tet" if count in TRIANGLES else "hex", order)
    height = solid.points[:, 2]
    return solid, np.flatnonzero(height == height.min())


def _shape(solid: tuple[Element, IntArray], at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Values (q, k) and slopes (2, q, k) of a facet's functions at points (q, 2) of [-1, 1]^2 or of the unit triangle."""
    body, own = solid
    value, slope = body.shape(np.column_stack([at, np.full(len(at), body.points[own[0], 2])]))
    return value[:, own], slope[:, own, :2].transpose(2, 0, 1)


def _dunavant() -> tuple[FloatArray, FloatArray]:
    """Points (6, 2) and weights (6,) on the unit triangle."""
    points, weights = [], []
    for a, weight in _TRIANGLE:
        for place in range(3):
            point = [a, a, a]
            point[place] = 1.0 - 2.0 * a
            points.append(point[1:])
            weights.append(weight / 2.0)
    return np.array(points), np.array(weights)


def triangles(facets: IntArray) -> IntArray:
    """Facets as triangles, (m, 3) as they are, (m, 4) cut in two, (2 m, 3)."""
    return np.concatenate([facets[:, [0, 1, 2]], facets[:, [0, 2, 3]]]) if facets.shape[1] == 4 else facets


def skin_faces(mesh: AnyMesh) -> IntArray:
    """Corner nodes of every outer facet, shape (m, 4) for hexahedra (in ring order) or (m, 3) for tetrahedra; where both
    shapes occur, triangles repeat their last corner. Facets of hexahedra are cut at every node of their curved edges.
    """
    if isinstance(mesh, Mesh) and mesh.kind == "hex" and mesh.spans is None:
        (local,) = mesh.element.facets
        facets = mesh.cells[:, local].reshape(-1, local.shape[1])
        return _cut(mesh.nodes, facets[_once(corner_ring(facets, mesh.order))], mesh.order)
    shapes: dict[int, list[IntArray]] = {3: [], 4: []}
    for block in mesh.blocks:
        for local in block.element.facets:
            ring = corner_ring(local, block.order)
            shapes[ring.shape[1]].append(block.cells[:, ring].reshape(-1, ring.shape[1]))
    outer = [corners[_once(corners)] for corners in (np.concatenate(each) for each in shapes.values() if each)]
    return outer[0] if len(outer) == 1 else np.concatenate([outer[0][:, [0, 1, 2, 2]], outer[1]])


def _once(facets: IntArray) -> IntArray:
    """Numbers of the facets that stand once."""
    _, index, counts = np.unique(np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True)
    return np.sort(index[counts == 1])


def _cut(nodes: FloatArray, facets: IntArray, order: int) -> IntArray:
    """Corners (m, 4) of facets (f, nodes), u fastest, those with curved edges cut into `order` pieces along these."""
    grid = facets.reshape(-1, order + 1, order + 1)  # v, u
    along_u = _bent(nodes[grid[:, ::order]]).any(axis=1)
    along_v = _bent(nodes[grid.swapaxes(1, 2)[:, ::order]]).any(axis=1)
    pieces = []
    for v_bent, u_bent in product((False, True), repeat=2):
        own = grid[(along_v == v_bent) & (along_u == u_bent)]
        lines = own[:, :: 1 if v_bent else order, :: 1 if u_bent else order]
        corners = [lines[:, :-1, :-1], lines[:, :-1, 1:], lines[:, 1:, 1:], lines[:, 1:, :-1]]
        pieces.append(np.stack(corners, axis=-1).reshape(-1, 4))
    return np.concatenate(pieces)


def _bent(edges: FloatArray) -> BoolArray:
    """Which edges, nodes (..., n, 3) in a row, leave the chord between their ends."""
    start, chord = edges[..., :1, :], edges[..., -1:, :] - edges[..., :1, :]
    length = np.linalg.norm(chord, axis=-1)
    off = np.linalg.norm(np.cross(edges - start, np.broadcast_to(chord, edges.shape)), axis=-1)
    return np.asarray((off > BENT * length**2).any(axis=-1))
