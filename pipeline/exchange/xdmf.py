"""Every mode of a plate on the surface of the whole body as XDMF, one time step each, in one file of text."""

from __future__ import annotations

from pathlib import Path

from pipeline.case.model import Case
from pipeline.exchange.paraview import shapes_of
from pipeline.logs import Log

CELLS = {3: "triangle", 4: "quad"}


def write(case: Case, path: Path, log: Log) -> Path:
    """Compute the modes that `antinode modes` lists and write their shapes of unit modal mass; time is frequency, Hz."""
    import numpy as np
    from meshio.xdmf import TimeSeriesWriter

    from geometry.files import written_whole

    points, facets, tones, shapes = shapes_of(case, log)
    with (
        log.step(f"write {len(tones)} shapes"),
        written_whole(path) as temporary,
        TimeSeriesWriter(temporary, data_format="XML") as writer,  # of HDF5 meshio leaves a part in the working folder
    ):
        writer.write_points_cells(points, [(CELLS[facets.shape[1]], facets)])
        for tone, shape in zip(tones.tolist(), shapes.astype(np.float32), strict=True):
            writer.write_data(tone, point_data={"displacement": shape})
    return path
