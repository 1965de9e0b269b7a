"""Every command and every Python of the README and the docs, and every example script, run as a reader would run them."""

from __future__ import annotations

import ast
import io
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

import antinode
from pipeline.case.model import load_case
from pipeline.cli import main

ROOT = Path(__file__).resolve().parents[2]
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
SCRIPTS = sorted((ROOT / "examples").glob("*.py"))
QUICK = ("09-print-file", "42-amplitude-loop", "housing")
BLOCK = re.compile(r"```(\w*)\n(.*?)```", re.DOTALL)
INLINE = re.compile(r"`(antinode [^`]+)`")
HELP = "commands.md"  # wrapped lines of help
UNFINISHED = ("arguments are required", "expected one argument")  # what an inline command may leave out
ABBREVIATED = re.compile(r"COMMAND|NAME --jobs N|>|…|\.\.\.")
PROGRAMS = (["python", "-c"], ["python", "-m"], ["jupyter", "execute"], ["make", "setup"])
SHOWN = re.compile(
    r"```sh\n([^`]*\n)?([^`\n]+)\n```\n\n```text\n(.*?)```", re.DOTALL
)  # the last command and what it prints
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
CLOSE = {"rel": 0.01, "abs": 0.1}  # what another machine's rounding, libraries and choices of mesh leave the same
LONGEST_S = 900.0  # of a command, on cores that others use, too
NEEDS_A_CLUSTER = "cluster"  # its Python starts jobs under Slurm


def blocks(page: Path, language: str) -> list[str]:
    """The blocks of code of a page in a language."""
    return [text for kind, text in BLOCK.findall(page.read_text()) if kind == language]


def commands(page: Path) -> list[str]:
    """The lines of a page's shell blocks."""
    return [line for block in blocks(page, "sh") for line in block.splitlines() if line.strip()]


