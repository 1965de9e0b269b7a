"""Meshes to files and back."""

from __future__ import annotations

import numpy as np

from geometry.elements import IntArray
from geometry.formats.neutral import FACET, PLACES
from geometry.formats.reader import read_mesh
from geometry.mesh import AnyMesh


def load(file: str, unit: str = "m") -> AnyMesh:
    """The mesh of a file in our node order, m."""
    return read_mesh(file, unit).mesh


def facet_nodes(kind: str, order: int) -> IntArray:
    """Our local node of a named face (hexahedra: u fastest) at each of VTK's places of its facet cell."""
    places = PLACES[FACET[kind, order]]
    if kind == "tet":
        return np.arange(len(places))
    corners = order * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    grid = np.array([corners[list(place)].mean(axis=0) for place in places])
    return np.asarray(np.rint(grid @ [1, order + 1]), dtype=np.int64)
