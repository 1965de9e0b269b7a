"""Figures have the digits of their bars: no source outside `pipeline.quantity` fixes the digits of what was computed."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PLACES = ("antinode", "pipeline")
MAYBE = re.compile(r"\.(\d+|\{[^{}]*\})[efg%]")
FORMAT = re.compile(r"^[+ z,\d]*\.\d+[efg%]$|\{[a-z_\d.\[\]]*:[+ z,]*\.\d+[efg%]\}|%\+?\.\d+[efg]")
IN_TEMPLATES = re.compile(r"\.\d+[efg%]\"|toFixed|toPrecision")
FREE = {  # files, and why digits are fixed there
    "pipeline/quantity.py": "the rule itself",
    "pipeline/explore/page/figures.js": "the same rule in the browser",
    "pipeline/batch/runner.py": "times of this run",
    "pipeline/logs.py": "times of this run",
    "pipeline/planning/resources.py": "memory and time of this machine",
    "pipeline/cli/listing.py": "memory of this machine",
    "pipeline/report/templates/study.html.j2": "times of this run",
    "pipeline/case/reading.py": "what was given",
    "pipeline/explore/answer.py": "a length that follows from a given one",
    "pipeline/explore/page/worker.js": "a length that follows from a given one",
    "pipeline/explore/page/model.js": "keys of tables and limits of what is given",
    "pipeline/explore/page/explore.js": "ticks and places of a drawing",
    "pipeline/report/gallery.py": "places of a drawing",
    "pipeline/report/shapes.py": "places of a drawing; a group speed has no bar",
    "pipeline/report/templates/dispersion.js": "ticks and places of a drawing, wavevectors as given",
    "pipeline/report/templates/shapes.js": "how far a drawing exaggerates",
    "pipeline/plots/rendering.py": "how far a drawing exaggerates",
    "pipeline/report/html.py": "values of a script, which alone knows their bars",
    "pipeline/records/tables.py": "ten digits of a file, far below any bar",
    "pipeline/exchange/finite_elements.py": "a file of another program",
    "pipeline/exchange/exports.py": "files of other programs",
    "pipeline/measured/synthetic.py": "a file of made-up measurements",
}


def fixed_in(source: str) -> set[int]:
    """Lines in which a format of Python's, wherever it stands, fixes the digits of a number."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.JoinedStr):  # of f"{value:.{digits}g}" the format
            spec = "".join(part.value if isinstance(part, ast.Constant) else "0" for part in node.values)
        else:
            spec = node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""
        if FORMAT.search(spec):
            found.add(node.lineno)  # type: ignore[attr-defined]
    return found


def offending(path: Path) -> set[int]:
    """Lines of a source that fix digits."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        return fixed_in(text) if MAYBE.search(text) else set()
    return {number for number, line in enumerate(text.splitlines(), 1) if IN_TEMPLATES.search(line)}


def sources() -> list[Path]:
    """Python, and the pages' templates and scripts, not what others wrote."""
    kinds = (".py", ".js", ".j2", ".html")
    found = (path for place in PLACES for path in (ROOT / place).rglob("*") if path.suffix in kinds)
    return sorted(path for path in found if "vendor" not in path.parts and "exchange/templates" not in path.as_posix())


def test_no_source_fixes_the_digits_of_a_computed_figure() -> None:
    """Write it by `pipeline.quantity`: figure, frequency, level, percentage, percent."""
    found = {path.relative_to(ROOT).as_posix(): offending(path) for path in sources()}
    assert {name: lines for name, lines in found.items() if lines and name not in FREE} == {}
    assert [name for name in FREE if not found.get(name)] == []


@pytest.mark.parametrize(
    "source",
    [
        'f"{level:.1f} dB"', 'f"{share:+.2%}"', 'f"{value:.{digits}g}"', 'f"{seconds:7.2f}"', 'format(mac, ".3f")',
        '"{:.1f} rad/m".format(k)', '"%.2f" % level', 'Column("mac", ".4f")', 'f"{part:z.1f}"',
    ],
)  # fmt: skip
def test_fixed_digits_are_found(source: str) -> None:
    assert fixed_in(source) == {1}


@pytest.mark.parametrize("source", ['f"{length:g} mm"', 'f"{count:,}"', 'f"{figure(level, bar)} dB"', '"1.5 mm"'])
def test_what_was_given_and_what_has_a_bar_is_not(source: str) -> None:
    assert not fixed_in(source)
