"""The bare zone and the lone pillar, as the pre-design saw them."""

from __future__ import annotations

from pipeline.measures.measure import Measure, Work
from pipeline.planning import plan
from pipeline.planning.request import Request
from pipeline.records.record import PredesignRecord


def _compute(work: Work) -> None:
    from pipeline.analysis.modes import solve_modes
    from solvers.analytic.predesign import predesign

    sizes = PredesignRecord.model_validate(predesign(work.case.design).to_dict())
    zone = solve_modes(work.case, Request("zone"), work.log)
    work.keep(zone.meshes, predesign=sizes, zone_modes=zone.record)
    if work.case.design.pillar and not work.case.design.is_graded:
        pillar = solve_modes(work.case, Request("pillar", near_hz=0.0, count=4), work.log)
        work.keep(pillar.meshes, pillar_modes=pillar.record)


PARTS = Measure("parts", plan=plan.parts_step, compute=_compute)
