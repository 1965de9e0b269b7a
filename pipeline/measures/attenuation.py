"""Rows as filters: complex bands beside what the finite plate does, and how wide a band the rows hold."""

from __future__ import annotations

from pipeline.case.model import Case
from pipeline.measures.measure import Measure, Work
from pipeline.planning import plan, simplifications
from pipeline.planning.plan import Step
from pipeline.planning.simplifications import Simplification, hexahedra
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
        level = wanted.extension_db, wanted.extension_error_db
        prediction = attenuation.prediction(result, wanted.frequency_hz, *level)
        work.keep(prediction=prediction)


_rows = figures_of(lambda r: r.prediction)
_error = _rows(lambda p: p.db_error)
COLUMNS = (
    Column("db_per_row", "decay per row", _rows(lambda p: p.db_per_row), "dB", _error),
    Column("db_error", "expected error of the decay", _error, "dB", _error),
    Column("rows_db", "predicted by the rows", _rows(lambda p: p.rows_db), "dB", _rows(lambda p: p.rows_error_db)),
    Column("rows_needed", "rows needed, endless ones", _rows(lambda p: p.rows_needed), ""),
)


def _broadband_plan(case: Case) -> Step | Simplification:
    if not case.design.rows or case.design.stagger or not hexahedra(case, "plate"):
        return Simplification("no_rows", "broadband", "it takes rows in line of pillars that hexahedra follow")
    return plan.plain_step("broadband", "rows over frequency", "column of reduced cells at the wanted wavenumber")


def _broadband(work: Work) -> None:
    from pipeline.models.broadband import broadband

    work.keep(broadband=broadband(work.case, work.log))


_wide = figures_of(lambda r: r.broadband)
BROAD_COLUMNS = (
    Column(
        "stopped_width_hz",
        "stopped about the wanted mode",
        _wide(lambda b: b.stopped_width_hz),
        "Hz",
        _wide(lambda b: b.stopped_width_error_hz),
        is_difference=True,
    ),
    Column(
        "column_wanted_hz",
        "wanted mode of the column",
        _wide(lambda b: b.wanted_hz),
        "Hz",
        _wide(lambda b: b.wanted_error),
    ),
    Column(
        "column_wanted_db",
        "confinement in the column",
        _wide(lambda b: b.wanted_db),
        "dB",
        _wide(lambda b: b.wanted_error_db),
    ),
)
BROADBAND = Measure(
    "broadband",
    plan=_broadband_plan,
    compute=_broadband,
    columns=BROAD_COLUMNS,
    pictures=("plots.attenuation.broadband",),
)

ATTENUATION = Measure(
    "attenuation", plan=_plan, compute=_compute, columns=COLUMNS, pictures=("plots.attenuation.attenuation",)
)
