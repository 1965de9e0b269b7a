"""One folder per case, whose files appear whole or not at all and record.json last; what a result depends on."""

from __future__ import annotations

import errno
import hashlib
import io
import json
import platform
import re
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatch
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from geometry import files
from pipeline.errors import CommandError
from pipeline.paths import ROOT
from pipeline.records.part import DOCUMENT_SCHEMA, plain

if TYPE_CHECKING:
    import numpy as np

COMPUTING_FOLDERS = ("geometry", "solvers", "pipeline", "firmware")
TABLE_LAYOUT = "firmware/mode_table.py"  # all of firmware/ that decides bytes of a record

# Files of pipeline/ that only dispatch, show or file away: editing them leaves every number as it is.
SHOWING = (
    *(f"pipeline/{name}.py" for name in ("logs", "paths", "process", "workers")),
    *(f"pipeline/{folder}/*" for folder in ("cli", "plots", "report")),
    "pipeline/active/plots*.py",
    *(f"pipeline/records/{name}.py" for name in ("outputs", "study", "tables")),
    *(f"pipeline/batch/{name}.py" for name in ("job", "runner", "script_study")),
)

COMPUTING_PACKAGES = ("numpy", "scipy", "cadquery", "cadquery-ocp", "pytetwild", "meshio", "trimesh", "rslab")

FIELDS = "fields.npz"  # every mode in full: written on demand only
INPUT, RECORD, ARRAYS = "input.json", "record.json", "arrays.npz"
TIMING, MANIFEST, RUN_LOG = "timing.json", "files.json", "run.mess"
TEMPORARY = files.PART
UNLISTED = {RECORD, TIMING, MANIFEST, RUN_LOG}
SCHEMA = 5  # of record.json: raised with every change of pipeline.records.record that an older record does not fit
EARLIER = "written by an earlier version: run it again"
PROOF = "proof"
NO_SPACE = {errno.ENOSPC, errno.EDQUOT}
SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")
CASE_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+=,@-]*")


@dataclass(frozen=True)
class Fingerprint:
    """Hash of the sources and versions of the packages: what all cases of a study have in common."""

    code_hash: str
    versions: dict[str, str]

    def differs_from(self, record: dict[str, Any]) -> str | None:
        """Why a record does not stem from these sources and packages, or None."""
        if record.get("code_hash") != self.code_hash:
            return "the program's sources changed"
        old = record.get("versions") or {}
        for name in sorted(old.keys() | self.versions.keys()):
            if old.get(name) != self.versions.get(name):
                return f"{name} was {old.get(name, 'absent')}, is {self.versions.get(name, 'absent')}"
        return None


class StoreError(CommandError):
    """A file that could not be written or cannot be believed; the message names it."""

    exit_code = 3


class DiskFull(StoreError):
    """No room left on the device; nothing half-written stays."""


class BadRecord(StoreError):
    """A record or its arrays are missing, torn or of another schema."""

    exit_code = 2


