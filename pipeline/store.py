"""One folder per case; every file appears whole or not at all, and record.json appears last."""

from __future__ import annotations

import errno
import io
import json
import os
import re
import zipfile
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.errors import CommandError
from pipeline.fingerprint import Fingerprint, file_hash, input_hash, plain

if TYPE_CHECKING:
    import numpy as np

FIELDS = "fields.npz"  # every mode in full: written on demand only
INPUT, RECORD, ARRAYS, TIMING, MANIFEST, MESS = (
    "input.json",
    "record.json",
    "arrays.npz",
    "timing.json",
    "files.json",
    "run.mess",
)
TEMPORARY = ".antinode-part"
UNLISTED = {RECORD, TIMING, MANIFEST, MESS}
NO_SPACE = {errno.ENOSPC, errno.EDQUOT}
CASE_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+=,@-]*")


class StoreError(CommandError):
    """A file that could not be written or cannot be believed; the message names it."""

    exit_code = 3


class DiskFull(StoreError):
    """No room left on the device; nothing half-written stays."""


class BadRecord(StoreError):
    """A record or its arrays are missing, torn or of another schema."""

    exit_code = 2


def case_folder(study: Path, case_id: str) -> Path:
    """Folder of a case; refuses an id that is no plain folder name."""
    if not CASE_ID.fullmatch(case_id) or len(case_id) > 200:
        raise ValueError(f"case id {case_id!r}: letters, digits and . _ + = , @ - only, at most 200")
    return study / case_id


def write_atomic(path: Path, data: bytes) -> None:
    """Write beside, flush to the device, rename: a reader sees the old file or the new one. Raises DiskFull."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}{TEMPORARY}")
    try:
        with temporary.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
        _flush_folder(path.parent)
    except OSError as error:
        with suppress(OSError):
            temporary.unlink()
        raise _named(error, path, len(data)) from error


def _named(error: OSError, path: Path, size: int) -> StoreError:
    if error.errno in NO_SPACE:
        return DiskFull(f"{path}: no space left on the disk for {size} bytes; make room and run again")
    return StoreError(f"{path}: cannot be written ({error.strerror or error})")


def _flush_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_json(path: Path, value: Any) -> None:
    """Write a value as readable JSON, atomically; NaN and infinity become null."""
    write_atomic(path, (json.dumps(plain(value), indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode())


def read_json(path: Path) -> Any:
    """Read JSON; raises BadRecord with the file's name when it is missing or torn."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise BadRecord(f"{path.name} is missing") from error
    except (OSError, ValueError) as error:
        raise BadRecord(f"{path.name} is unreadable ({error})") from error


def save_arrays(folder: Path, arrays: dict[str, np.ndarray], name: str = ARRAYS) -> None:
    """Write arrays.npz (or another .npz) of a case, compressed and atomically; the same arrays give the same bytes."""
    import numpy as np

    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    write_atomic(folder / name, buffer.getvalue())


def load_arrays(folder: Path) -> dict[str, np.ndarray]:
    """Arrays of a case by name, empty when it stored none. Raises BadRecord when the file is torn."""
    import numpy as np

    path = folder / ARRAYS
    if not path.exists():
        return {}
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise BadRecord(f"{path.name} is unreadable ({error})") from error


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
    """Close a case: times, list of files with hashes, and last the record, the proof that the case ended."""
    write_json(folder / TIMING, timing)
    write_json(folder / MANIFEST, manifest(folder))
    write_json(folder / RECORD, record)


def manifest(folder: Path) -> dict[str, dict[str, Any]]:
    """Size and sha256 of every file that the case produced."""
    files = sorted(p for p in folder.iterdir() if p.is_file() and p.name not in UNLISTED and not p.name.startswith("."))
    return {path.name: {"bytes": path.stat().st_size, "sha256": file_hash(path)} for path in files}


def read_record(folder: Path) -> dict[str, Any]:
    """Record of a case. Raises BadRecord when missing, torn or of another schema."""
    record = read_json(folder / RECORD)
    if not isinstance(record, dict) or not isinstance(record.get("case_id"), str):
        raise BadRecord(f"{RECORD} is unreadable (not a case's record)")
    if record.get("schema") != 1:
        raise BadRecord(f"{RECORD} has schema {record.get('schema')!r}, this version reads 1")
    return record


def why_recompute(folder: Path, payload: dict[str, Any], fingerprint: Fingerprint) -> str | None:
    """Why a case has to be computed, in a few words; None when its record stands."""
    if not (folder / RECORD).exists():
        return "not finished before" if (folder / INPUT).exists() else "new"
    try:
        record = read_record(folder)
        _check_files(folder)
    except BadRecord as error:
        return str(error)
    if record.get("input_hash") != input_hash(payload):
        return "its input changed"
    changed = fingerprint.differs_from(record)
    if changed:
        return changed
    return "it failed before" if record.get("status") == "FAILED" else None


def _check_files(folder: Path) -> None:
    listed = read_json(folder / MANIFEST)
    if not isinstance(listed, dict):
        raise BadRecord(f"{MANIFEST} is unreadable (not a list of files)")
    for name, proof in listed.items():
        path = folder / name
        if not path.is_file():
            raise BadRecord(f"{name} is missing")
        if path.stat().st_size != proof.get("bytes") or file_hash(path) != proof.get("sha256"):
            raise BadRecord(f"{name} is unreadable (its content is not what was written)")
