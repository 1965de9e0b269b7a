"""Hexahedra of 20 nodes (C3D20, HE20), wedges of 15 (C3D15) and pyramids of 13 as those of 27, 18 and 14 nodes.

Square faces and hexahedra get the middles that they lack. The full map through those points is the map without them, so that
curved bodies stay as they are; its displacements are richer, its frequencies at most those of the element in the file.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from geometry.elements import FloatArray, IntArray
from geometry.formats.neutral import CORNER_COUNT, PLACES, Places, RawMesh, corner_keys, family, rows_in

FULL = {"hexahedron20": "hexahedron27", "wedge15": "wedge18", "pyramid13": "pyramid14"}
Middles = Callable[[FloatArray, IntArray, IntArray, Places, str], IntArray]


def completed(raw: RawMesh, middles: Middles, file: str) -> RawMesh:
    """The mesh with its square faces' and hexahedra's middles; `middles` puts the nodes on edges into our order.

    A face that a complete element beside it names a middle of keeps that one. Raises what `middles` raises.
    """
    points = raw.points
    keys, nodes = _named_middles(raw, middles, file)
    blocks = list(raw.blocks)
    for index, (kind, block) in enumerate(raw.blocks):
        if kind not in FULL or not len(block):
            continue
        count = CORNER_COUNT[family(kind)]
        corners = block[:, :count]
        edges = middles(points, corners, block[:, count:], PLACES[kind][count:], file)
        own = corner_keys(corners[:, np.array(_squares(kind))].reshape(-1, 4), 4)
        places = np.stack([_face_middle(points, corners, edges, kind, face) for face in _squares(kind)], axis=1)
        keys, first = np.unique(np.vstack([keys, own]), axis=0, return_index=True)
        number = np.concatenate([nodes, np.full(len(own), -1)])[first]
        fresh = number < 0
        number[fresh] = len(points) + np.arange(fresh.sum())
        points = np.vstack([points, places.reshape(-1, 3)[first[fresh] - len(nodes)]])
        nodes = number
        full = [corners, edges, nodes[rows_in(own, keys)].reshape(len(block), -1)]
        if kind == "hexahedron20":
            full.append(len(points) + np.arange(len(block))[:, None])
            points = np.vstack([points, (points[edges].sum(axis=1) - points[corners].sum(axis=1)) / 4.0])
        blocks[index] = (FULL[kind], np.hstack(full))
    groups = {name: _with_middles(members, keys, nodes, len(raw.points)) for name, members in raw.node_groups.items()}
    return replace(raw, points=points, blocks=blocks, node_groups=groups)


def _with_middles(members: IntArray, keys: IntArray, nodes: IntArray, given: int) -> IntArray:
    """A group of nodes with the added middles of the faces whose corners it holds."""
    inside = np.isin(keys, members).all(axis=1) & (nodes >= given) if len(keys) else np.zeros(0, dtype=bool)
    return np.union1d(members, nodes[inside])


def _squares(kind: str) -> Places:
    """Corners of the square faces that a cell without their middles has, in the order of their middles."""
    return tuple(place for place in PLACES[FULL[kind]][len(PLACES[kind]) :] if len(place) == 4)


def _named_middles(raw: RawMesh, middles: Middles, file: str) -> tuple[IntArray, IntArray]:
    """Sorted corners (m, 4) and middles (m,) of the square faces that elements name, where others do not."""
    if not any(kind in FULL and len(block) for kind, block in raw.blocks):
        return np.empty((0, 4), dtype=np.int64), np.empty(0, dtype=np.int64)
    keys, nodes = [np.empty((0, 4), dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    for kind, block in raw.blocks:
        if kind not in FULL.values() or not len(block):
            continue
        count = CORNER_COUNT[family(kind)]
        placed = middles(raw.points, block[:, :count], block[:, count:], PLACES[kind][count:], file)
        for column, place in enumerate(PLACES[kind][count:]):
            if len(place) == 4:
                keys.append(corner_keys(block[:, list(place)], 4))
                nodes.append(placed[:, column])
    distinct, first = np.unique(np.vstack(keys), axis=0, return_index=True)
    return distinct, np.concatenate(nodes)[first]


def _face_middle(
    points: FloatArray, corners: IntArray, edges: IntArray, kind: str, face: tuple[int, ...]
) -> FloatArray:
    """Where the map without it puts the middle of a square face: half its edges' middles less a quarter of its corners."""
    around = [i for i, edge in enumerate(PLACES[kind][CORNER_COUNT[family(kind)] :]) if set(edge) <= set(face)]
    return np.asarray(points[edges[:, around]].sum(axis=1) / 2.0 - points[corners[:, list(face)]].sum(axis=1) / 4.0)
