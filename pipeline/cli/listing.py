"""`antinode list`, `materials` and `glossary`: what is stored, what is known, what a word means."""

from __future__ import annotations

from argparse import Namespace
from collections import Counter
from typing import Any


def add(commands: Any, command: Any) -> None:
    """The options of the three commands."""
    stored = command(commands, "list", "studies with stored results", "list", "pipeline.cli.listing:studies")
    stored.add_argument("--json", metavar="FILE|-", help="write the list as JSON; - for standard output, alone")
    known = command(
        commands, "materials", "the materials and their constants", "materials", "pipeline.cli.listing:materials"
    )
    known.add_argument("--json", metavar="FILE|-", help="write the list as JSON; - for standard output, alone")
    words = command(
        commands, "glossary", "what a word means here", "glossary strength", "pipeline.cli.listing:glossary"
    )
    words.add_argument("word", nargs="?", metavar="WORD", help="a word (default: all of them)")


def studies(arguments: Namespace) -> int:
    """List the studies under the results folder with their cases by status."""
    from pipeline import paths
    from pipeline.records import outputs, store
    from pipeline.records.study import read_study

    rows = []
    for folder in sorted(place for place in paths.RESULTS.glob("*") if place.is_dir() and place.name != "reference"):
        try:
            cases = read_study(folder).cases
        except (store.StoreError, OSError):
            continue
        counts = Counter(case.record.status for case in cases)
        report = str(folder / "report.html") if (folder / "report.html").is_file() else None
        rows.append([folder.name, len(cases), *(counts[key] for key in ("OK", "WARNING", "FAILED")), report])
    head = ("study", "cases", "ok", "warnings", "failed", "report")
    document = {"studies": [dict(zip(head, row, strict=True)) for row in rows]}
    outputs.emit(
        arguments, "list", document, outputs.table(head, rows) if rows else f"no stored study in {paths.RESULTS}"
    )
    return 0


def materials(arguments: Namespace) -> int:
    """List the isotropic materials with constants and sources."""
    from geometry.materials import MATERIALS
    from pipeline.records import outputs

    head = ("name", "young_GPa", "density_kg_m3", "poisson", "source")
    rows = [[m.name, m.young_pa / 1e9, m.density_kg_m3, m.poisson, m.source] for m in MATERIALS.values()]
    document = {"materials": [dict(zip(head, row, strict=True)) for row in rows]}
    outputs.emit(arguments, "materials", document, outputs.table(head, rows))
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
            entries[cells[0]] = cells[1]
    chosen = {
        words: text for words, text in entries.items() if arguments.word is None or _is_named(arguments.word, words)
    }
    if not chosen:
        known = [name.strip() for words in entries for name in words.split(",")]
        raise InputError(f"{arguments.word}: not in the glossary{nearest(arguments.word, known)}")
    for words, text in chosen.items():
        print(f"{words}: {text}")
    return 0


def _is_named(word: str, words: str) -> bool:
    return word.lower() in {name.strip().lower() for name in words.split(",")}
