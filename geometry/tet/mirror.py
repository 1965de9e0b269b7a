"""A mesh and its mirror image merged into one."""

from __future__ import annotations

import numpy as np

from geometry.elements import IntArray
from geometry.errors import MeshError
from geometry.mesh import Mesh

TET_SWAP = {1: [1, 0, 2, 3], 2: [1, 0, 2, 3, 4, 6, 5, 8, 7, 9]}  # nodes 0 and 1 exchanged keep the volume positive
TRIANGLE_SWAP = {1: [1, 0, 2], 2: [1, 0, 2, 3, 5, 4]}


def mirror_mesh(mesh: Mesh, axis: int) -> Mesh:
    """Join a tetrahedral mesh at x_axis >= 0 with its image: nodes of the plane x_axis = 0 are shared, bit for bit.

    Face "x-" (axis 0) or "y-" (axis 1) must be that plane; it becomes the image of the opposite side.
    Raises MeshError when the mesh does not end exactly on the plane.
    """
    low, high = f"{'xyz'[axis]}-", f"{'xyz'[axis]}+"
    on_plane = mesh.nodes[:, axis] == 0.0
    if mesh.kind != "tet" or mesh.nodes[:, axis].min() < 0.0 or not on_plane[mesh.nodes_of(low)].all():
        raise MeshError(f"only a tetrahedral mesh whose face '{low}' lies exactly on 0 can be mirrored")
    image = np.arange(len(mesh.nodes))
    image[~on_plane] = len(mesh.nodes) + np.arange(np.count_nonzero(~on_plane))
    flip = np.ones(3)
    flip[axis] = -1.0
    nodes = np.vstack([mesh.nodes, mesh.nodes[~on_plane] * flip])
    cells = np.vstack([mesh.cells, image[mesh.cells][:, TET_SWAP[mesh.order]]])
    regions = {name: np.concatenate([part, part + len(mesh.cells)]) for name, part in mesh.regions.items()}
    faces = {name: np.vstack([own, _image(own, image, mesh.order)]) for name, own in mesh.faces.items()}
    if high in mesh.faces:
        faces[high], faces[low] = mesh.faces[high], _image(mesh.faces[high], image, mesh.order)
    else:
        del faces[low]
    return Mesh(nodes, cells, mesh.kind, mesh.order, regions, faces)


def _image(faces: IntArray, image: IntArray, order: int) -> IntArray:
    return np.asarray(image[faces][:, TRIANGLE_SWAP[order]])
