"""One folder per case, with atomic writes and record.json last; fingerprint of a result's sources."""

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
COMPUTING_SUFFIXES = (".py", ".csv", ".toml")
TABLE_LAYOUT = "firmware/mode_table.py"  # the part of firmware/ on which a record depends

# Files of pipeline/ that only dispatch, display or store: editing them changes no number.
SHOWING = (
    *(f"pipeline/{name}.py" for name in ("logs", "paths", "process", "workers")),
    *(f"pipeline/{folder}/*" for folder in ("cli", "plots", "report")),
    "pipeline/active/plots*.py",
    *(f"pipeline/records/{name}.py" for name in ("outputs", "study", "tables")),
    *(f"pipeline/batch/{name}.py" for name in ("job", "runner", "script_study")),
)

COMPUTING_PACKAGES = ("numpy", "scipy", "cadquery", "cadquery-ocp", "pytetwild", "meshio", "trimesh", "rslab")

FIELDS = "fields.npz"  # every mode in full; written only on demand
INPUT, RECORD, ARRAYS = "input.json", "record.json", "arrays.npz"
OUTPUTS = (  # further files of a case, of questions that a later run may not ask
    *("mode_table.bin", "mode_table.h", "travelling_wave.bin", "travelling_wave.h"),
    *("plate.step", "plate.3mf", "plate_mm.stl"),
)
TIMING, MANIFEST, RUN_LOG = "timing.json", "files.json", "run.mess"
TEMPORARY = files.PART
UNLISTED = {RECORD, TIMING, MANIFEST, RUN_LOG}
SCHEMA = 5  # version of record.json: raised with every incompatible change of pipeline.records.record
EARLIER = "written by an earlier version: run it again"
PROOF = "proof"
NO_SPACE = {errno.ENOSPC, errno.EDQUOT}
SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")
CASE_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+=,@-]*")


@dataclass(frozen=True)
class Fingerprint:
    """Hash of the sources and versions of the packages, common to all cases of a study."""

    code_hash: str
    versions: dict[str, str]

    def differs_from(self, record: dict[str, Any]) -> str | None:
        """Return why a record does not stem from these sources and packages, or None."""
        if record.get("code_hash") != self.code_hash:
            return "the program's sources changed"
        old = record.get("versions") or {}
        for name in sorted(old.keys() | self.versions.keys()):
            if old.get(name) != self.versions.get(name):
                return f"{name} was {old.get(name, 'absent')}, is {self.versions.get(name, 'absent')}"
        return None


class StoreError(CommandError):
    """A file could not be written or is damaged; the message names it."""

    exit_code = 3


class DiskFull(StoreError):
    """No space left on the device; no partial file remains."""


class BadRecord(StoreError):
    """A record or its arrays are missing, torn or of another schema."""

    exit_code = 2


