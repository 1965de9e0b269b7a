"""What a measure of studies is, and what it works on. Add one: a module here, and its line in `registry.MEASURES`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.case.model import Case
from pipeline.models.mode_parts import WantedMode
from pipeline.questions.question import Run
from pipeline.records.part import Part
from pipeline.records.record import MeshRecord
from pipeline.records.tables import Column

if TYPE_CHECKING:
    from pipeline.planning.plan import Step
    from pipeline.planning.simplifications import Simplification
    from pipeline.plots.style import ReportFigure
    from pipeline.questions.modes import ModesResult
    from pipeline.records.run_log import RunLog
    from pipeline.records.study import StoredCase

Draw = Callable[["StoredCase", dict[str, Any]], "ReportFigure | list[ReportFigure] | None"]


@dataclass
class Work:
    """A case while it is measured: what was found by name (fields of its record, or plain values), arrays and meshes.

    `solved` holds what one measure has solved and another of the same case can go on from, `run` what questions share.
    """

    case: Case
    folder: Path
    log: RunLog
    all_fields: bool = False
    record: dict[str, Any] = field(default_factory=dict)
    arrays: dict[str, Any] = field(default_factory=dict)
    meshes: list[MeshRecord] = field(default_factory=list)

    @cached_property
    def run(self) -> Run:
        """What the questions of this case share."""
        return Run(self.log, detailed=False, shapes=True, folder=self.folder)

    @property
    def solved(self) -> dict[str, Any]:
        """What one measure has solved, by name."""
        return self.run.solved

    @property
    def wanted(self) -> WantedMode | None:
        """The wanted mode, where the modes were measured before and there is one."""
        modes: ModesResult | None = self.record.get("modes")
        return modes.wanted if modes and isinstance(modes.wanted, WantedMode) else None

    def keep(self, meshes: Iterable[MeshRecord] = (), arrays: Mapping[str, Any] | None = None, **result: Any) -> None:
        """Add to the record and to the arrays of the case; of answers what is stored, without solved models."""
        self.meshes += meshes
        self.arrays |= arrays or {}
        self.record |= {name: part.stored() if isinstance(part, Part) else part for name, part in result.items()}


@dataclass(frozen=True)
class Measure:
    """A measure by its name in study files: what it will do for a case (or why nothing), doing it, showing what it found.

    needs: tables of the case; after: another measure whose results it uses; aliases: other names of the same; drives: whether
    it drives the plate; inputs: what its results depend on beside case, sources and packages. Columns and pictures read the
    record alone. Pictures are functions of pipeline by their names, module.function: nothing is imported before something is
    drawn. drawn: further functions that draw.
    """

    name: str
    plan: Callable[[Case], Step | Simplification]
    compute: Callable[[Work], None]
    needs: tuple[str, ...] = ()
    after: str = ""
    aliases: tuple[str, ...] = ()
    drives: bool = False
    inputs: Callable[[], dict[str, Any]] = dict
    columns: tuple[Column, ...] = ()
    pictures: tuple[str, ...] = ()
    drawn: tuple[Draw, ...] = ()

    def draws(self) -> list[Draw]:
        """The functions that draw its pictures."""
        places = (name.rpartition(".") for name in self.pictures)
        named = [getattr(import_module(f"pipeline.{module}"), function) for module, _, function in places]
        return [*named, *self.drawn]
