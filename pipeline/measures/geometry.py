"""Print and CAD files of the plate, and what was found in the print file."""

from __future__ import annotations

from pipeline.measures.measure import Measure, Work
from pipeline.planning import plan
from pipeline.records.tables import Column


def _compute(work: Work) -> None:
    from pipeline.exchange.exports import print_files

    work.keep(geometry=print_files(work.case, work.folder, work.log))


GEOMETRY = Measure(
    "geometry",
    plan=lambda case: plan.plain_step("geometry", "print and CAD files", "CAD solids, STL read back"),
    compute=_compute,
    columns=(Column("mass_kg", "mass", lambda r: r.geometry and r.geometry.mass_kg, "kg"),),
)
