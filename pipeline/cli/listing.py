"""Lists of studies, materials, terms and keys (`list`, `materials`, `glossary`, `schema`), and checks (`doctor`)."""

from __future__ import annotations

import importlib.util
import json
import os
import platform
import re
import shutil
import sys
from argparse import Namespace
from collections import Counter
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from firmware.mode_table import MAX_BYTES, VERSION, TableError, describe, from_bytes
from geometry.materials import MATERIALS, law_of
from pipeline import paths
from pipeline.batch import study_file
from pipeline.case.reading import nearest
from pipeline.case.schema import json_schema
from pipeline.errors import InputError, reason
from pipeline.paths import ROOT
from pipeline.quantity import GIB, GPA
from pipeline.questions.command import Answer, emit
from pipeline.records import store
from pipeline.records.outputs import table
from pipeline.records.study import read_study

NEEDED = (
    *("numpy", "scipy", "cadquery", "pytetwild", "pyvista", "meshio"),
    *("trimesh", "pydantic", "rich", "matplotlib", "jinja2"),
)
OPTIONAL = {
    "rslab": "a faster factorisation: pip install 'antinode[fast]'",
    "ziglang": "a compiler for the firmware: pip install 'antinode[firmware]'",
    "unicorn": "the emulated board: pip install 'antinode[firmware]'",
    "distributed": "studies on a cluster: pip install 'antinode[cluster]'",
}
TOOLS = {
    "arm-none-eabi-gcc": "optional: ziglang builds the firmware without it",
    "cc": "needed for the firmware's host tests",
    "ccx": "optional: CalculiX, an independent solver",
    "run_aster": "optional: Code_Aster, an independent solver",
}


def doctor(arguments: Namespace) -> int:
    """`antinode doctor` and `antinode doctor table FILE`."""
    if arguments.what == "table":
        return _table(arguments)
    findings = {
        "machine": _machine(),
        "packages": {name: _version(name) or "MISSING: run `make setup`" for name in NEEDED},
        "optional": {name: _version(name) or f"not installed (optional): {what}" for name, what in OPTIONAL.items()},
        "tools": {name: shutil.which(name) or f"not installed ({why})" for name, why in TOOLS.items()},
    }
    lines = []
    for group, entries in findings.items():
        lines += [group, *(f"   {name:14} {text}" for name, text in entries.items())]
    return emit(arguments, "doctor", Answer(findings, lines))


def _machine() -> dict[str, str]:
    from solvers.machine import factorisations

    entries = {
        "python": sys.version.split()[0],
        "system": f"{platform.system()} {platform.machine()}",
        "cores": str(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()),
        "factorisation": ", ".join(factorisations()),
    }
    if importlib.util.find_spec("psutil"):
        import psutil

        memory = psutil.virtual_memory()
        entries["memory"] = f"{memory.available / GIB:.1f} GiB free of {memory.total / GIB:.1f} GiB"
    return entries


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _table(arguments: Namespace) -> int:
    if not arguments.file:
        raise InputError("doctor table: FILE is missing: name a mode table, such as mode_table.bin")
    try:
        with Path(arguments.file).open("rb") as file:
            table = from_bytes(file.read(MAX_BYTES + 1))
    except (OSError, TableError) as error:
        raise InputError(f"{arguments.file}: {reason(error)}") from error
    document: dict[str, Any] = {"version": VERSION, "modes": len(table.modes), "target": table.target}
    document["frequencies_hz"] = [mode.frequency_hz for mode in table.modes]
    return emit(arguments, "table", Answer(document, [describe(table)]))


def studies(arguments: Namespace) -> int:
    """List the studies in the results folder with their cases by status."""
    rows = []
    ours = {place for place in paths.RESULTS.glob("*") if place.is_dir() and place.name != "reference"}
    for folder in sorted(ours | {place.folder for place in study_file.known_places().values()}):
        try:
            cases = read_study(folder).cases
        except (store.StoreError, OSError):
            continue
        counts = Counter(case.record.status for case in cases)
        report = str(folder / "report.html") if (folder / "report.html").is_file() else None
        rows.append([folder.name, len(cases), *(counts[key] for key in ("OK", "WARNING", "FAILED")), report])
    head = ("study", "cases", "ok", "warnings", "failed", "report")
    return _listed(
        arguments, "studies", head, rows, f"no stored study in {paths.RESULTS}; antinode run STUDY computes one"
    )


def _listed(
    arguments: Namespace, name: str, head: Sequence[str], rows: Sequence[Sequence[Any]], nothing: str = ""
) -> int:
    """Print rows as a table, or write them as JSON objects under a name."""
    document = {name: [dict(zip(head, row, strict=True)) for row in rows]}
    return emit(arguments, name, Answer(document, [table(head, rows) if rows else nothing], head, rows))


def materials(arguments: Namespace) -> int:
    """List the materials with their law, their constants (of an anisotropic law those of its average), loss and source."""
    head = ("name", "young_GPa", "density_kg_m3", "poisson", "law", "loss_factor", "source")
    rows = [
        [m.name, m.average.young_pa / GPA, m.density_kg_m3, m.average.poisson, law_of(m.name), m.loss_factor, m.source]
        for m in MATERIALS.values()
    ]
    return _listed(arguments, "materials", head, rows)


def schema(arguments: Namespace) -> int:
    """Print the case file's JSON Schema."""
    print(json.dumps(json_schema(), indent=1))
    return 0


def glossary(arguments: Namespace) -> int:
    """Print the definition of a term of docs/glossary.md, or of all."""
    entries = {}
    for line in (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split(" | ")]
        if line.startswith("| ") and len(cells) == 2 and cells[0] != "word":
            entries[cells[0]] = re.sub(r" ?\[[^]]*\]\([^)]*\)\.?", "", cells[1])  # a terminal cannot follow links
    names = {words: [name.strip() for name in words.split(",")] for words in entries}
    word = arguments.word and arguments.word.lower()
    chosen = {words: text for words, text in entries.items() if word is None or word in map(str.lower, names[words])}
    if not chosen:
        known = [name for each in names.values() for name in each]
        raise InputError(f"{arguments.word}: not in the glossary{nearest(arguments.word, known)}")
    for words, text in chosen.items():
        print(f"{words}: {text}")
    return 0
