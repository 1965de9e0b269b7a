"""What a case leaves in record.json: one class for each part, written by what computes it and read by attribute.

The fields stand here alone. Frequencies in Hz, lengths in m, levels in dB; a field is None where it has no meaning. A JSON
document of a command holds the same parts. `SCHEMA` of `pipeline.records.store` counts the versions of this page: a record of
another version is refused as a whole, and its case is computed again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from functools import cached_property
from importlib import import_module
from math import isclose, isfinite
from pathlib import Path
from typing import Any, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from geometry.lattice import Lattice
from geometry.layout import Design, Pillar
from geometry.pillar_shapes.base import PillarShape
from geometry.pillar_shapes.shapes import stored_shape
from pipeline.records import part, store
from solvers.measures.confinement import CONFINED_DB

R = TypeVar("R", bound=part.Part)
STATUSES = ("OK", "WARNING")  # of cases that gave an answer


class Checked(BaseModel):
    """Frozen, no unknown field, no NaN; a number that is none becomes None where that is allowed."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _none_for_nan(cls, given: Any) -> Any:
        if not isinstance(given, Mapping):
            return given
        return {
            key: None if isinstance(value, float) and not isfinite(value) else value for key, value in given.items()
        }

    def to_dict(self) -> dict[str, Any]:
        """The fields that were given, as plain values in their order."""
        return self.model_dump(exclude_unset=True)


class Part(Checked):
    """A part of a record."""

    @classmethod
    def of(cls, result: Any, **more: Any) -> Self:
        """The part with the fields that an object of the same names holds, and more."""
        return cls(
            **{key: getattr(result, key) for key in cls.model_fields.keys() - more.keys() if hasattr(result, key)},
            **more,
        )


class Open(Part):
    """A part that also keeps fields which only its writer names, and nobody reads by name."""

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False)


class TipRecord(Part):
    """A heavy tip on a pillar."""

    side_m: float
    height_m: float


class PillarRecord(Open):
    """A pillar's shape and size; sizes that only its shape has stand beside these by their names."""

    shape: str
    base_m: float
    tip_m: float
    height_m: float
    fillet_m: float
    heavy_tip: TipRecord | None = None
    faces: int = 1

    @classmethod
    def of_pillar(cls, pillar: Pillar) -> PillarRecord:
        """What a record keeps of a pillar."""
        tip = {"heavy_tip": TipRecord.of(pillar.tip)} if pillar.tip else {}
        return cls.of(pillar, **dict(pillar.more_m), **tip)

    @property
    def form(self) -> PillarShape:
        """The shape with these sizes."""
        return stored_shape(self.model_dump())

    @property
    def top_m(self) -> float:
        """Height from foot to top, the heavy tip included, m."""
        return self.height_m + (self.heavy_tip.height_m if self.heavy_tip else 0.0)


class DesignRecord(Part):
    """The design, as tables and pictures need it; pillar_centres_m: (x, y) from the plate's centre, row by row along y.

    zone_centres_m: y of every zone where there are several.
    graded_pillars and graded_widths_m (of the rows' strips) hold one entry a row from the zone outwards where rows differ:
    pillar is then the first row's.
    """

    length_m: float
    width_m: float
    thickness_m: float
    half_span_m: float
    rows: int
    pitch_x_m: float | None
    pitch_y_m: float | None
    extension_m: float | None
    nodal_lines: int
    pillar: PillarRecord | None
    pillar_centres_m: list[tuple[float, float]]
    graded_pillars: list[PillarRecord] = []
    graded_widths_m: list[float] = []
    staggered: bool = False
    zone_centres_m: list[float] = []

    @classmethod
    def of_design(cls, design: Design) -> DesignRecord:
        """What a record keeps of a design."""
        shape = PillarRecord.of_pillar(design.pillar) if design.pillar else None
        own: dict[str, Any] = {"staggered": True} if design.is_staggered else {}
        if design.is_graded:
            shapes = [PillarRecord.of_pillar(pillar) for pillar in design.row_pillars]
            own |= {"graded_pillars": shapes, "graded_widths_m": design.row_pitches_m.tolist()}
        own["zone_centres_m"] = design.zone_centres_m.tolist() if design.zones > 1 else []
        return cls.of(design, pillar=shape, pillar_centres_m=design.pillar_centres().tolist(), **own)

    @cached_property
    def key(self) -> str:
        """The same text for the same design: equality at the price of a dictionary's look-up."""
        return self.model_dump_json()

    @property
    def lattice(self) -> Lattice:
        """The lattice that the rows are part of."""
        assert self.pitch_x_m and self.pitch_y_m
        return Lattice.of_rows(self.pitch_x_m, self.pitch_y_m, self.staggered)

    @property
    def cell(self) -> tuple[Any, ...]:
        """What decides the unit cells of the rows."""
        rows = tuple(self.graded_pillars), tuple(self.graded_widths_m)
        return self.pitch_x_m, self.pitch_y_m, self.thickness_m, self.pillar, rows, self.staggered

    @property
    def pillars(self) -> list[PillarRecord]:
        """The pillars of the rows that differ, from the zone outwards; the one of all rows where they are alike."""
        return self.graded_pillars or ([self.pillar] if self.pillar else [])

    @property
    def standing(self) -> list[PillarRecord]:
        """The pillar at each of pillar_centres_m."""
        if not self.pillar or not self.rows:
            return []
        if not self.graded_pillars:
            return [self.pillar] * len(self.pillar_centres_m)
        rows = self.graded_pillars
        counts = Counter(y for _, y in self.pillar_centres_m).values()  # row by row along y
        return [each for pillar, count in zip((*rows[::-1], *rows), counts, strict=True) for each in [pillar] * count]


