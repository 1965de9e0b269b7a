"""Every command of the tutorials and how-to pages, and every example script, run as a reader would run them."""

from __future__ import annotations

import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.cli import main

ROOT = Path(__file__).resolve().parents[2]
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
OTHERS = [ROOT / "docs" / "start.md", *sorted((ROOT / "docs" / "how-to").glob("*.md"))]
SCRIPTS = sorted((ROOT / "examples").glob("*.py"))
QUICK = ("09-print-file", "42-amplitude-loop", "housing")
BLOCK = re.compile(r"```sh\n(.*?)```", re.DOTALL)
PYTHON = re.compile(r"```python\n(.*?)```", re.DOTALL)
SHOWN = re.compile(
    r"```sh\n([^`]*\n)?([^`\n]+)\n```\n\n```text\n(.*?)```", re.DOTALL
)  # the last command and what it prints
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
CLOSE = {"rel": 0.01, "abs": 0.1}  # what another machine's rounding, libraries and choices of mesh leave the same
LONGEST_S = 900.0  # of a command, on cores that others use, too
NEEDS_A_CLUSTER = "cluster"  # its Python starts jobs under Slurm


def commands(page: Path) -> list[str]:
    """The lines of a page's shell blocks."""
    return [line for block in BLOCK.findall(page.read_text()) for line in block.splitlines() if line.strip()]


def shell(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A line run in a folder that holds the examples, with this environment's commands first."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = os.environ | {"PATH": path, "PYTHONPATH": str(ROOT)}
    environment |= {"ANTINODE_RESULTS": str(folder / "results"), "OMP_NUM_THREADS": "1"}
    return subprocess.run(
        line, shell=True, cwd=folder, env=environment, capture_output=True, text=True, timeout=LONGEST_S
    )


def shows(listing: str, printed: str) -> bool:
    """Whether a page's lines are among those printed, in their order: words alike, numbers close; `...` leaves lines out."""
    lines = iter(printed.splitlines())
    return all(any(alike(line, each) for each in lines) for line in listing.splitlines() if line != "...")


def alike(one: str, other: str) -> bool:
    """Whether two lines differ in blanks and in the last digits of their numbers alone."""
    words = [NUMBER.sub("#", line).split() for line in (one, other)]
    numbers = [[float(each) for each in NUMBER.findall(line)] for line in (one, other)]
    return words[0] == words[1] and numbers[0] == pytest.approx(numbers[1], **CLOSE)


def test_what_a_page_shows_is_compared_by_words_and_numbers() -> None:
    printed = "a table\n* 34.493  SS  0.9537\n  40.405  SS  -\nend"
    assert shows("*  34.49 SS 0.954\n...\nend", printed) and shows("", "")
    for wrong in ("* 35.5 SS 0.954", "34.493 SS 0.9537", "end\na table", "* 34.493 AS 0.9537", "new"):
        assert not shows(wrong, printed)


# half a minute to two minutes each
SLOW = {
    *(
        "finger",
        "how-many-rows",
        "own-pillar",
        "first-plate",
        "table-to-board",
        "own-measurement",
        "other-programs",
        "cluster",
    ),
    *("search-and-tolerance", "shaped-patches", "start", "notebooks", "own-mesh", "materials"),
}
PAGES = [
    pytest.param(page, id=page.stem, marks=[pytest.mark.slow] if page.stem in SLOW else [])
    for page in [*TUTORIALS, *OTHERS]
    if commands(page)
]


def files() -> set[Path]:
    """What stands in the repository and its examples, but for the caches of type checkers that other tests run beside."""
    return {path for folder in (ROOT, ROOT / "examples") for path in folder.glob("*") if not path.match("*_cache")}


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_a_tutorial_runs(page: Path, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    before = files()
    listings = {line: text for _, line, text in SHOWN.findall(page.read_text())}
    for line in commands(page):
        ended = shell(line, tmp_path)
        assert ended.returncode == 0, f"{line}\n{ended.stdout[-800:]}\n{ended.stderr[-1500:]}"
        assert shows(listings.get(line, ""), ended.stdout), f"{line}\n{ended.stdout}"
    for number, block in enumerate(PYTHON.findall(page.read_text()) if page.stem != NEEDS_A_CLUSTER else []):
        script = tmp_path / f"block{number}.py"
        script.write_text(block)
        ended = shell(f'"{sys.executable}" "{script}"', tmp_path)
        assert ended.returncode == 0, f"{block}\n{ended.stderr[-1500:]}"
    assert files() == before  # nothing is left behind


@pytest.mark.parametrize("page", [page for page in [*TUTORIALS, *OTHERS] if commands(page)], ids=lambda page: page.stem)
def test_every_command_of_a_tutorial_is_one_that_there_is(page: Path) -> None:
    """Its options too, and the case files that it names: quicker than running them."""
    for words in (shlex.split(line) for line in commands(page)):
        if words[0] == "antinode":
            assert main._parser().parse_args(words[1:]).command == words[1]
            assert all((ROOT / word).is_file() for word in words if word.startswith("examples/"))
        else:
            assert words[:2] in (["python", "-c"], ["python", "-m"], ["jupyter", "execute"])


@pytest.mark.slow
def test_the_first_page_answers_on_coarse_plates(
    coarsest_here: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its commands in this process, one after the other in one folder; `make test-all` runs every page as a reader does."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    for words in map(shlex.split, commands(ROOT / "docs" / "start.md")):
        assert main.main(words[1:]) == 0, words
    assert {path.name for path in tmp_path.glob("*.svg")} == {"bands.svg", "modes.svg"}


@pytest.mark.parametrize(
    "script",
    [pytest.param(s, id=s.stem, marks=[] if s.stem in QUICK else [pytest.mark.slow]) for s in SCRIPTS],
)
def test_an_example_answers_on_a_coarse_plate(
    script: Path, coarsest_here: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(script), run_name="__main__")
    assert capsys.readouterr().out.strip()


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_an_example_runs(script: Path, tmp_path: Path) -> None:
    ended = shell(f'"{sys.executable}" "{script}"', tmp_path)
    assert ended.returncode == 0, ended.stderr[-1500:]
    assert ended.stdout.strip()


def test_every_tutorial_is_listed_and_every_link_leads_somewhere() -> None:
    index = (ROOT / "docs" / "tutorials" / "README.md").read_text()
    for page in TUTORIALS:
        assert page.name == "README.md" or f"({page.name})" in index
        for link in re.findall(r"\]\(([^)#:]+)\)", page.read_text()):
            made = "pictures/gallery" in link  # by the site's build, whose own test knows what it makes
            assert made or (page.parent / link).exists(), f"{page.name}: {link}"
