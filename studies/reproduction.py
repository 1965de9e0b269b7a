"""docs/thesis-reproduction.md: every figure of the thesis beside ours, `python -m studies.reproduction [--results DIR]`.

Plates and cells come from stored studies (`antinode run NAME` for each of STUDIES), the lone pillars and chapters 1 and 3 are
computed here. A study that was not run is named in the page instead of its figures.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from geometry.hex.boxes import hex_mesh, pillar_boxes
from pipeline.case.model import load_case
from pipeline.paths import RESULTS
from pipeline.planning import mesh_rules
from pipeline.records import outputs
from pipeline.records.record import Record
from pipeline.records.store import BadRecord, write_atomic
from pipeline.records.study import read_study
from pipeline.report.thesis import compare
from solvers.analytic.predesign import pillar_frequencies_hz
from solvers.fem.eigen import modes_near
from solvers.fem.solid import SolidModel
from studies import ladder

PAGE = Path(__file__).resolve().parents[1] / "docs" / "thesis-reproduction.md"
STUDIES = ("rows", "extension", "periodicity", "prototype", "height", "cell")
ACTIVE = ("mason", "pillar", "beam", "shaping", "dq")
PILLARS_MM = {7.1: 32.0, 6.5: 35.0, 6.3: 38.0}
NEAR = 0.02
INTRODUCTION = """# The thesis' figures, and ours

Written by `python -m studies.reproduction` from the stored studies ({studies}) and the models of `antinode active`.
Ours come from meshes whose error is known (`docs/verification.md`), and none was tuned towards the thesis; where its
formulas are not what is built here, `docs/thesis-errata.md` has the derivation. "agrees" means within {near:.0%}, or the
same verdict; the models of `antinode active` judge by the digits that the text gives.
"""
HEADINGS = ("quantity", "thesis", "ours", "verdict")

Row = tuple[str, str, str, str]


def plates(folder: Path) -> tuple[list[Row], list[str]]:
    """Figures that the studies' records answer, and the studies that are not stored."""
    records: list[Record] = []
    missing = []
    for name in STUDIES:
        try:
            records += [case.record for case in read_study(folder / name).cases]
        except BadRecord:
            missing.append(name)
    return [_row(entry) for entry in compare(records)], missing


def _row(entry: dict[str, Any]) -> Row:
    words = f" {entry['unit']}" if entry["unit"] else ""
    verdict = verdict_of(entry["thesis"], entry["ours"])
    if entry["note"] and verdict != "agrees":
        verdict += f": {entry['note']}"
    return entry["quantity"], f"{entry['thesis']}{words}", f"{entry['ours']}{words}", verdict


def verdict_of(thesis: Any, ours: Any) -> str:
    """Agreement of two figures, or of two verdicts by their first word."""
    if isinstance(thesis, str) or isinstance(ours, str):
        return "agrees" if str(thesis).split()[0] == str(ours).split()[0] else "differs"
    change = ours / thesis - 1.0
    return "agrees" if abs(change) <= NEAR else f"differs by {change:+.1%}"


def pillars() -> list[Row]:
    """The lone pillar of three lengths, foot clamped, in three dimensions; the longest by beam theory too."""
    case = load_case(Path(__file__).parent / "three-rows.toml", [])
    rows: list[Row] = []
    assert case.design.pillar
    for height_mm, thesis_khz in PILLARS_MM.items():
        pillar = replace(case.design.pillar, height_m=1e-3 * height_mm)
        design = replace(case.design, pillar=pillar)
        settings = mesh_rules.pillar_mesh(design, mesh_rules.mesh_level("pillar", 1e-3))
        model = SolidModel(
            hex_mesh(pillar_boxes(pillar, settings), settings.order), ladder.materials(), ("touch",), True
        )
        ours = min(modes_near(model.pencil(symmetry), 0.0, 1).frequency_hz[0] for symmetry in model.symmetries) / 1e3
        if height_mm == max(PILLARS_MM):
            beam = float(pillar_frequencies_hz(pillar, "euler")[0]) / 1e3
            words = f"{beam:.2f} kHz by beam theory, {ours:.2f} in three dimensions"
            rows.append(
                (f"pillar {height_mm} mm, analytic", f"{thesis_khz:g} kHz", words, verdict_of(thesis_khz, beam))
            )
        else:
            words = f"{ours:.2f} kHz"
            rows.append(
                (f"pillar {height_mm} mm, foot clamped", f"{thesis_khz:g} kHz", words, verdict_of(thesis_khz, ours))
            )
    return rows


def active(model: str) -> list[Row]:
    """The entries of one model of chapters 1 and 3, from the command itself."""
    command = [sys.executable, "-m", "pipeline.cli.main", "active", model, "--json", "-", "--quiet"]
    documents = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return [(e["quantity"], e["thesis"], e["ours"], e["agreement"]) for e in documents["comparison"]]


def table(rows: list[Row]) -> str:
    """A table in Markdown."""
    return outputs.markdown(HEADINGS, rows)


def text(folder: Path) -> str:
    """The page."""
    documents, missing = plates(folder)
    page = INTRODUCTION.format(studies=", ".join(STUDIES), near=NEAR)
    page += "\n## Zone, pillars, cell and plates (chapter 2)\n\n" + table([*pillars(), *documents])
    if missing:
        page += f"\nNot stored, hence not compared: {', '.join(missing)} (`antinode run NAME`).\n"
    chapters = {"mason": "circuit (chapter 1)", "pillar": "one pillar on a beam (chapter 3)"}
    chapters |= {"beam": "active beam (chapter 3)", "shaping": "shaping (chapter 3)", "dq": "closed loop (chapter 2)"}
    for model in ACTIVE:
        page += f"\n## `antinode active {model}`: {chapters[model]}\n\n" + table(active(model))
    return page


def main() -> int:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--results", type=Path, default=RESULTS, metavar="DIR")
    write_atomic(PAGE, text(parser.parse_args().results).encode())
    print(f"reproduction {PAGE}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
