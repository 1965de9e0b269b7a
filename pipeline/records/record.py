"""Content of record.json: one class for each part, written by its computation and read by attribute.

Frequencies are in Hz, lengths in m, levels in dB; a field is None where it is undefined. The JSON document of a command
contains the same parts. `SCHEMA` of `pipeline.records.store` counts the versions of these classes: a record of another
version is rejected as a whole, and its case is computed again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from importlib import import_module
from itertools import pairwise
from math import isclose, isfinite
from pathlib import Path
from typing import Any, Literal, Self, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from geometry.elements import FloatArray
from geometry.lattice import Lattice
from geometry.layout import Design, Pillar
from geometry.pillar_shapes import PillarShape, stored_shape
from pipeline.quantity import MM
from pipeline.records import part, store
from solvers.measures.confinement import CONFINED_DB

R = TypeVar("R", bound=part.Part)
DRAWN = 7  # decimals of rims in m
STATUSES = ("OK", "WARNING")  # statuses of cases with a result


class Checked(BaseModel):
    """Frozen, without unknown fields or NaN; NaN becomes None where that is allowed."""

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
        """Return the given fields as plain values, in order."""
        return self.model_dump(exclude_unset=True)


class Part(Checked):
    """A part of a record."""

    @classmethod
    def of(cls, result: Any, **more: Any) -> Self:
        """Build the part from an object's fields of the same names, and more."""
        return cls(
            **{key: getattr(result, key) for key in cls.model_fields.keys() - more.keys() if hasattr(result, key)},
            **more,
        )


class Open(Part):
    """A part with additional fields, which only its writer names."""

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False)


def _row_by_row(texts: list[str]) -> str:
    """One text if it is that of all rows, or that of each from the zone outwards."""
    return texts[0] if len(set(texts)) == 1 else ", ".join(texts)


class SectionRecord(Open):
    """A section of a pillar above its first one; sizes specific to its shape are additional fields."""

    shape: str
    base_m: float
    tip_m: float
    height_m: float

    @property
    def form(self) -> PillarShape:
        """Shape with these sizes."""
        return stored_shape(self.model_dump())


class PillarRecord(Open):
    """Shape and size of a pillar; sizes specific to its shape are additional fields."""

    shape: str
    base_m: float
    tip_m: float
    height_m: float
    fillet_m: float
    upper: tuple[SectionRecord, ...] = ()
    faces: int = 1

    @classmethod
    def of_pillar(cls, pillar: Pillar) -> PillarRecord:
        """Return the stored description of a pillar."""
        upper = tuple(SectionRecord.of(section, **dict(section.more_m)) for section in pillar.upper)
        return cls.of(pillar, **dict(pillar.more_m), **({"upper": upper} if upper else {}))

    @property
    def form(self) -> PillarShape:
        """Shape with these sizes."""
        return stored_shape(self.model_dump())

    @property
    def top_m(self) -> float:
        """Height from foot to top, m."""
        return self.height_m + sum(section.height_m for section in self.upper)


class SupportRecord(Part):
    """What holds a plate along an edge, x-, x+, y- or y+, or on a disc of its back face."""

    kind: str
    edge: str = ""
    at_m: tuple[float, float] = (0.0, 0.0)
    radius_m: float = 0.0

    @property
    def is_elastic(self) -> bool:
        """Whether what it holds yields."""
        return self.kind in ("foam", "spring")

    @property
    def text(self) -> str:
        """Kind and place."""
        x, y = (place / MM for place in self.at_m)
        where = (
            f"edge {self.edge}" if self.edge else f"a disc {2.0 * self.radius_m / MM:g} mm wide at ({x:g}, {y:g}) mm"
        )
        return f"{self.kind} on {where}"


