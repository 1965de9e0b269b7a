"""`antinode list`, `materials`, `glossary` and `schema`: what is stored, what is known, what a word or a key means."""

from __future__ import annotations

import re
from argparse import Namespace
from collections import Counter
from collections.abc import Sequence
from typing import Any

from pipeline.questions.answer import Answer, emit
from pipeline.records.outputs import table
from pipeline.units import GPA


def studies(arguments: Namespace) -> int:
    """List the studies under the results folder with their cases by status."""
    from pipeline import paths
    from pipeline.batch import known
    from pipeline.records import store
    from pipeline.records.study import read_study

    rows = []
    ours = {place for place in paths.RESULTS.glob("*") if place.is_dir() and place.name != "reference"}
    for folder in sorted(ours | {place.folder for place in known.known().values()}):
        try:
            cases = read_study(folder).cases
        except (store.StoreError, OSError):
            continue
        counts = Counter(case.record.status for case in cases)
        report = str(folder / "report.html") if (folder / "report.html").is_file() else None
        rows.append([folder.name, len(cases), *(counts[key] for key in ("OK", "WARNING", "FAILED")), report])
    head = ("study", "cases", "ok", "warnings", "failed", "report")
    return _listed(arguments, "studies", head, rows, f"no stored study in {paths.RESULTS}")


def _listed(
    arguments: Namespace, name: str, head: Sequence[str], rows: Sequence[Sequence[Any]], nothing: str = ""
) -> int:
    """Rows as a table, and as objects under a name."""
    document = {name: [dict(zip(head, row, strict=True)) for row in rows]}
    return emit(arguments, name, Answer(document, [table(head, rows) if rows else nothing], head, rows))


def materials(arguments: Namespace) -> int:
    """List the isotropic materials with constants and sources."""
    from geometry.materials import MATERIALS

    head = ("name", "young_GPa", "density_kg_m3", "poisson", "source")
    rows = [[m.name, m.young_pa / GPA, m.density_kg_m3, m.poisson, m.source] for m in MATERIALS.values()]
    return _listed(arguments, "materials", head, rows)


def schema(arguments: Namespace) -> int:
    """Print the case file's JSON Schema."""
    import json

    from pipeline.case.schema import json_schema

    print(json.dumps(json_schema(), indent=1))
    return 0


def glossary(arguments: Namespace) -> int:
    """Print the meaning of a word of docs/glossary.md, or of all."""
    from pipeline.case.diagnostics import nearest
    from pipeline.errors import InputError
    from pipeline.paths import ROOT

    entries = {}
    for line in (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split(" | ")]
        if line.startswith("| ") and len(cells) == 2 and cells[0] != "word":
            entries[cells[0]] = re.sub(r" ?\[[^]]*\]\([^)]*\)\.?", "", cells[1])  # links lead nowhere in a terminal
    names = {words: [name.strip() for name in words.split(",")] for words in entries}
    wanted = arguments.word and arguments.word.lower()
    chosen = {
        words: text for words, text in entries.items() if wanted is None or wanted in map(str.lower, names[words])
    }
    if not chosen:
        known = [name for each in names.values() for name in each]
        raise InputError(f"{arguments.word}: not in the glossary{nearest(arguments.word, known)}")
    for words, text in chosen.items():
        print(f"{words}: {text}")
    return 0
