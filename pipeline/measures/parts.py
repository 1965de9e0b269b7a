"""The bare zone and the lone pillar, as the pre-design saw them."""

from __future__ import annotations

from pipeline.measures.measure import Measure, Work
from pipeline.planning import plan
from pipeline.planning.request import Request
from pipeline.questions.modes import ModesResult
from pipeline.questions.predesign import sized


def _compute(work: Work) -> None:
    from pipeline.models.modes import solve_modes

    zone = solve_modes(work.case, Request("zone"), work.log)
    work.keep(zone.meshes, predesign=sized(work.case.design), zone_modes=ModesResult.of_solved(zone, work.case))
    if work.case.design.pillar and not work.case.design.is_graded:
        pillar = solve_modes(work.case, Request("pillar", near_hz=0.0, count=4), work.log)
        work.keep(pillar.meshes, pillar_modes=ModesResult.of_solved(pillar, work.case))


PARTS = Measure("parts", plan=plan.parts_step, compute=_compute)
