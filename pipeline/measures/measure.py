"""What a measure of studies is, and what it works on. Add one: a module here, and its line in `registry.MEASURES`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

from pipeline.case.model import Case
from pipeline.models.mode_parts import WantedMode
from pipeline.questions.question import Run
from pipeline.records.record import MeshRecord
from pipeline.records.tables import Column

if TYPE_CHECKING:
    from pipeline.planning.plan import Step
    from pipeline.planning.simplifications import Simplification
    from pipeline.plots.style import ReportFigure
    from pipeline.records.study import StoredCase

Draw = Callable[["StoredCase", dict[str, Any]], "ReportFigure | list[ReportFigure] | None"]


class Work:
    """A case while it is measured by what is no question yet, and the run that it shares with those that are."""

    def __init__(self, case: Case, run: Run) -> None:
        self.case, self.run, self.log, self.folder = case, run, run.log, run.folder
        self.solved, self.record, self.meshes, self.arrays = run.solved, run.found, run.meshes, run.arrays

    @property
    def wanted(self) -> WantedMode | None:
        """The wanted mode, where the modes were measured before and there is one."""
        return self.run.wanted

    def keep(self, meshes: Iterable[MeshRecord] = (), arrays: Mapping[str, Any] | None = None, **result: Any) -> None:
        """Add to the record and to the arrays of the case."""
        self.run.meshes += meshes
        self.run.arrays.update(arrays or {})
        self.run.found.update(result)


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