def canonical_json(value: Any) -> str:
    """One text for one value: keys sorted, no blanks, shortest floats that read back the same."""
    return json.dumps(plain(value), sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def input_hash(payload: dict[str, Any]) -> str:
    """sha256 of the canonical JSON of an input."""
    return hashlib.sha256(canonical_json(payload).encode()).hexdigest()


def file_hash(path: Path) -> str:
    """sha256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def computing_sources(root: Path = ROOT) -> list[Path]:
    """Every source file whose edit may change a number: all of them but the few that only dispatch and show."""
    paths = (path for folder in COMPUTING_FOLDERS for path in (root / folder).rglob("*.py"))
    return sorted(path for path in paths if not _only_shows(path.relative_to(root)))


def code_hash(root: Path = ROOT) -> str:
    """sha256 over names and bytes of the computing sources."""
    total = hashlib.sha256()
    for path in computing_sources(root):
        total.update(f"{path.relative_to(root).as_posix()} {file_hash(path)}\n".encode())
    return total.hexdigest()


def package_versions() -> dict[str, str]:
    """Versions of Python and of the packages that compute; one that is not installed is left out."""
    from importlib import metadata  # slow to import, and only a record needs it

    versions = {"python": platform.python_version()}
    for name in COMPUTING_PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return versions


@lru_cache(maxsize=1)
def current_fingerprint() -> Fingerprint:
    """The fingerprint of this process, taken once: what was imported does not change with the files."""
    return Fingerprint(code_hash(), package_versions())


def refuse_earlier(place: Path | str, document: Any, schema: int = DOCUMENT_SCHEMA) -> None:
    """Raise BadRecord for a document whose schema is below this version's."""
    found = document.get("schema") if isinstance(document, dict) else None
    if isinstance(found, int) and found < schema:
        raise BadRecord(f"{place}: {EARLIER}")


def case_folder(study: Path, case_id: str) -> Path:
    """Folder of a case; refuses an id that is no plain folder name."""
    if not CASE_ID.fullmatch(case_id) or len(case_id) > 200:
        raise ValueError(f"case id {case_id!r}: letters, digits and . _ + = , @ - only, at most 200")
    return study / case_id


def write_atomic(path: Path, data: bytes) -> None:
    """Write a file whole or not at all, by geometry.files. Raises DiskFull, StoreError for a place that cannot be written."""
    try:
        with files.written_whole(path) as temporary:
            temporary.write_bytes(data)
    except OSError as error:
        raise _named(error, path, len(data)) from error


def write_json(path: Path, value: Any) -> None:
    """Write a value as readable JSON, atomically; NaN and infinity become null."""
    write_atomic(path, (json.dumps(plain(value), indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode())


def read_json(path: Path) -> Any:
    """Read JSON; raises BadRecord with the file's name when it is missing or torn, or holds NaN or infinity."""
    try:
        return parsed_json(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise BadRecord(f"{path.name} is missing") from error
    except (OSError, ValueError, RecursionError) as error:
        raise BadRecord(f"{path.name} is unreadable ({error})") from error


def parsed_json(text: str) -> Any:
    """Parse a JSON document; ValueError or RecursionError for text that is none, NaN, infinity and half a surrogate pair."""
    value = json.loads(text, parse_constant=_no_number)
    if SURROGATE.search(text):
        json.dumps(value, ensure_ascii=False).encode()  # UnicodeEncodeError is a ValueError
    return value


def save_arrays(folder: Path, arrays: dict[str, np.ndarray], name: str = ARRAYS) -> None:
    """Write arrays.npz (or another .npz) of a case, compressed and atomically; the same arrays give the same bytes."""
    import numpy as np

    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    write_atomic(folder / name, buffer.getvalue())


def load_arrays(folder: Path) -> dict[str, np.ndarray]:
    """Arrays of a case by name, empty when it stored none. Raises BadRecord when they are not what its record proves."""
    import numpy as np

    _, listed = _proven(folder)
    if ARRAYS not in listed and not (folder / ARRAYS).exists():
        return {}
    data = _proven_bytes(folder, ARRAYS, listed)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except Exception as error:  # zipfile, zlib and numpy raise what they like over a torn file, MemoryError too
        raise BadRecord(f"{ARRAYS} is unreadable ({type(error).__name__}: {error})") from error


def begin(folder: Path, payload: dict[str, Any]) -> None:
    """Open a case: what proved an earlier run goes first, then the leftovers of killed ones, then the input is kept."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in (RECORD, MANIFEST, TIMING, ARRAYS, FIELDS):
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise _named(error, folder, 0) from error
    sweep_leftovers(folder)
    write_json(folder / INPUT, payload)


def sweep_leftovers(folder: Path) -> None:
    """Remove what a killed run left half-written."""
    for path in folder.glob(f".*{TEMPORARY}"):
        with suppress(OSError):
            path.unlink()


def finish(folder: Path, record: dict[str, Any], timing: dict[str, Any]) -> None:
    """Close a case: times, then the list of its files and the record, which proves both."""
    write_json(folder / TIMING, timing)
    seal(folder, record)


def seal(folder: Path, record: dict[str, Any]) -> None:
    """Write files.json (size and sha256 of each file) and, last, record.json with the proof of both."""
    listed = manifest(folder)
    write_json(folder / MANIFEST, listed)
    write_sealed(folder / RECORD, record, listed)


def write_sealed(path: Path, value: dict[str, Any], listed: Any = None) -> None:
    """Write a JSON object with the proof of its content, and of the files that are listed beside it."""
    kept = plain({key: item for key, item in value.items() if key != PROOF})
    write_json(path, {**kept, PROOF: _proof(kept, listed)})


def read_sealed(path: Path) -> dict[str, Any]:
    """Read what `write_sealed` wrote. Raises BadRecord for a missing, torn or edited file."""
    value = read_json(path)
    refuse_earlier(path, value)
    if not isinstance(value, dict) or value.pop(PROOF, None) != _proof(value, None):
        raise BadRecord(f"{path}: not what a run of this version wrote; run the study again")
    return value


def manifest(folder: Path) -> dict[str, dict[str, Any]]:
    """Size and sha256 of every file that the case produced."""
    kept = sorted(p for p in folder.iterdir() if p.is_file() and p.name not in UNLISTED and not p.name.startswith("."))
    return {path.name: {"bytes": path.stat().st_size, "sha256": file_hash(path)} for path in kept}


def read_record(folder: Path) -> dict[str, Any]:
    """Record of a case. Raises BadRecord when it is missing, torn, edited, another case's or of another schema."""
    return _proven(folder)[0]


def read_listed(folder: Path, name: str) -> Any:
    """Read a JSON file of a case. Raises BadRecord when it is missing or torn, or not what the case's record proves."""
    if name in UNLISTED:
        return read_json(folder / name)
    _proven_bytes(folder, name, _proven(folder)[1])
    return read_json(folder / name)


def why_recompute(folder: Path, payload: dict[str, Any], fingerprint: Fingerprint) -> str | None:
    """Why a case has to be computed, in a few words; None when its record stands."""
    if not (folder / RECORD).exists():
        return "not finished before" if (folder / INPUT).exists() else "new"
    try:
        record, listed = _proven(folder)
        for name in {*listed, *(name for name in (ARRAYS, FIELDS) if (folder / name).exists())}:
            _proven_bytes(folder, name, listed)
    except BadRecord as error:
        return str(error)
    if record.get("input_hash") != input_hash(payload):
        return "its input changed"
    changed = fingerprint.differs_from(record)
    if changed:
        return changed
    return "it failed before" if record.get("status") == "FAILED" else None


def _only_shows(relative: Path) -> bool:
    if relative.parts[0] == "firmware":
        return relative.as_posix() != TABLE_LAYOUT
    return any(fnmatch(relative.as_posix(), pattern) for pattern in SHOWING)


def _named(error: OSError, path: Path, size: int) -> StoreError:
    if isinstance(error, files.UnwritableError):
        return StoreError(str(error))
    if error.errno in NO_SPACE:
        return DiskFull(f"{path}: no space left on the disk for {size} bytes; make room and run again")
    return StoreError(f"{path}: cannot be written ({error.strerror or error})")


def _no_number(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number of JSON")


def _proof(record: dict[str, Any], listed: Any) -> str:
    """sha256 over a record and the list of its files, both as JSON. Raises ValueError for what JSON cannot hold."""
    text = json.dumps([record, listed], sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _proven(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The record and the list of files that it proves, by name."""
    record = read_json(folder / RECORD)
    if not isinstance(record, dict) or not isinstance(record.get("case_id"), str):
        raise BadRecord(f"{RECORD} is unreadable (not a case's record)")
    refuse_earlier(RECORD, record, SCHEMA)
    if record.get("schema") != SCHEMA:
        raise BadRecord(f"{RECORD} has schema {record.get('schema')!r}, this version reads {SCHEMA}")
    if record["case_id"] != folder.name:
        raise BadRecord(f"{RECORD} is that of case {record['case_id']}")
    if PROOF not in record:
        raise BadRecord(f"{RECORD} carries no proof; an earlier version wrote it")
    proof, listed = record.pop(PROOF), read_json(folder / MANIFEST)
    try:
        proven = _proof(record, listed) == proof
    except ValueError:
        proven = False
    if not proven:
        raise BadRecord(f"{RECORD} and {MANIFEST} are not what was written")
    return record, listed


def _proven_bytes(folder: Path, name: str, listed: dict[str, Any]) -> bytes:
    """Content of a file of a case. Raises BadRecord when it is not what the list says."""
    try:
        data = (folder / name).read_bytes()
    except OSError as error:
        raise BadRecord(f"{name} is missing") from error
    if name not in listed:
        raise BadRecord(f"{name} is not a file that the case wrote")
    if hashlib.sha256(data).hexdigest() != listed[name]["sha256"]:
        raise BadRecord(f"{name} is unreadable (its content is not what was written)")
    return data
