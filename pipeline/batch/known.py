"""Where studies keep their results, and the names by which they answer from any folder.

The results of a study of the checkout lie in the checkout's `results/`, those of any other study file in `results/` beside it;
ANTINODE_RESULTS and --results say otherwise. What lies elsewhere is noted in a file of the user's state folder.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import NamedTuple

from pipeline import paths
from pipeline.errors import reason


class Place(NamedTuple):
    """A study file and the folder of its results."""

    source: Path
    folder: Path


def folder_of(name: str, source: Path, given: str | None = None) -> Path:
    """The folder of a study's results: below the one given, else where it was put before, else by the rule above."""
    if given:
        return Path(given).resolve() / name
    if os.environ.get("ANTINODE_RESULTS") or _is_ours(source):
        return paths.RESULTS / name
    before = known().get(name)
    if before and before.source == source.resolve():
        return before.folder
    return source.resolve().parent / "results" / name


def stored_folder(name: str, source: Path, given: str | None = None) -> Path:
    """The folder of a study's results to read: where they would be written, else where they were put before."""
    place, before = folder_of(name, source, given), known().get(name)
    elsewhere = not given and not place.exists() and before and before.source == source.resolve()
    return before.folder if before and elsewhere else place


def _is_ours(source: Path) -> bool:
    return (paths.IS_CHECKOUT and source.resolve().is_relative_to(paths.ROOT)) or source.parent == paths.STUDIES


def known() -> dict[str, Place]:
    """Studies whose results lie elsewhere, by name; only those whose file and results are still there."""
    try:
        entries = json.loads(_file().read_text(encoding="utf-8"))
        places = {name: Place(Path(source), Path(folder)) for name, (source, folder) in entries.items()}
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):
        return {}
    return {name: place for name, place in places.items() if place.source.is_file() and place.folder.is_dir()}


def remember(name: str, source: Path, folder: Path) -> str | None:
    """Note a study whose results lie elsewhere; a warning where the state folder cannot be written."""
    from pipeline.records.store import StoreError, write_atomic

    if folder.parent == paths.RESULTS and _is_ours(source):
        return None
    entries = known() | {name: Place(source.resolve(), folder.resolve())}
    text = json.dumps({key: [str(part) for part in place] for key, place in sorted(entries.items())}, indent=1)
    try:
        _file().parent.mkdir(parents=True, exist_ok=True)
        write_atomic(_file(), f"{text}\n".encode())
    except (OSError, StoreError) as error:
        return f"{_file()}: {reason(error)}: the study {name!r} is found by its file only, not by its name"
    return None


def _file() -> Path:
    return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "antinode" / "studies.json"
