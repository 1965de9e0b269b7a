"""The same plate and cell through CAD and pytetwild, a cross-check of the structured meshes."""

from __future__ import annotations

from pipeline.measures.measure import Measure, Work
from pipeline.planning import plan


def _compute(work: Work) -> None:
    from pipeline.analysis import cross_check

    for meshes, arrays, result in cross_check.solve(work.case, work.log, work.solved.get("modes")):
        work.keep(meshes, arrays, **result)


TETRAHEDRA = Measure(
    "tetrahedra", plan=plan.tetrahedra_step, compute=_compute, pictures=("fields.mode_on_both_meshes",)
)