def shell(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A line run in a folder that holds the examples, with this environment's commands first."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = os.environ | {"PATH": path, "PYTHONPATH": str(ROOT)}
    environment |= {"ANTINODE_RESULTS": str(folder / "results"), "OMP_NUM_THREADS": "1"}
    return subprocess.run(
        line, shell=True, cwd=folder, env=environment, capture_output=True, text=True, timeout=LONGEST_S
    )


def share_cells(results: Path) -> None:
    """Take reduced cells from the repository's cache, which the examples fill, too: pages and examples have them in common."""
    for folder in (results, ROOT / "results" / ".cells"):
        folder.mkdir(exist_ok=True)
    (results / ".cells").symlink_to(ROOT / "results" / ".cells")


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


PAGES = [
    pytest.param(page, id=page.stem)
    for page in DOCUMENTS
    if commands(page) and page.name != "gallery.md"  # whose commands are those of its pictures and checked figures
]


def files() -> set[Path]:
    """What stands in the repository and its examples, but for the caches of type checkers that other tests run beside."""
    return {path for folder in (ROOT, ROOT / "examples") for path in folder.glob("*") if not path.match("*_cache")}


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_a_tutorial_runs(page: Path, tmp_path: Path) -> None:
    for name in ("examples", "studies"):
        shutil.copytree(ROOT / name, tmp_path / name)
    share_cells(tmp_path / "results")
    before = files()
    listings = {line: text for _, line, text in SHOWN.findall(page.read_text())}
    for line in commands(page):
        if line.startswith("make"):
            continue  # this environment
        ended = shell(line, tmp_path)
        assert ended.returncode == 0, f"{line}\n{ended.stdout[-800:]}\n{ended.stderr[-1500:]}"
        assert shows(listings.get(line, ""), ended.stdout), f"{line}\n{ended.stdout}"
    for number, block in enumerate(blocks(page, "python") if page.stem != NEEDS_A_CLUSTER else []):
        script = tmp_path / f"block{number}.py"
        script.write_text(block)
        ended = shell(f'"{sys.executable}" "{script}"', tmp_path)
        assert ended.returncode == 0, f"{block}\n{ended.stderr[-1500:]}"
    assert files() == before  # nothing is left behind


@pytest.mark.parametrize("page", DOCUMENTS, ids=lambda page: page.stem)
def test_every_command_shown_is_one_that_there_is(page: Path) -> None:
    """Its options too, and the case files that it names: quicker than running them."""
    listed = [] if page.name == HELP else [line for block in blocks(page, "text") for line in block.splitlines()]
    shown = commands(page) + [line for line in listed if line.startswith("antinode ")]
    for words in (shlex.split(line, comments=True) for line in shown):
        if words[0] == "antinode":
            assert understood(words) == "", words
            named = [word for word in words if re.match(r"(examples|studies)/[\w./-]+$", word)]
            assert all((ROOT / word).is_file() for word in named), words
        else:
            assert words[:2] in PROGRAMS or (words[0] == "python" and (ROOT / words[1]).is_file()), words
    for line in INLINE.findall(BLOCK.sub("", page.read_text())):
        fault = "" if ABBREVIATED.search(line) else understood(shlex.split(line))
        assert not fault or any(each in fault for each in UNFINISHED), f"{line}: {fault}"


def understood(words: list[str]) -> str:
    """What the command line's own parser says against words; empty if it takes them."""
    said = io.StringIO()
    try:
        with redirect_stderr(said), redirect_stdout(io.StringIO()):
            main._parser().parse_args(words[1:])
    except SystemExit as ended:
        return said.getvalue() if ended.code else ""
    return ""


def test_a_wrong_command_is_seen() -> None:
    for line in ("antinode mods a.toml", "antinode modes a.toml --plott b.svg", "antinode modes a.toml --part lid"):
        assert understood(line.split()) and not any(each in understood(line.split()) for each in UNFINISHED)


def test_every_table_of_a_case_file_shown_is_an_excerpt_of_a_case_that_there_is() -> None:
    """Line for line."""
    assert len(excerpts()) > 10 and [block for block, whole in excerpts().items() if whole is None] == []


@pytest.mark.slow
def test_the_cases_of_which_excerpts_are_shown_are_accepted() -> None:
    for whole in {*excerpts().values()}:
        load_case(whole)


def excerpts() -> dict[str, Path | None]:
    """The tables shown, each with the case file that has these lines."""
    cases = {path: path.read_text() for folder in ("examples", "studies") for path in (ROOT / folder).rglob("*.toml")}
    shown = [block for page in DOCUMENTS for block in blocks(page, "toml")]
    return {
        block: next((path for path, text in cases.items() if f"\n{block}" in f"\n{text}\n"), None) for block in shown
    }


def test_python_shown_compiles_and_names_what_there_is() -> None:
    sources = [block for page in DOCUMENTS for block in blocks(page, "python")]
    nodes = [node for source in sources for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Attribute)]
    named = {node.attr for node in nodes if isinstance(node.value, ast.Name) and node.value.id == "antinode"}
    assert named and not [name for name in named if not hasattr(antinode, name)]


@pytest.mark.slow
def test_python_shown_has_the_types_that_a_checker_sees(tmp_path: Path) -> None:
    """Every name, method and keyword: misspelt ones are errors to mypy."""
    sources = [block for page in DOCUMENTS if page.stem != NEEDS_A_CLUSTER for block in blocks(page, "python")]
    assert len(sources) >= 2
    for name, source in {f"block{n}": text for n, text in enumerate(sources)}.items():
        (tmp_path / f"{name}.py").write_text(source)
    (tmp_path / "wrong.py").write_text(sources[0].replace(".bands()", ".band()"))
    words = ["-m", "mypy", "--config-file=", "--follow-imports=silent", "--ignore-missing-imports", "."]
    environment = os.environ | {"MYPYPATH": str(ROOT)}
    ended = subprocess.run([sys.executable, *words], cwd=tmp_path, env=environment, capture_output=True, text=True)
    errors = [line for line in ended.stdout.splitlines() if ": error:" in line]
    assert errors and all(line.startswith("wrong.py") for line in errors), ended.stdout


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
