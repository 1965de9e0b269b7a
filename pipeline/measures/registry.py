"""Every measure of studies, in the order in which a case is measured: their plan, and the columns of table.csv."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.measures.asked import of_question
from pipeline.measures.measure import Measure
from pipeline.measures.response import HYBRID, TRAVEL
from pipeline.measures.touch import TOUCH
from pipeline.planning import simplifications
from pipeline.planning.plan import Plan, Step
from pipeline.questions import known
from pipeline.records import store, tables
from pipeline.records.record import Record
from pipeline.records.study import StoredStudy, read_study
from pipeline.records.tables import Column
from solvers.measures.levels import CONFINED_DB

IN_ORDER = (
    *("modes", "bands", "attenuation", "broadband", "response", "tolerance", "touch", "hybrid", "travel", "crosstalk"),
    *("live", "board", "predesign", "zone_modes", "pillar_modes", "geometry", "tet_modes"),
)
WRITTEN = {each.name: each for each in (TOUCH, HYBRID, TRAVEL)}


def _dof(record: Record) -> int | None:
    solved = record.modes or record.held("bands")
    return solved.dof if solved else None


def _confined(record: Record) -> str | None:
    return None if record.confined is None else "yes" if record.confined else "no"


OF_SEVERAL = (  # columns that several answers of a case make together
    Column("confined", f"confined (at least {CONFINED_DB:g} dB)", _confined),
    Column("dof", "degrees of freedom", _dof, ""),
)


def measures() -> tuple[Measure, ...]:
    """Every measure in the order in which a case is measured, those of questions that other modules have defined last."""
    questions = {name: kind.in_study() for name, kind in known().items() if not kind.follows}
    asked = {name: of_question(question) for name, question in questions.items() if question}
    found = asked | WRITTEN
    return (*(found.pop(name) for name in IN_ORDER), *found.values())


def names() -> list[str]:
    """What a study file may ask for."""
    return [*dict.fromkeys(name for measure in measures() for name in (measure.name, *measure.aliases))]


def chosen(query: Iterable[str]) -> list[Measure]:
    """The measures of these names in their order."""
    wanted = set(query)
    return [measure for measure in measures() if wanted & {measure.name, *measure.aliases}]


def check(case: Case, query: Iterable[str]) -> None:
    """InputError for a case that lacks what its measures need."""
    asked = chosen(query)
    case.require_plate(command="a study", several=all(measure.name in ("crosstalk", "geometry") for measure in asked))
    for measure in asked:
        if measure.needs:
            case.require(*measure.needs, command=f"the measure {measure.name}")
        if measure.after and measure.after not in [other.name for other in asked]:
            raise InputError(
                f"the measure {measure.name} goes on from {measure.after}: measure must hold {measure.after} too"
            )


def plan_of(case: Case, query: Iterable[str]) -> Plan:
    """The steps that a case's measures ask for, in the order in which they run."""
    asked = chosen(query)
    planned = [measure.plan(case) for measure in asked]
    driven = any(measure.drives for measure in asked)
    whole = (
        *(each for each in planned if not isinstance(each, Step)),
        None if any(each.name == "modes" for each in asked) else simplifications.no_plate_modes(),
        simplifications.no_patches(case.patches, driven),
        None if driven else simplifications.no_response(),
        simplifications.no_figures(),
    )
    steps = tuple(each for each in planned if isinstance(each, Step))
    return Plan(case.name, steps, tuple(each for each in whole if each))


def columns_of(study: StoredStudy) -> list[Column]:
    """Columns of a study's table."""
    return tables.columns_of(study, [*(column for measure in measures() for column in measure.columns), *OF_SEVERAL])


def write_table(folder: Path) -> Path:
    """Write table.csv of a study from its records, atomically. Raises store.BadRecord when nothing is stored."""
    study = read_study(folder)
    store.write_atomic(folder / tables.TABLE, tables.table_bytes(study, columns_of(study)))
    return folder / tables.TABLE
