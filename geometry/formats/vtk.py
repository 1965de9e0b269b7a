"""VTK's files: meshes and their fields as VTU, surfaces that move as VTKHDF."""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np

from geometry.elements import FloatArray, IntArray
from geometry.files import written_whole
from geometry.mesh import Mesh

# -- VTU ---------------------------------------------------------------------------------------------------------------
# Meshes and their fields as VTU, for ParaView and other readers.

SPACED = 2  # up to this order Gauss-Lobatto nodes are equally spaced, as VTK's Lagrange cells assume


def write_vtu(mesh: Mesh, path: str | os.PathLike[str], point_data: Mapping[str, FloatArray] | None = None) -> None:
    """Write a mesh, a `region` number per cell and nodal fields atomically.

    Hexahedra of order 3 and 4 are resampled at equally spaced nodes, which VTK's Lagrange cells assume.

    Parameters
    ----------
    mesh : Mesh
        Mesh in m.
    path : str or Path
        File to write.
    point_data : mapping of ndarray, optional
        Fields by name, of shape (n,) or (n, components); complex ones become `name_re` and `name_im`.

    Raises
    ------
    ValueError
        For a field that does not have one row per node.
    """
    import meshio

    fields: dict[str, FloatArray] = {}
    for name, values in (point_data or {}).items():
        if len(values) != len(mesh.nodes):
            raise ValueError(f"field '{name}' has {len(values)} rows, the mesh has {len(mesh.nodes)} nodes")
        parts = {f"{name}_re": values.real, f"{name}_im": values.imag} if np.iscomplexobj(values) else {name: values}
        fields |= {key: _resampled(mesh, np.asarray(part, dtype=float)) for key, part in parts.items()}
    region = np.zeros(len(mesh.cells), dtype=np.int32)
    for number, cells in enumerate(mesh.region_of_cells().values()):
        region[cells] = number
    cell_type, order = _vtk_cells(mesh)
    written = meshio.Mesh(
        _resampled(mesh, mesh.nodes), [(cell_type, mesh.cells[:, order])], fields, {"region": [region]}
    )
    with written_whole(path) as temporary:
        written.write(temporary, file_format="vtu")


def _resampled(mesh: Mesh, values: FloatArray) -> FloatArray:
    """Nodal values at equally spaced nodes."""
    if mesh.kind == "tet" or mesh.order <= SPACED:
        return values
    line = np.linspace(-1.0, 1.0, mesh.order + 1)
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    shape, _ = mesh.element.shape(np.column_stack([x.ravel(), y.ravel(), z.ravel()]))
    spaced = np.empty_like(values)
    spaced[mesh.cells] = np.einsum("ak,ek...->ea...", shape, values[mesh.cells])
    return spaced


def _vtk_cells(mesh: Mesh) -> tuple[str, IntArray]:
    """meshio's cell type and the local nodes in its order.

    Order 2 is a Lagrange cell too: VTK 9.6 integrates a volume of -1/48 over the unit VTK_TRIQUADRATIC_HEXAHEDRON.
    """
    if mesh.kind == "tet":
        return {1: "tetra", 2: "tetra10"}[mesh.order], np.arange(mesh.cells.shape[1])
    return "hexahedron" if mesh.order == 1 else "VTK_LAGRANGE_HEXAHEDRON", _vtk_hexahedron_nodes(mesh.order)


def _vtk_hexahedron_nodes(order: int) -> IntArray:
    """Our local node (x fastest) at each place of VTK's hexahedron: corners, edges, faces, inside.

    The last two edges stand as in VTU files of version 0.1 and 1.0, the only ones meshio writes: VTK's reader exchanges
    them, so that memory holds its present numbering.
    """
    from vtkmodules.vtkCommonDataModel import vtkHigherOrderHexahedron

    orders, inner = (order,) * 3, order - 1
    places = [vtkHigherOrderHexahedron.PointIndexFromIJK(i, j, k, orders) for k, j, i in np.ndindex((order + 1,) * 3)]
    nodes, last = np.argsort(places), 8 + 10 * inner
    nodes[last : last + 2 * inner] = np.roll(nodes[last : last + 2 * inner], inner)
    return nodes


# -- VTKHDF ------------------------------------------------------------------------------------------------------------
# A surface that moves as one VTKHDF file (version 2): one mesh, a field for each step; ParaView 5.12 and VTK 9.3 read
# it.

CELL_TYPES = {3: 5, 4: 9}  # VTK's triangle and quadrilateral by their corners


def write_steps(
    path: str | os.PathLike[str], points: FloatArray, facets: IntArray, steps: FloatArray, name: str, fields: FloatArray
) -> None:
    """Write a moving surface atomically as VTKHDF, with one field per step.

    Parameters
    ----------
    path : str or Path
        File to write.
    points : ndarray, shape (p, 3)
        Vertices at rest, in m.
    facets : ndarray, shape (m, 3) or (m, 4)
        Vertices of each facet.
    steps : ndarray, shape (steps,)
        Values that ParaView shows as time, such as frequencies.
    name : str
        Name of the field.
    fields : ndarray, shape (steps, p, 3)
        Values of the field, stored in single precision.

    Raises
    ------
    KeyError
        For facets with another number of corners.
    """
    import h5py

    count, corners = facets.shape
    single: dict[str, object] = {
        "NumberOfPoints": [len(points)], "NumberOfCells": [count], "NumberOfConnectivityIds": [count * corners],
    }  # fmt: skip
    zeros = np.zeros(len(steps), dtype=np.int64)
    with written_whole(path) as temporary, h5py.File(temporary, "w") as file:
        root = file.create_group("VTKHDF", track_order=True)
        root.attrs["Version"] = np.array([2, 0])
        root.attrs["Type"] = np.bytes_("UnstructuredGrid")
        for key, value in single.items():
            root[key] = np.array(value, dtype=np.int64)
        root["Points"] = np.asarray(points, dtype=float)
        root["Connectivity"] = facets.astype(np.int64).ravel()
        root["Offsets"] = np.arange(count + 1, dtype=np.int64) * corners
        root["Types"] = np.full(count, CELL_TYPES[corners], dtype=np.uint8)
        flat = np.asarray(fields, dtype=np.float32).reshape(-1, 3)
        root.create_dataset(f"PointData/{name}", data=flat, compression="gzip", shuffle=True)
        moving = root.create_group("Steps")
        moving.attrs["NSteps"] = len(steps)
        moving["Values"] = np.asarray(steps, dtype=float)
        moving["NumberOfParts"] = zeros + 1
        for key in ("PartOffsets", "PointOffsets", "CellOffsets", "ConnectivityIdOffsets"):
            moving[key] = zeros
        moving[f"PointDataOffsets/{name}"] = np.arange(len(steps), dtype=np.int64) * len(points)
