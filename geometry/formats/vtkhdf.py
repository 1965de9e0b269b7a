"""A surface that moves as one VTKHDF file (version 2): one mesh, a field for each step; ParaView 5.12 and VTK 9.3 read it."""

from __future__ import annotations

import os

import numpy as np

from geometry.elements import FloatArray, IntArray
from geometry.files import written_whole

CELL_TYPES = {3: 5, 4: 9}  # VTK's triangle and quadrilateral by their corners


def write_steps(
    path: str | os.PathLike[str], points: FloatArray, facets: IntArray, steps: FloatArray, name: str, fields: FloatArray
) -> None:
    """Write points (p, 3), facets (m, 3 or 4) and the field `name` (steps, p, 3) at the values `steps` (steps,), atomically.

    Raises KeyError for facets of other corners.
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
