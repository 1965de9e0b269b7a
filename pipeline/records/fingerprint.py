"""What a result depends on: the input with defaults, the sources that compute, the packages that compute."""

from __future__ import annotations

import hashlib
import json
import platform
from dataclasses import dataclass
from fnmatch import fnmatch
from functools import lru_cache
from pathlib import Path
from typing import Any

from pipeline.paths import ROOT
from pipeline.records.part import plain

COMPUTING_FOLDERS = ("geometry", "solvers", "pipeline", "firmware")
TABLE_LAYOUT = "firmware/mode_table.py"  # all of firmware/ that decides bytes of a record
# Files of pipeline/ that only dispatch, show or file away: editing them leaves every number as it is.
SHOWING = (
    *(f"pipeline/{name}.py" for name in ("logs", "paths", "process", "workers")),
    *(f"pipeline/{folder}/*" for folder in ("cli", "plots", "report")),
    "pipeline/active/plots*.py",
    *(f"pipeline/records/{name}.py" for name in ("outputs", "run_log", "study", "tables")),
    *(f"pipeline/batch/{name}.py" for name in ("job", "progress", "runner", "script_study")),
)
COMPUTING_PACKAGES = ("numpy", "scipy", "cadquery", "cadquery-ocp", "pytetwild", "meshio", "trimesh", "rslab")


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


def _only_shows(relative: Path) -> bool:
    if relative.parts[0] == "firmware":
        return relative.as_posix() != TABLE_LAYOUT
    return any(fnmatch(relative.as_posix(), pattern) for pattern in SHOWING)


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
def current() -> Fingerprint:
    """The fingerprint of this process, taken once: what was imported does not change with the files."""
    return Fingerprint(code_hash(), package_versions())
