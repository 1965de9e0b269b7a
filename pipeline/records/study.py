"""A stored study: its cases in order, each as far as it could be read."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel, ValidationError

from pipeline.records import record, store
from pipeline.records.record import KeysRecord, Record

if TYPE_CHECKING:
    import numpy as np

CASES = "cases.json"
SAME_PLATE = ("tet_modes", "geometry")  # results that a case shares with another one of the same plate
SAME_CELL = ("tet_bands",)  # ... of the same unit cell
SIBLING_ARRAYS = ("tet_", "cell_")


class ListedCase(BaseModel):
    """Entry of a case in a study's list."""

    case_id: str
    sweep: dict[str, Any] = {}


class StudyList(BaseModel):
    """Content of cases.json: the study file's description of the study, and its cases."""

    about: dict[str, Any] = {}
    cases: list[ListedCase]


@dataclass(frozen=True)
class StoredCase:
    """One case with its record, which has status MISSING and the reason if none can be read."""

    folder: Path
    record: Record
    siblings: tuple[Path, ...] = ()  # folders of cases with the same design, whose arrays may also be shown

    @property
    def case_id(self) -> str:
        """Name of the case and its folder."""
        return self.record.case_id

    @property
    def sweep(self) -> dict[str, Any]:
        """Swept keys and their values."""
        return self.record.sweep

    @property
    def read_error(self) -> str:
        """Reason for a missing record; '' if there is one."""
        return self.record.diagnosis if self.record.status == "MISSING" else ""

    @property
    def has_cross_check(self) -> bool:
        """Whether the case has results that others with its plate or unit cell may show."""
        return any(self.record.held(key) for key in (*SAME_PLATE, *SAME_CELL)) or any(
            mesh.kind == "tet" for mesh in self.record.meshes
        )

    def read(self, name: str) -> dict[str, Any]:
        """Read a JSON file of the case; {} if missing, torn, not an object or not matching the record's checksum."""
        try:
            stored = store.read_listed(self.folder, name)
        except store.BadRecord:
            return {}
        return stored if isinstance(stored, dict) else {}

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the stored arrays and those borrowed from siblings; {} if there are none or they are damaged."""
        return self.read_arrays()[0]

    def read_arrays(self) -> tuple[dict[str, np.ndarray], list[str]]:
        """Return the arrays, and a line for each damaged file."""
        from pipeline.records.surface_codec import unfolded

        stored: dict[str, np.ndarray] = {}
        errors = []
        for folder in (*self.siblings, self.folder):
            try:
                arrays = unfolded(store.load_arrays(folder))
            except store.BadRecord as error:
                errors.append(f"{folder.name}: {error}")
                continue
            own = folder == self.folder
            stored |= {name: array for name, array in arrays.items() if own or name.startswith(SIBLING_ARRAYS)}
        return stored, errors


@dataclass(frozen=True)
class StoredStudy:
    """Cases of a study, and the study file's description."""

    folder: Path
    about: dict[str, Any]
    cases: tuple[StoredCase, ...]

    @property
    def name(self) -> str:
        """Name of the study."""
        return str(self.about.get("name") or self.folder.name)

    @property
    def swept(self) -> list[str]:
        """Swept keys, in their order of appearance."""
        return list(dict.fromkeys(key for case in self.cases for key in case.sweep))

    @cached_property
    def _by_plate(self) -> dict[str, list[StoredCase]]:
        return _grouped(self.cases, lambda keys: keys.plate_modes)

    @cached_property
    def _by_cell(self) -> dict[str, list[StoredCase]]:
        return _grouped(self.cases, lambda keys: keys.cell_bands)

    def with_cross_checks(self, case: StoredCase) -> StoredCase:
        """Complete a case with the cross-checks that a study computes once per plate or unit cell."""
        own = case.record
        if own.keys is None or not (own.target or own.held("bands")):
            return case
        plates, cells = (
            [other for other in group if other.case_id != case.case_id]
            for group in (self._by_plate.get(own.keys.plate_modes, []), self._by_cell.get(own.keys.cell_bands, []))
        )
        borrowed = {
            key: other.record.held(key)
            for keys, siblings in ((SAME_CELL, cells), (SAME_PLATE, plates))
            for other in siblings
            for key in keys
            if other.record.held(key) and not own.held(key)
        }
        folders = tuple(
            other.folder for other in plates if other.record.held("tet_modes") or other.record.held("tet_bands")
        )
        meshes = (next(filter(None, (other.record.mesh(what, "tet") for other in stored)), None)
                  for stored, what in ((plates, "plate"), (cells, "cell")))  # fmt: skip
        borrowed["meshes"] = [*own.meshes, *filter(None, meshes)]
        return replace(case, record=own.with_parts(**borrowed), siblings=folders)


def _grouped(cases: Iterable[StoredCase], key: Callable[[KeysRecord], str]) -> dict[str, list[StoredCase]]:
    """Return cases with a cross-check to share, grouped by key, in order."""
    groups = defaultdict(list)
    for case in cases:
        if case.record.keys and case.has_cross_check:
            groups[key(case.record.keys)].append(case)
    return groups


def read_study(folder: Path) -> StoredStudy:
    """Read a study's records. Raises store.BadRecord if the folder has none, or a list of cases of another version."""
    listed = StudyList(
        cases=[ListedCase(case_id=path.parent.name) for path in sorted(folder.glob(f"*/{store.RECORD}"))]
    )
    if (folder / CASES).exists():
        try:
            listed = StudyList.model_validate(store.read_sealed(folder / CASES))
        except ValidationError as error:
            said = error.errors()[0]["msg"]
            raise store.BadRecord(
                f"{folder / CASES}: written by another version ({said}); run the study again"
            ) from error
    if not listed.cases:
        raise store.BadRecord(f"{folder}: no stored study; run it first")
    return StoredStudy(folder, listed.about, tuple(_read_case(folder, case) for case in listed.cases))


def _read_case(study: Path, listed: ListedCase) -> StoredCase:
    folder = study / listed.case_id
    try:
        stored = record.read(folder)
    except store.BadRecord as error:
        missing = Record(case_id=listed.case_id, status="MISSING", diagnosis=str(error), sweep=listed.sweep)
        return StoredCase(folder, missing)
    return StoredCase(folder, stored.model_copy(update={"sweep": listed.sweep}) if listed.sweep else stored)
