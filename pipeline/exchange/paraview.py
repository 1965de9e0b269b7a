"""Every mode of a plate on the surface of the whole body, one step each: VTKHDF for ParaView, or XDMF as one file of text."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from geometry.elements import FloatArray, IntArray
from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.logs import Log


def write(case: Case, path: Path, log: Log) -> Path:
    """Compute the modes that `antinode modes` lists and write their shapes of unit modal mass; time is frequency, Hz."""
    from geometry.formats.vtk import write_steps

    points, facets, tones, shapes = shapes_of(case, log)
    with log.step(f"write {len(tones)} shapes"):
        write_steps(path, points, facets, tones, "displacement", shapes)
    return path


def write_xdmf(case: Case, path: Path, log: Log) -> Path:
    """The same as XDMF."""
    from meshio.xdmf import TimeSeriesWriter

    from geometry.files import written_whole

    points, facets, tones, shapes = shapes_of(case, log)
    with (
        log.step(f"write {len(tones)} shapes"),
        written_whole(path) as temporary,
        TimeSeriesWriter(temporary, data_format="XML") as writer,  # of HDF5 meshio leaves a part in the working folder
    ):
        writer.write_points_cells(points, [("triangle", facets)])
        for tone, shape in zip(tones.tolist(), shapes.astype(np.float32), strict=True):
            writer.write_data(tone, point_data={"displacement": shape})
    return path


def shapes_of(case: Case, log: Log) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    """Points (p, 3) in m and triangles (m, 3) of the whole plate's closed surface, frequencies (k,) in Hz and displacements
    (k, p, 3) of its modes. Raises InputError where the band holds none.
    """
    from geometry.decimation import closed_surface
    from pipeline.models.modes import solve_modes
    from pipeline.planning.model_choice import Request

    solved = solve_modes(case, Request("plate"), log)
    if not solved.rows:
        raise InputError(f"{case.name}: no mode in the band that was asked for: there is nothing to show")
    symmetries = {row.symmetry for row in solved.rows}
    skins = {each: solved.model.skin(each, solved.vectors[each]).unfolded(each) for each in symmetries}
    first = next(iter(skins.values()))
    shapes = np.stack([skins[row.symmetry].displacement[row.column] for row in solved.rows])
    kept, triangles = closed_surface(first.points, first.facets, case.design.thickness_m)
    return first.points[kept], triangles, np.array([row.frequency_hz for row in solved.rows]), shapes[:, kept]
