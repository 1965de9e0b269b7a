"""Straight tetrahedra made quadratic: one node in the middle of each edge, on the CAD surface where that is curved."""

from __future__ import annotations

import logging

import numpy as np

from geometry.cad.surface import CadSurface
from geometry.elements import TET_EDGES, FloatArray, IntArray
from geometry.mesh import Mesh, jacobians
from geometry.tet.snapping import Boundary, onto_faces

MIN_RATIO = 0.1  # least Jacobian over its greatest in an element before its edges are straightened again
ROUNDS = 10

log = logging.getLogger(__name__)


def quadratic(
    vertices: FloatArray, cells: IntArray, boundary: Boundary, surface: CadSurface
) -> tuple[FloatArray, IntArray]:
    """Nodes and ten-node cells (VTK order), edges shared once; lengths in mm.

    Middle nodes on curved faces are projected onto them; in an element whose Jacobian would fall below MIN_RATIO of
    its largest value they go back to the straight middle.
    """
    ends = np.sort(cells[:, TET_EDGES].reshape(-1, 2), axis=1)
    edges, number = np.unique(ends, axis=0, return_inverse=True)
    full = np.hstack([cells, len(vertices) + number.reshape(-1, 6)])
    straight = vertices[edges].mean(axis=1)
    curved = _projected(vertices, edges, boundary, surface)
    keep = (curved != straight).any(axis=1)
    for _ in range(ROUNDS):
        nodes = np.vstack([vertices, np.where(keep[:, None], curved, straight)])
        bad = _bent_too_far(nodes, full, keep[full[:, 4:] - len(vertices)].any(axis=1))
        if not len(bad):
            break
        keep[full[bad, 4:] - len(vertices)] = False
        log.info("%d element(s) next to curved faces keep straight edges", len(bad))
    return nodes, full


def _projected(vertices: FloatArray, edges: IntArray, boundary: Boundary, surface: CadSurface) -> FloatArray:
    """Edge middles, those of edges on curved faces moved onto them."""
    middles = vertices[edges].mean(axis=1)
    outer, faces_at = boundary.edge_faces()
    order = np.lexsort(edges.T[::-1])
    code = edges[order] @ np.array([len(vertices), 1])
    place = order[np.searchsorted(code, outer @ np.array([len(vertices), 1]))]
    for index, faces in zip(place, faces_at, strict=True):
        if not all(surface.faces[i].flat for i in faces):
            middles[index] = onto_faces(middles[index : index + 1], faces, surface)[0]
    return middles


def _bent_too_far(nodes: FloatArray, full: IntArray, candidates: FloatArray) -> IntArray:
    chosen = np.flatnonzero(candidates)
    if not len(chosen):
        return chosen
    mesh = Mesh(nodes, full, "tet", 2)
    at = np.vstack([mesh.element.quadrature.points, mesh.element.points])
    determinants = np.linalg.det(jacobians(mesh, chosen, at))
    return chosen[determinants.min(axis=1) < MIN_RATIO * determinants.max(axis=1)]