class DesignRecord(Part):
    """Design data for tables and pictures; pillar_centres_m: (x, y) from the plate's centre, row by row along y.

    rims_m: sides x0, y0, x1, y1 of the polygons round the touch face of a plate of a file, whose origin places then count from.
    zone_centres_m: y of every zone if there are several. larger_m: length and width of a plate larger than zone and rows, with
    the zone's centre, others_m: those of further zones on it. If rows differ, graded_pillars and graded_widths_m (of the
    rows' strips) have one entry per row from the zone outwards, and pillar is that of the first row.
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
    larger_m: tuple[float, float] | None = None
    centre_m: tuple[float, float] = (0.0, 0.0)
    surround: bool = False
    others_m: list[tuple[float, float]] = []
    rims_m: list[tuple[float, float, float, float]] = []
    oblique_m: tuple[tuple[float, float], tuple[float, float]] | None = None
    supports: list[SupportRecord] = []

    @property
    def ends_m(self) -> tuple[float, float, float, float]:
        """Rectangle x0, x1, y0, y1 about the plate, m."""
        if not self.rims_m:
            return -self.half_length_m, self.half_length_m, -self.half_span_m, self.half_span_m
        x = [place for side in self.rims_m for place in side[::2]]
        y = [place for side in self.rims_m for place in side[1::2]]
        return min(x), max(x), min(y), max(y)

    def edge_m(self, edge: str) -> tuple[tuple[float, float], tuple[float, float]]:
        """x and y of both ends of the edge x-, x+, y- or y+, m."""
        x0, x1, y0, y1 = self.ends_m
        return {
            "x-": ((x0, x0), (y0, y1)),
            "x+": ((x1, x1), (y0, y1)),
            "y-": ((x0, x1), (y0, y0)),
            "y+": ((x0, x1), (y1, y1)),
        }[edge]

    @property
    def zone_places_m(self) -> FloatArray:
        """Centre (x, y) of every zone, (zones, 2), m."""
        beside = [(0.0, y) for y in self.zone_centres_m]
        return np.array(beside or [self.centre_m, *self.others_m])

    @property
    def half_length_m(self) -> float:
        """Half of the plate's length, m."""
        return (self.larger_m[0] if self.larger_m else self.length_m) / 2.0

    @classmethod
    def of_design(cls, design: Design) -> DesignRecord:
        """Return the stored description of a design."""
        shape = PillarRecord.of_pillar(design.pillar) if design.pillar else None
        own: dict[str, Any] = {"staggered": True} if design.is_staggered else {}
        if design.is_graded:
            shapes = [PillarRecord.of_pillar(pillar) for pillar in design.row_pillars]
            own |= {"graded_pillars": shapes, "graded_widths_m": design.row_pitches_m.tolist()}
        if design.outline:
            own["rims_m"] = design.outline.touch.segments.reshape(-1, 4).round(DRAWN).tolist()
        own["others_m"] = [*design.others_m]
        own["supports"] = [SupportRecord.of(support) for support in design.supports]
        own["zone_centres_m"] = design.zone_centres_m.tolist() if design.zones > 1 else []
        return cls.of(design, pillar=shape, pillar_centres_m=design.pillar_centres().tolist(), **own)

    @property
    def lattice(self) -> Lattice:
        """Lattice of the rows."""
        assert self.pitch_x_m and self.pitch_y_m
        if self.oblique_m:
            return Lattice(*self.oblique_m)
        return Lattice.of_rows(self.pitch_x_m, self.pitch_y_m, self.staggered)

    @property
    def pillars(self) -> list[PillarRecord]:
        """Pillars of rows that differ, from the zone outwards; a single one if all rows are alike."""
        return self.graded_pillars or ([self.pillar] if self.pillar else [])

    @property
    def pillar_text(self) -> str:
        """Shape, sizes and height of the pillars, row by row from the zone outwards where they differ; '' without pillars."""
        if not self.pillar:
            return ""
        sizes = _row_by_row([each.form.sizes_text for each in self.pillars])
        heights = _row_by_row([f"{each.height_m / MM:g}" for each in self.pillars])
        return f"{self.pillar.shape} pillars {sizes}, {heights} mm high"

    @property
    def section_texts(self) -> list[str]:
        """What each pillar has above its first section, from below upwards."""
        return [
            f"each with a {section.shape} section {section.form.sizes_text}, {section.height_m / MM:g} mm high"
            for section in (self.pillar.upper if self.pillar else ())
        ]

    @property
    def row_gaps_m(self) -> list[float]:
        """Distances between rows on one side of the zone, from the zone outwards, m."""
        widths = self.graded_widths_m or [self.pitch_y_m] * self.rows if self.pitch_y_m else []
        return [(one + other) / 2.0 for one, other in pairwise(widths)]

    @property
    def standing(self) -> list[PillarRecord]:
        """Pillar at each of pillar_centres_m."""
        if not self.pillar or not self.rows:
            return []
        if not self.graded_pillars:
            return [self.pillar] * len(self.pillar_centres_m)
        rows = self.graded_pillars
        counts = Counter(y for _, y in self.pillar_centres_m).values()  # row by row along y
        return [each for pillar, count in zip((*rows[::-1], *rows), counts, strict=True) for each in [pillar] * count]


