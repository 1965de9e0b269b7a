"""A study as stored: its cases in their order, each with what could be read of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.records import store

if TYPE_CHECKING:
    import numpy as np

CASES = "cases.json"
CONFINED_DB = 10.0
SAME_PLATE = ("tet_modes", "geometry")  # what a case shows of another one with the very same design
SAME_CELL = ("tet_bands",)  # ... with the same unit cell
CELL_KEYS = ("pitch_x_m", "pitch_y_m", "thickness_m", "pillar")
SIBLING_ARRAYS = ("tet_", "cell_")
OTHER_VERSION = (KeyError, TypeError, AttributeError, ValueError, IndexError)


@dataclass(frozen=True)
class StoredCase:
    """One case: its record, or the read error that says why there is none."""

    folder: Path
    case_id: str
    sweep: dict[str, Any]
    record: dict[str, Any] = field(default_factory=dict)
    read_error: str = ""
    siblings: tuple[Path, ...] = ()  # folders of cases with the same design, whose arrays may be shown beside

    @property
    def status(self) -> str:
        """OK, WARNING, FAILED, or MISSING when nothing readable is stored."""
        return str(self.record.get("status", "MISSING"))

    @property
    def diagnosis(self) -> str:
        """One line on how it ended."""
        return self.read_error or str(self.record.get("diagnosis", ""))

    @property
    def wanted(self) -> dict[str, Any]:
        """The wanted mode's measures, empty when there is none."""
        stored = self.record.get("wanted") or {}
        return stored if stored.get("frequency_hz") is not None else {}

    @property
    def wanted_status(self) -> str | None:
        """single, split or none; None where no mode was looked for."""
        return (self.record.get("wanted") or {}).get("status")

    @property
    def confined(self) -> bool | None:
        """Whether the zone holds the wanted mode by at least 10 dB: as a mode and, where patches drive it, at its own peak.

        None where the question has no meaning.
        """
        level, driven = self.wanted.get("confinement_db"), self.driven_db
        return None if level is None else min(level, level if driven is None else driven) >= CONFINED_DB

    @property
    def driven_db(self) -> float | None:
        """Confinement at the wanted mode's peak as the patches drive it, dB; None without a response or without that peak."""
        stored = (self.record.get("response") or {}).get("wanted_peak") or {}
        return stored.get("confinement_db")

    def read(self, name: str) -> Any:
        """A JSON file of the case, {} when it is missing or torn, no object, or not what the record proves."""
        try:
            stored = store.read_listed(self.folder, name)
        except store.BadRecord:
            return {}
        return stored if isinstance(stored, dict) else {}

    def arrays(self) -> dict[str, np.ndarray]:
        """The stored arrays and those borrowed from siblings; {} when there are none or they cannot be believed."""
        return self.read_arrays()[0]

    def read_arrays(self) -> tuple[dict[str, np.ndarray], list[str]]:
        """The same, and a line for each file of arrays that cannot be believed."""
        from pipeline.records.surface_codec import unfolded

        stored: dict[str, np.ndarray] = {}
        read_errors = []
        for folder in (*self.siblings, self.folder):
            try:
                arrays = unfolded(store.load_arrays(folder))
            except store.BadRecord as error:
                read_errors.append(f"{folder.name}: {error}")
                continue
            own = folder == self.folder
            stored |= {name: array for name, array in arrays.items() if own or name.startswith(SIBLING_ARRAYS)}
        return stored, read_errors


@dataclass(frozen=True)
class StoredStudy:
    """A study's cases, and what the study file said about it."""

    folder: Path
    about: dict[str, Any]
    cases: tuple[StoredCase, ...]

    @property
    def name(self) -> str:
        """Name of the study."""
        return str(self.about.get("name") or self.about.get("study") or self.folder.name)

    @property
    def swept(self) -> list[str]:
        """Swept keys, in their order of appearance."""
        return list(dict.fromkeys(key for case in self.cases for key in case.sweep))

    def for_showing(self, case: StoredCase) -> StoredCase:
        """A case completed by what a study computes once: cross-checks of the same plate or the same unit cell."""
        if not (case.record.get("wanted") or case.record.get("bands")):
            return case
        design, others = case.record.get("design"), [other for other in self.cases if other.case_id != case.case_id]
        plates = [other for other in others if design and other.record.get("design") == design]
        cells = [other for other in others if design and _cell(other.record.get("design")) == _cell(design)]
        borrowed = {
            key: other.record[key]
            for keys, siblings in ((SAME_CELL, cells), (SAME_PLATE, plates))
            for other in siblings
            for key in keys
            if other.record.get(key) and not case.record.get(key)
        }
        folders = tuple(
            other.folder for other in plates if other.record.get("tet_modes") or other.record.get("tet_bands")
        )
        meshes = [*case.record.get("meshes", []), *_tet_meshes(plates, "plate"), *_tet_meshes(cells, "cell")]
        return replace(case, record={**case.record, **borrowed, "meshes": meshes}, siblings=folders)


def _tet_meshes(siblings: list[StoredCase], what: str) -> list[dict[str, Any]]:
    stored = (mesh for case in siblings for mesh in case.record.get("meshes") or [])
    return [mesh for mesh in stored if mesh.get("what") == what and mesh.get("kind") == "tet"][:1]


def _cell(design: dict[str, Any] | None) -> list[Any] | None:
    return [design.get(key) for key in CELL_KEYS] if design else None


def read_study(folder: Path) -> StoredStudy:
    """Read a study's records. Raises store.BadRecord when the folder holds none, or another version's list of cases."""
    try:
        return _read_study(folder)
    except OTHER_VERSION as fault:
        raise store.BadRecord(f"{folder / CASES}: {other_version(fault)}") from fault


def other_version(fault: Exception) -> str:
    """What is told of stored fields that are not those of this version."""
    return f"written by another version ({type(fault).__name__}: {fault}); run the study again"


def _read_study(folder: Path) -> StoredStudy:
    about: dict[str, Any] = {}
    listed: list[dict[str, Any]] = []
    if (folder / CASES).exists():
        stored = store.read_json(folder / CASES)
        about, listed = stored.get("about", {}), stored.get("cases", [])
    else:
        listed = [{"case_id": path.parent.name} for path in sorted(folder.glob(f"*/{store.RECORD}"))]
    if not listed:
        raise store.BadRecord(f"{folder}: no study is stored here; run it first")
    return StoredStudy(folder, about, tuple(_read_case(folder / entry["case_id"], entry) for entry in listed))


def _read_case(folder: Path, entry: dict[str, Any]) -> StoredCase:
    sweep = entry.get("sweep") or {}
    try:
        record = store.read_record(folder)
    except store.BadRecord as error:
        return StoredCase(folder, folder.name, sweep, {}, str(error))
    return StoredCase(folder, folder.name, sweep or record.get("sweep") or {}, record)