class MeshRecord(Part):
    """A mesh: of what, hex or tet, its order, how large, how good."""

    what: str
    kind: str
    order: int
    cells: int
    nodes: int
    dof: int
    sha256: str
    worst_jacobian_ratio: float | None = None
    volume_error: float | None = None


class PlanStep(Open):
    """A computation: what it looks for, by which model and mesh, and why so; its numbers beside."""

    measure: str
    name: str
    model: str
    mesh: str
    looks_for: str
    why: list[str]


class PlanRecord(Open):
    """What was computed, step by step."""

    steps: list[PlanStep]


class Record(Checked):
    """A case: how it ended, what it stems from, and what its measures found (None: not measured).

    `other` holds plain values by name: of measures without a class here, and of studies that are scripts.
    """

    schema_version: Literal[4] = Field(default=4, alias="schema")
    case_id: str
    name: str = ""
    status: Literal["OK", "WARNING", "FAILED", "MISSING"]
    diagnosis: str = ""
    input_hash: str = ""
    code_hash: str = ""
    versions: dict[str, str] = {}
    sweep: dict[str, Any] = {}
    left_out: list[str] = []
    warnings: list[str] = []
    plan: PlanRecord | None = None
    design: DesignRecord | None = None
    meshes: list[MeshRecord] = []
    answers: dict[str, Any] = {}
    other: dict[str, Any] = {}

    @model_validator(mode="before")
    @classmethod
    def _with_answers(cls, given: Any) -> Any:
        """Answers to questions stand beside the other parts, each by its question's name."""
        if not isinstance(given, Mapping):
            return given
        if "measured" in given:  # of a record in which it stood beside the response
            whole = {**given["response"], "measured": given["measured"]}
            given = {key: value for key, value in given.items() if key != "measured"} | {"response": whole}
        known = {key: value for key, value in given.items() if key not in cls.model_fields and key != "schema"}
        answers = {key: answer_of(key, value) for key, value in known.items() if kind_of(key)}
        rest = {key: value for key, value in given.items() if key not in answers}
        return rest | ({"answers": {**given.get("answers", {}), **answers}} if answers else {})

    @classmethod
    def of_case(cls, result: Mapping[str, Any], **head: Any) -> Record:
        """The record of what measures found by name; what has no field of its own goes to `other`."""
        own = {key: value for key, value in result.items() if key in cls.model_fields or isinstance(value, part.Part)}
        other = {key: value for key, value in result.items() if key not in own}
        return cls.model_validate({**own, **({"other": {**own.get("other", {}), **other}} if other else {}), **head})

    def to_dict(self) -> dict[str, Any]:
        """What record.json holds: nothing where nothing was measured."""
        head = {"schema": self.schema_version}
        fields = self.model_dump(exclude_unset=True, exclude={"schema_version", "answers"})
        answers = {name: answer.values() for name, answer in self.answers.items()}
        return head | {key: value for key, value in fields.items() if value is not None} | answers

    def with_parts(self, **parts: Any) -> Record:
        """The record with other parts and answers, by name; without those that are None."""
        own = {name: value for name, value in parts.items() if name in type(self).model_fields}
        answers = {**self.answers, **{name: value for name, value in parts.items() if name not in own}}
        kept = {name: answer for name, answer in answers.items() if answer is not None}
        return self.model_copy(update={"answers": kept, **own})

    def held(self, name: str) -> Any:
        """A part or an answer by its name; None where there is none."""
        return self.answers.get(name, getattr(self, name, None))

    def of(self, kind: type[R]) -> R | None:
        """The answer to the question of a kind of result; None where it was not asked."""
        answer: R | None = self.answers.get(kind.question)
        return answer

    @property
    def answered(self) -> bool:
        """Whether the case gave an answer."""
        return self.status in STATUSES

    @property
    def modes(self) -> Any:
        """The answer about the plate's modes; None where it was not asked."""
        return self.answers.get("modes")

    @property
    def response(self) -> Any:
        """The answer about the forced response; None where it was not asked."""
        return self.answers.get("response")

    @property
    def target(self) -> Any:
        """The target mode; None where there is none or none was looked for."""
        found = self.modes.target if self.modes else None
        return found if found and found.is_found else None

    @property
    def target_status(self) -> str | None:
        """single, split or none; None where no mode was looked for."""
        return self.modes.target.status if self.modes and self.modes.target else None

    @property
    def confinement_db(self) -> float | None:
        """Confinement of the target mode, dB; None without a target mode or a passive face."""
        return self.target.confinement_db if self.target else None

    @property
    def driven_db(self) -> float | None:
        """Confinement at the target mode's peak as the patches drive it, dB; None without a response or without that peak."""
        return self.response.target_peak.confinement_db if self.response and self.response.target_peak else None

    def error_at(self, frequency_hz: float) -> float | None:
        """Half-width of the bar of the plate's mode at a stored frequency, relative; None where it is not known."""
        known = [(mode.frequency_hz, mode.error) for mode in self.modes.modes] if self.modes else []
        if self.target:
            known.append((self.target.frequency_hz, self.target.frequency_error))
        return next((error for tone, error in known if isclose(tone, frequency_hz, rel_tol=1e-9)), None)

    @property
    def ranked_db(self) -> float | None:
        """Confinement that ranks designs, dB: as the patches drive it, or of the mode where nothing drives it."""
        return self.driven_db if self.response else self.confinement_db

    @property
    def confined(self) -> bool | None:
        """Whether the zone confines the target mode: as a mode and, where patches drive it, at its own peak.

        None where the question has no meaning.
        """
        level, driven = self.confinement_db, self.driven_db
        return None if level is None else min(level, level if driven is None else driven) >= CONFINED_DB

    @property
    def verdict(self) -> str:
        """Whether the target mode is confined, as a mode and as driven by patches, in words."""
        as_mode = self.confinement_db is not None and self.confinement_db >= CONFINED_DB
        return "confined" if self.confined else "confined as a mode, not as driven" if as_mode else "leaking"

    def mesh(self, what: str, kind: str) -> MeshRecord | None:
        """The first mesh of a body and a kind."""
        return next((mesh for mesh in self.meshes if (mesh.what, mesh.kind) == (what, kind)), None)