class KeysRecord(Part):
    """Hashes of plate, modes of the plate and bands of its cell: equal for cases of a study that share it."""

    plate: str
    plate_modes: str
    cell_bands: str


class MeshRecord(Part):
    """Mesh: part, hex or tet, order, size, quality."""

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
    """A computation: its result, model, mesh and reason, with its numbers as additional fields."""

    measure: str
    name: str
    model: str
    mesh: str
    looks_for: str
    why: list[str]


class PlanRecord(Open):
    """Steps of the computation."""

    steps: list[PlanStep]


class Record(Checked):
    """A case: status, origin, and results of its measures (None: not measured).

    `other` has plain values by name: of measures without a class here, and of scripted studies.
    """

    schema_version: Literal[5] = Field(default=5, alias="schema")
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
    keys: KeysRecord | None = None
    meshes: list[MeshRecord] = []
    answers: dict[str, Any] = {}
    other: dict[str, Any] = {}

    @model_validator(mode="before")
    @classmethod
    def _with_answers(cls, given: Any) -> Any:
        """Store answers to questions next to the other parts, by question name."""
        if not isinstance(given, Mapping):
            return given
        if "measured" in given:  # of a record that stored it next to the response
            whole = {**_table("response", given.get("response")), "measured": given["measured"]}
            given = {key: value for key, value in given.items() if key != "measured"} | {"response": whole}
        known = {key: value for key, value in given.items() if key not in cls.model_fields and key != "schema"}
        answers = {key: answer_of(key, value) for key, value in known.items() if kind_of(key)}
        rest = {key: value for key, value in given.items() if key not in answers}
        return rest | ({"answers": {**_table("answers", given.get("answers", {})), **answers}} if answers else {})

    @classmethod
    def of_case(cls, result: Mapping[str, Any], **head: Any) -> Record:
        """Build a record of results by name; those without a field go to `other`."""
        own = {key: value for key, value in result.items() if key in cls.model_fields or isinstance(value, part.Part)}
        other = {key: value for key, value in result.items() if key not in own}
        return cls.model_validate({**own, **({"other": {**own.get("other", {}), **other}} if other else {}), **head})

    def to_dict(self) -> dict[str, Any]:
        """Return the content of record.json, without unmeasured parts."""
        head = {"schema": self.schema_version}
        fields = self.model_dump(exclude_unset=True, exclude={"schema_version", "answers"})
        answers = {name: answer.values() for name, answer in self.answers.items()}
        return head | {key: value for key, value in fields.items() if value is not None} | answers

    def with_parts(self, **parts: Any) -> Record:
        """Return the record with other parts and answers, by name, without those that are None."""
        own = {name: value for name, value in parts.items() if name in type(self).model_fields}
        answers = {**self.answers, **{name: value for name, value in parts.items() if name not in own}}
        kept = {name: answer for name, answer in answers.items() if answer is not None}
        return self.model_copy(update={"answers": kept, **own})

    def held(self, name: str) -> Any:
        """Return a part or an answer by name; None if absent."""
        return self.answers.get(name, getattr(self, name, None))

    def of(self, kind: type[R]) -> R | None:
        """Return the answer of a result class; None if its question was not asked."""
        answer: R | None = self.answers.get(kind.question)
        return answer

    @property
    def answered(self) -> bool:
        """Whether the case has a result."""
        return self.status in STATUSES

    @property
    def modes(self) -> Any:
        """Answer about the modes of the plate; None if not asked."""
        return self.answers.get("modes")

    @property
    def response(self) -> Any:
        """Answer about the forced response; None if not asked."""
        return self.answers.get("response")

    @property
    def target(self) -> Any:
        """Target mode; None if there is none or no modes were computed."""
        found = self.modes.target if self.modes else None
        return found if found and found.is_found else None

    @property
    def target_status(self) -> str | None:
        """Status single, split or none; None if no modes were computed."""
        return self.modes.target.status if self.modes and self.modes.target else None

    @property
    def confinement_db(self) -> float | None:
        """Confinement of the target mode, dB; None without a target mode or a passive face."""
        return self.target.confinement_db if self.target else None

    @property
    def driven_db(self) -> float | None:
        """Driven confinement at the target mode's peak, dB; None without a response or without that peak."""
        return self.response.target_peak.confinement_db if self.response and self.response.target_peak else None

    @property
    def driven_error_db(self) -> float | None:
        """Error bar of driven_db (half-width); None without an estimate."""
        peak = self.response.target_peak if self.response else None
        return peak.confinement_error_db if peak else None

    def error_at(self, frequency_hz: float) -> float | None:
        """Return the relative error bar of the plate's mode at a stored frequency; None if unknown."""
        known = [(mode.frequency_hz, mode.error) for mode in self.modes.modes] if self.modes else []
        if self.target:
            known.append((self.target.frequency_hz, self.target.frequency_error))
        return next((error for tone, error in known if isclose(tone, frequency_hz, rel_tol=1e-9)), None)

    @property
    def ranked_db(self) -> float | None:
        """Confinement that ranks designs, dB: driven by the patches, or of the mode without patches."""
        return self.driven_db if self.response else self.confinement_db

    @property
    def confined(self) -> bool | None:
        """Whether the zone confines the target mode: as a mode and, with patches, when driven at its peak.

        None if undefined.
        """
        level, driven = self.confinement_db, self.driven_db
        return None if level is None else min(level, level if driven is None else driven) >= CONFINED_DB

    @property
    def verdict(self) -> str:
        """Whether the target mode is confined, as a mode and as driven by patches, in words."""
        as_mode = self.confinement_db is not None and self.confinement_db >= CONFINED_DB
        return "confined" if self.confined else "confined as a mode, not as driven" if as_mode else "leaking"

    def mesh(self, what: str, kind: str) -> MeshRecord | None:
        """Return the first mesh of a body and a kind."""
        return next((mesh for mesh in self.meshes if (mesh.what, mesh.kind) == (what, kind)), None)


