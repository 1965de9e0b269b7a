"""Hexahedra of 20 nodes (C3D20, HE20) as hexahedra of 27: faces and cells get the middles that they lack.

The 27-node map through those points is the 20-node map itself, so that curved bodies stay as they are; its displacements are
richer, its frequencies at most those of the 20-node element.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from geometry.elements import FloatArray, IntArray
from geometry.formats.neutral import PLACES, RawMesh, corner_keys

SERENDIPITY, FULL = "hexahedron20", "hexahedron27"
_EDGES, _FACES = PLACES[SERENDIPITY][8:], PLACES[FULL][20:26]
_EDGES_OF_FACES = tuple([i for i, edge in enumerate(_EDGES) if set(edge) <= set(face)] for face in _FACES)
Middles = Callable[[FloatArray, IntArray, IntArray, tuple[tuple[int, ...], ...], str], IntArray]


def completed(raw: RawMesh, middles: Middles, file: str) -> RawMesh:
    """The mesh with 27 nodes to each hexahedron of 20; `middles` puts the nodes on edges into our order.

    Raises what `middles` raises.
    """
    chosen = [index for index, (kind, block) in enumerate(raw.blocks) if kind == SERENDIPITY and len(block)]
    if not chosen:
        return raw
    cells = np.vstack([raw.blocks[index][1] for index in chosen])
    corners = cells[:, :8]
    edges = middles(raw.points, corners, cells[:, 8:], _EDGES, file)
    keys = corner_keys(corners[:, np.array(_FACES)].reshape(-1, 4), 4)
    _, first, face = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    face_points = np.stack([_face_middle(raw.points, corners, edges, number) for number in range(6)], axis=1)
    cell_points = (raw.points[edges].sum(axis=1) - raw.points[corners].sum(axis=1)) / 4.0
    start = len(raw.points)
    centres = start + len(first) + np.arange(len(cells))
    full = np.hstack([corners, edges, start + face.reshape(-1, 6), centres[:, None]])
    ends = np.cumsum([len(raw.blocks[index][1]) for index in chosen])[:-1]
    parts = dict(zip(chosen, np.split(full, ends), strict=True))
    blocks = [(FULL, parts[i]) if i in parts else block for i, block in enumerate(raw.blocks)]
    points = np.vstack([raw.points, face_points.reshape(-1, 3)[first], cell_points])
    return replace(raw, points=points, blocks=blocks)


def _face_middle(points: FloatArray, corners: IntArray, edges: IntArray, face: int) -> FloatArray:
    """Where the 20-node map puts the middle of a local face: half its edges' middles less a quarter of its corners."""
    on_edges, on_corners = points[edges[:, _EDGES_OF_FACES[face]]], points[corners[:, list(_FACES[face])]]
    return np.asarray(on_edges.sum(axis=1) / 2.0 - on_corners.sum(axis=1) / 4.0)