class PartFault(Exception):
    """An answer that does not fit its declaration, by its place."""


def first_fault(error: ValidationError) -> str:
    """The place of the first fault, and what it is."""
    first = error.errors()[0]
    return f"{'.'.join(str(part) for part in first['loc'])}: {first['msg']}"


def kind_of(name: str) -> type[part.Part] | None:
    """The kind of result that a part of a record holds; None where it is no answer to a question.

    Questions know records, not the other way round: they are found when a record is read.
    """
    question = import_module("pipeline.questions").known().get(name)
    kind: type[part.Part] | None = question.result if question else None
    return kind


def answer_of(name: str, given: Any) -> part.Part:
    """An answer as it was computed, or read from what `to_dict` wrote of it."""
    kind = kind_of(name)
    assert kind
    if isinstance(given, part.Part):
        return given
    try:
        return kind.from_dict({key: value for key, value in given.items() if key != "schema"})
    except ValidationError as error:
        raise PartFault(f"{name}.{first_fault(error)}") from error


def read(folder: Path) -> Record:
    """Record of a case. Raises store.BadRecord when it is missing, torn, edited, another case's or of another version."""
    try:
        return Record.model_validate(store.read_record(folder))
    except (ValidationError, PartFault) as error:
        fault = first_fault(error) if isinstance(error, ValidationError) else str(error)
        raise store.BadRecord(f"{store.RECORD} is no record of schema {store.SCHEMA}: {fault}") from error
