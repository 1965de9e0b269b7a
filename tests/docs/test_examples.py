"""The checked figures of the examples: its command in an empty folder, against an independent value within both bars."""

from __future__ import annotations

import csv
import json
import re
import runpy
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline import paths
from pipeline.cli import main

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs" / "site"))
try:
    import pictures
finally:
    sys.path.remove(str(ROOT / "docs" / "site"))

CASES = sorted(path for path in (ROOT / "examples").iterdir() if path.suffix in (".toml", ".py"))
NOT_EXAMPLES = {
    "small.toml": "the plate of tests and tutorials",
    "materials.toml": "shown by docs/how-to",
    "housing.py": "writes housing.step of 31-housing.toml",
}
CHECKED = [each for each in pictures.examples() if each.figure is not None]
SHARPEST = 0.05  # a wider tolerance would let a wrong figure pass


def agrees(figure: pictures.Figure, document: dict) -> bool:
    """Whether the figure of a document meets its independent value within the bars of both."""
    bar = pictures.number(document, figure.bar) if figure.bar else 0.0
    found = pictures.number(document, figure.of) / (pictures.number(document, figure.over) if figure.over else 1.0)
    tolerance = abs(found) * bar + abs(figure.value) * figure.error
    assert tolerance < SHARPEST * abs(figure.value), f"{figure.of}: no check within {tolerance:.3g}"
    return abs(found - figure.value) <= tolerance


@pytest.mark.parametrize(
    "example",
    [pytest.param(e, id=e.name, marks=[] if e.figure.quick else [pytest.mark.slow]) for e in CHECKED],
)
@pytest.mark.filterwarnings("ignore::antinode.AntinodeWarning")
def test_an_example_meets_its_checked_figure(
    example: pictures.Example, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("examples", "studies"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(paths, "RESULTS", tmp_path / "results")
    program, *words = shlex.split(example.figure.command or example.command)
    if program == "python":
        assert agrees(example.figure, runpy.run_path(words[0]))
        return
    if words[0] == "run":
        assert main.main([*words, "--quiet"]) == 0
        (table,) = (tmp_path / "results").glob("*/table.csv")
        with table.open(newline="") as file:
            assert agrees(example.figure, list(csv.DictReader(file)))
        return
    assert main.main([*words, "--quiet", "--json", "figure.json"]) == 0
    assert agrees(example.figure, json.loads(Path("figure.json").read_text()))


def test_a_figure_off_by_more_than_both_bars_is_seen() -> None:
    figure = pictures.Figure("points.X.f.0", 100.0, 0.001, "theory", bar="points.X.e.0")
    for found, holds in ((100.2, True), (99.8, True), (100.4, False), (99.6, False)):
        assert agrees(figure, {"points": [{"label": "G"}, {"label": "X", "f": [found], "e": [0.002]}]}) is holds
    with pytest.raises(AssertionError, match="no check within"):
        agrees(figure, {"points": [{"label": "X", "f": [100.0], "e": [0.06]}]})


def test_every_example_has_a_number_of_its_own_and_forty_lines_at_most() -> None:
    numbered = [path.name for path in CASES if path.name not in NOT_EXAMPLES]
    assert all(re.fullmatch(r"\d\d-[a-z0-9]+(-[a-z0-9]+)*\.(toml|py)", name) for name in numbered)
    assert len({name[:2] for name in numbered}) == len(numbered) >= 30
    listed = pictures.examples()
    assert [each.name for each in listed] == [Path(name).stem for name in sorted(numbered)]
    assert all((ROOT / each.path).is_file() and each.name in each.command for each in listed)
    assert {path.name: lines for path in CASES if (lines := len(path.read_text().splitlines())) > 40} == {}
    assert NOT_EXAMPLES.keys() <= {path.name for path in CASES}


def test_the_gallerys_page_is_written_from_its_list() -> None:
    assert pictures.PAGE.read_text() == "\n".join(pictures.gallery_page())


def test_no_page_or_source_names_an_example_that_is_not_there() -> None:
    """Except a misspelt name that a test wants refused, and earlier versions' names in the changelog."""
    listed = subprocess.run(["git", "grep", "-IhoE", "examples/[A-Za-z0-9_./-]*[a-z0-9]", "--", ":!CHANGELOG.md"],
                            cwd=ROOT, capture_output=True, text=True, check=True).stdout  # fmt: skip
    names = set(listed.split()) - {"examples/smal.toml"}
    assert len(names) > 20 and sorted(name for name in names if not (ROOT / name).exists()) == []


def test_some_checked_figures_are_quick() -> None:
    assert sum(each.figure.quick for each in CHECKED) >= 6 and not all(each.figure.quick for each in CHECKED)
