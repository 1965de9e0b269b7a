"""Every measure of studies, in the order in which a case is measured: their plan, and the columns of table.csv."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from pipeline.case.model import Case
from pipeline.errors import InputError
from pipeline.measures.asked import of_question
from pipeline.measures.attenuation import ATTENUATION
from pipeline.measures.board import BOARD
from pipeline.measures.geometry import GEOMETRY
from pipeline.measures.live import LIVE
from pipeline.measures.measure import Measure
from pipeline.measures.modes import MODES, TETRAHEDRA
from pipeline.measures.parts import PARTS
from pipeline.measures.response import RESPONSE
from pipeline.measures.tolerance import TOLERANCE
from pipeline.planning import simplifications
from pipeline.planning.plan import Plan, Step
from pipeline.questions import registered
from pipeline.records import store, tables
from pipeline.records.study import StoredStudy, read_study
from pipeline.records.tables import Column

WRITTEN = {"modes", "attenuation"}  # questions whose measure keeps more than their result: its module has it
ASKED = {name: of_question(kind()) for name, kind in registered().items() if name not in WRITTEN}
MEASURES: tuple[Measure, ...] = (
    *(
        MODES,
        ASKED["bands"],
        ATTENUATION,
        ASKED["broadband"],
        RESPONSE,
        TOLERANCE,
        ASKED["touch"],
        ASKED["hybrid"],
        ASKED["travel"],
        ASKED["crosstalk"],
    ),
    *(LIVE, BOARD, PARTS, GEOMETRY, TETRAHEDRA),
)


def measures() -> tuple[Measure, ...]:
    """Every measure, those of questions that other modules have defined last."""
    listed = {measure.name for measure in MEASURES}
    others = (of_question(kind()) for name, kind in registered().items() if name not in listed)
    return (*MEASURES, *others)


def names() -> list[str]:
    """What a study file may ask for."""
    return [name for measure in measures() for name in (measure.name, *measure.aliases)]


def chosen(query: Iterable[str]) -> list[Measure]:
    """The measures of these names in their order."""
    wanted = set(query)
    return [measure for measure in measures() if wanted & {measure.name, *measure.aliases}]


def check(case: Case, query: Iterable[str]) -> None:
    """InputError for a case that lacks what its measures need."""
    measures = chosen(query)
    case.require_plate(
        command="a study", several=all(measure in (ASKED["crosstalk"], GEOMETRY) for measure in measures)
    )
    for measure in measures:
        if measure.needs:
            case.require(*measure.needs, command=f"the measure {measure.name}")
        if measure.after and measure.after not in [other.name for other in measures]:
            raise InputError(
                f"the measure {measure.name} goes on from {measure.after}: measure must hold {measure.after} too"
            )


def plan_of(case: Case, query: Iterable[str]) -> Plan:
    """The steps that a case's measures ask for, in the order in which they run."""
    measures = chosen(query)
    planned = [measure.plan(case) for measure in measures]
    driven = any(measure.drives for measure in measures)
    whole = (
        *(each for each in planned if not isinstance(each, Step)),
        None if MODES in measures else simplifications.no_plate_modes(),
        simplifications.no_patches(case.patches, driven),
        None if driven else simplifications.no_response(),
        simplifications.no_figures(),
    )
    steps = tuple(each for each in planned if isinstance(each, Step))
    return Plan(case.name, steps, tuple(each for each in whole if each))


def columns_of(study: StoredStudy) -> list[Column]:
    """Columns of a study's table."""
    return tables.columns_of(study, [column for measure in measures() for column in measure.columns])


def write_table(folder: Path) -> Path:
    """Write table.csv of a study from its records, atomically. Raises store.BadRecord when nothing is stored."""
    study = read_study(folder)
    store.write_atomic(folder / tables.TABLE, tables.table_bytes(study, columns_of(study)))
    return folder / tables.TABLE