class PartFault(Exception):
    """An answer that does not match its declaration, with its path."""


def first_fault(error: ValidationError) -> str:
    """Return the path of the first fault, and its message."""
    first = error.errors()[0]
    return f"{'.'.join(str(part) for part in first['loc'])}: {first['msg']}"


def kind_of(name: str) -> type[part.Part] | None:
    """Return the result class of a part of a record; None if it is not an answer.

    Questions know records, not the other way round: they are found when a record is read.
    """
    question = import_module("pipeline.questions").known().get(name)
    kind: type[part.Part] | None = question.result if question else None
    return kind


def _table(name: str, given: Any) -> Mapping[str, Any]:
    if not isinstance(given, Mapping):
        raise PartFault(f"{name}: must be a table")
    return given


def answer_of(name: str, given: Any) -> part.Part:
    """An answer as computed, or read back from `to_dict`."""
    kind = kind_of(name)
    assert kind
    if isinstance(given, part.Part):
        return given
    try:
        return kind.from_dict({key: value for key, value in _table(name, given).items() if key != "schema"})
    except ValidationError as error:
        raise PartFault(f"{name}.{first_fault(error)}") from error


def read(folder: Path) -> Record:
    """Read the record of a case. Raises store.BadRecord if missing, torn, edited, of another case or version."""
    try:
        return Record.model_validate(store.read_record(folder))
    except (ValidationError, PartFault) as error:
        fault = first_fault(error) if isinstance(error, ValidationError) else str(error)
        raise store.BadRecord(f"{store.RECORD} is not a record of schema {store.SCHEMA}: {fault}") from error
