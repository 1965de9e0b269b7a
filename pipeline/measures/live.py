"""What the explorer answers of a design, in tenths of a second once the bases of its materials are made."""

from __future__ import annotations

from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.measures.measure import Measure, Work
from pipeline.planning import plan
from pipeline.planning.plan import Step
from pipeline.planning.simplifications import Simplification
from pipeline.records.record import LiveRecord
from pipeline.records.tables import Column, figures_of


def _plan(case: Case) -> Step | Simplification:
    lacking = _lacking(case)
    if lacking:
        return Simplification("no_live", "live", lacking)
    return plan.plain_step("live", "the explorer's answer", "parametric cell, and a column of such cells")


def _lacking(case: Case) -> str:
    """Why the bases do not hold the design; empty where they do."""
    from pipeline.models import parametric
    from solvers.parametric.affine import DesignBox

    try:
        case.require("pillar", "zone", command="the measure live")
        foot = parametric.require_foot(case)
    except InputError as fault:
        return "; ".join(fault.lines)
    return "; ".join(DesignBox(foot=foot).faults(parametric.sizes_of(case.design)))


def _compute(work: Work) -> None:
    from pipeline.explore.answer import Explorer, Scene
    from pipeline.models.parametric import cell_model

    explorer = Explorer(Scene(work.case, {}, ()), cell_model(work.case, work.log))
    with work.log.step("answer from the bases"):
        live = LiveRecord.of_answer(explorer.document(work.case, {}))
    for text in (*live.warnings, *([live.why_not] if live.why_not else [])):
        work.log.warning("LIVE", text)
    work.keep(live=live)


_live = figures_of(lambda r: r.live)
_error, _level_error = _live(lambda one: one.frequency_error), _live(lambda one: one.confinement_error_db)
COLUMNS = (
    Column("live_wanted_hz", "wanted mode, live", _live(lambda one: one.frequency_hz), "Hz", _error),
    Column("live_error", "its expected error, live", _error, "%"),
    Column("live_confinement_db", "confinement, live", _live(lambda one: one.confinement_db), "dB", _level_error),
    Column("live_confinement_error_db", "its expected error, live", _level_error, "dB", _level_error),
    Column(
        "live_db_per_row",
        "decay per row, live",
        _live(lambda one: one.db_per_row),
        "dB",
        _live(lambda one: one.db_error),
    ),
)

LIVE = Measure("live", plan=_plan, compute=_compute, columns=COLUMNS)