def canonical_json(value: Any) -> str:
    """Return the canonical text of a value: keys sorted, no blanks, shortest exact floats."""
    return json.dumps(plain(value), sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def input_hash(payload: dict[str, Any]) -> str:
    """Return the sha256 of the canonical JSON of an input."""
    return hashlib.sha256(canonical_json(payload).encode()).hexdigest()


def file_hash(path: Path) -> str:
    """Return the sha256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def computing_sources(root: Path = ROOT) -> list[Path]:
    """Return every file whose edit may change a number: sources, but the few that only dispatch and display, and data."""
    found = (path for folder in COMPUTING_FOLDERS for path in (root / folder).rglob("*"))
    paths = (path for path in found if path.suffix in COMPUTING_SUFFIXES)
    return sorted(path for path in paths if not _only_shows(path.relative_to(root)))


def code_hash(root: Path = ROOT) -> str:
    """Return the sha256 over names and contents of the computing sources."""
    total = hashlib.sha256()
    for path in computing_sources(root):
        total.update(f"{path.relative_to(root).as_posix()} {file_hash(path)}\n".encode())
    return total.hexdigest()


def package_versions() -> dict[str, str]:
    """Return the versions of Python and of the computing packages that are installed."""
    from importlib import metadata  # slow to import, and needed only by records

    versions = {"python": platform.python_version()}
    for name in COMPUTING_PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return versions


@lru_cache(maxsize=1)
def current_fingerprint() -> Fingerprint:
    """Return the fingerprint of this process, taken once, since imported code does not change with the files."""
    return Fingerprint(code_hash(), package_versions())


def refuse_earlier(place: Path | str, document: Any, schema: int = DOCUMENT_SCHEMA) -> None:
    """Raise BadRecord for a document with an older schema."""
    found = document.get("schema") if isinstance(document, dict) else None
    if isinstance(found, int) and found < schema:
        raise BadRecord(f"{place}: {EARLIER}")


def case_folder(study: Path, case_id: str) -> Path:
    """Return the folder of a case; reject an id that is not a plain folder name."""
    if not CASE_ID.fullmatch(case_id) or len(case_id) > 200:
        raise ValueError(f"case id {case_id!r}: must consist of at most 200 letters, digits and . _ + = , @ -")
    return study / case_id


def write_atomic(path: Path, data: bytes) -> None:
    """Write a file atomically with geometry.files. Raises DiskFull, or StoreError for an unwritable place."""
    try:
        with files.written_whole(path) as temporary:
            temporary.write_bytes(data)
    except OSError as error:
        raise _named(error, path, len(data)) from error


def write_json(path: Path, value: Any) -> None:
    """Write a value as readable JSON, atomically; NaN and infinity become null."""
    write_atomic(path, (json.dumps(plain(value), indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode())


def read_json(path: Path) -> Any:
    """Read JSON. Raises BadRecord naming a file that is missing or torn, or contains NaN or infinity."""
    try:
        return parsed_json(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise BadRecord(f"{path.name} is missing") from error
    except (OSError, ValueError, RecursionError) as error:
        raise BadRecord(f"{path.name} is unreadable ({error})") from error


def parsed_json(text: str) -> Any:
    """Parse a JSON document; ValueError or RecursionError for other text, NaN, infinity and lone surrogates."""
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
    """Return the arrays of a case by name, {} without any. Raises BadRecord for a checksum mismatch."""
    import numpy as np

    _, listed = _proven(folder)
    if ARRAYS not in listed and not (folder / ARRAYS).exists():
        return {}
    data = _proven_bytes(folder, ARRAYS, listed)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except Exception as error:  # zipfile, zlib and numpy raise various exceptions on a torn file, including MemoryError
        raise BadRecord(f"{ARRAYS} is unreadable ({type(error).__name__}: {error})") from error


def begin(folder: Path, payload: dict[str, Any]) -> None:
    """Open a case: remove record and results of an earlier run, then leftovers of killed ones, then store the input."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in (RECORD, MANIFEST, TIMING, ARRAYS, FIELDS, *OUTPUTS):
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise _named(error, folder, 0) from error
    sweep_leftovers(folder)
    write_json(folder / INPUT, payload)


def sweep_leftovers(folder: Path) -> None:
    """Remove partial files of a killed run."""
    for path in folder.glob(f".*{TEMPORARY}"):
        with suppress(OSError):
            path.unlink()


def finish(folder: Path, record: dict[str, Any], timing: dict[str, Any]) -> None:
    """Close a case: write times, then the list of its files and the record with the checksum of both."""
    write_json(folder / TIMING, timing)
    seal(folder, record)


def seal(folder: Path, record: dict[str, Any]) -> None:
    """Write files.json (size and sha256 of each file) and, last, record.json with the checksum of both."""
    listed = manifest(folder)
    write_json(folder / MANIFEST, listed)
    write_sealed(folder / RECORD, record, listed)


def write_sealed(path: Path, value: dict[str, Any], listed: Any = None) -> None:
    """Write a JSON object with a checksum of its content and of the listed files."""
    kept = plain({key: item for key, item in value.items() if key != PROOF})
    write_json(path, {**kept, PROOF: _proof(kept, listed)})


def read_sealed(path: Path) -> dict[str, Any]:
    """Read a file of `write_sealed`. Raises BadRecord for a missing, torn or edited file."""
    value = read_json(path)
    refuse_earlier(path, value)
    if not isinstance(value, dict) or value.pop(PROOF, None) != _proof(value, None):
        raise BadRecord(f"{path}: was changed or written by another version; run the study again")
    return value


def manifest(folder: Path) -> dict[str, dict[str, Any]]:
    """Return size and sha256 of every file of the case."""
    kept = sorted(p for p in folder.iterdir() if p.is_file() and p.name not in UNLISTED and not p.name.startswith("."))
    return {path.name: {"bytes": path.stat().st_size, "sha256": file_hash(path)} for path in kept}


def read_record(folder: Path) -> dict[str, Any]:
    """Read the record of a case. Raises BadRecord if missing, torn, edited, of another case or schema."""
    return _proven(folder)[0]


def read_listed(folder: Path, name: str) -> Any:
    """Read a JSON file of a case. Raises BadRecord if missing, torn or different from the record's checksum."""
    if name in UNLISTED:
        return read_json(folder / name)
    _proven_bytes(folder, name, _proven(folder)[1])
    return read_json(folder / name)


def why_recompute(folder: Path, payload: dict[str, Any], fingerprint: Fingerprint) -> str | None:
    """Return why a case has to be computed, in a few words; None if its record is valid."""
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
        return DiskFull(f"{path}: no space left on the disk for {size} bytes; free some space and run again")
    return StoreError(f"{path}: cannot be written ({error.strerror or error})")


def _no_number(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number")


def _proof(record: dict[str, Any], listed: Any) -> str:
    """Return the sha256 over a record and its list of files, both as JSON. Raises ValueError for non-JSON values."""
    text = json.dumps([record, listed], sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _proven(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the record and the list of its files, by name."""
    record = read_json(folder / RECORD)
    if not isinstance(record, dict) or not isinstance(record.get("case_id"), str):
        raise BadRecord(f"{RECORD} is unreadable (not a case's record)")
    refuse_earlier(RECORD, record, SCHEMA)
    if record.get("schema") != SCHEMA:
        raise BadRecord(f"{RECORD} has schema {record.get('schema')!r}, this version reads {SCHEMA}")
    if record["case_id"] != folder.name:
        raise BadRecord(f"{RECORD} belongs to case {record['case_id']}")
    if PROOF not in record:
        raise BadRecord(f"{RECORD} has no checksum: it was written by an earlier version")
    proof, listed = record.pop(PROOF), read_json(folder / MANIFEST)
    try:
        proven = _proof(record, listed) == proof
    except ValueError:
        proven = False
    if not proven:
        raise BadRecord(f"{RECORD} and {MANIFEST} do not match their checksum")
    return record, listed


def _proven_bytes(folder: Path, name: str, listed: dict[str, Any]) -> bytes:
    """Read a file of a case. Raises BadRecord if it does not match the list."""
    try:
        data = (folder / name).read_bytes()
    except OSError as error:
        raise BadRecord(f"{name} is missing") from error
    if name not in listed:
        raise BadRecord(f"{name} is not a file of the case")
    if hashlib.sha256(data).hexdigest() != listed[name]["sha256"]:
        raise BadRecord(f"{name} is unreadable (its content does not match its checksum)")
    return data
