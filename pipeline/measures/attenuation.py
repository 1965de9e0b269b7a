"""Complex bands across the rows, and beside them what the finite plate does: rows times the decay per row."""

from __future__ import annotations

from pipeline.case.model import Case
from pipeline.measures.measure import Measure, Work
from pipeline.planning import plan, simplifications
from pipeline.planning.plan import Step
from pipeline.planning.simplifications import Simplification
from pipeline.records.tables import Column, figures_of


def _plan(case: Case) -> Step | Simplification:
    lacking = simplifications.no_lattice(case.design, "attenuation")
    return lacking or plan.attenuation_step(case, None, None, plan.ATTENUATION_POINTS)


def _compute(work: Work) -> None:
    from pipeline.analysis import attenuation

    lattice = work.solved.get("lattice")
    result = attenuation.solve(work.case, work.log, points=plan.ATTENUATION_POINTS, model=lattice)
    work.keep(result.meshes, attenuation=result)
    if wanted := work.wanted:
        prediction = attenuation.prediction(result, wanted.frequency_hz, wanted.extension_db)
        work.keep(prediction=prediction)


_rows = figures_of(lambda r: r.prediction)
COLUMNS = (
    Column("db_per_row", "decay per row", _rows(lambda p: p.db_per_row), ".2f", "dB"),
    Column("rows_db", "predicted by the rows", _rows(lambda p: p.rows_db), ".2f", "dB"),
    Column("rows_needed", "rows needed, endless ones", _rows(lambda p: p.rows_needed), "d"),
)

ATTENUATION = Measure(
    "attenuation", plan=_plan, compute=_compute, columns=COLUMNS, pictures=("attenuation.attenuation",)
)
