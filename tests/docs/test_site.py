"""The documentation site's structure; `make docs` builds it whole and fails on dead links and on undocumented names."""

from __future__ import annotations

import ast
import json
import os
import re
import shlex
import sys
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from PIL import Image

import antinode
from pipeline import paths
from pipeline.cli import view
from pipeline.cli.main import _parser, main
from pipeline.questions import registered
from pipeline.report.text import band_of_rows
from tests.helpers import site_fields

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(page for page in DOCS.rglob("*.md") if "site" not in page.relative_to(DOCS).parts)
LINK = re.compile(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)")


@pytest.fixture(scope="module")
def site() -> Iterator[dict[str, ModuleType]]:
    sys.path.insert(0, str(DOCS / "site"))
    try:
        import make_site
        import pictures
        import reference

        yield {"build": make_site, "pictures": pictures, "reference": reference}
    finally:
        sys.path.remove(str(DOCS / "site"))


def test_every_page_is_listed_under_its_title_where_a_reader_of_the_repository_sees_it() -> None:
    """And the site's tables of contents are made from these lists."""
    listed = {"index.md"}
    for page in (each for each in PAGES if each.name == "index.md"):
        for title, link in re.findall(r"^\* \[(.*)\]\((.*)\)$", page.read_text(), re.MULTILINE):
            place = (page.parent / link).resolve()
            assert re.match(r"#+ (.*)", place.read_text())[1] == title
            listed.add(os.path.relpath(place, DOCS))
    assert listed == {page.relative_to(DOCS).as_posix() for page in PAGES} | {"../CHANGELOG.md"}
    assert not [page.name for page in PAGES if "{toctree}" in page.read_text()]


def test_lists_of_links_become_the_sites_tables_of_contents(site: dict[str, ModuleType]) -> None:
    page = "# Site\n\nA [word](no.md).\n\n## All pages\n\n### How to\n\n* [One](one.md)\n* [Two](a/two.md)\n"
    assert list(site["build"]._contents(page)) == [
        "```{toctree}",
        ":hidden:",
        ":caption: How to",
        "",
        "one",
        "a/two",
        "```",
        "",
    ]
    assert list(site["build"]._contents("# Decisions\n\n* [One](0001.md)\n"))[:4] == [
        "```{toctree}",
        ":hidden:",
        "",
        "0001",
    ]
    assert site["build"]._within("* [Changelog](../../CHANGELOG.md)", Path("a")) == "* [Changelog](../changelog.md)"


def test_every_relative_link_leads_somewhere_in_the_repository_and_no_page_waits_for_the_build() -> None:
    assert not [
        page.name for page in PAGES if re.search("completes this page|The site (lists|prints)", page.read_text())
    ]
    wrong = [
        f"{page.relative_to(DOCS)}: {link}"
        for page in PAGES
        for link in LINK.findall(page.read_text())
        if not (page.parent / link).exists()
    ]
    assert not wrong


def test_the_readme_is_short_begins_with_a_moving_plate_and_leads_somewhere() -> None:
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 120 and len(text.split()) <= 900
    assert "make study" in text and "make test" in text
    said = dict(re.findall(r"^## ([^\n]*)\n\n(.*?)(?=\n\n)", text, re.MULTILINE | re.DOTALL))
    assert len(re.findall(r"[.:](?=\s|$)", said["How good is a number?"])) == 3
    assert [line[:2] for line in said["What it cannot do"].splitlines()] == ["* "] * 5
    links = LINK.findall(text)
    assert [link for link in links if not (ROOT / link).exists()] == []
    with Image.open(ROOT / links[0]) as film:
        assert (film.n_frames, film.size) == (view.STEPS, view.SIZE)  # as `antinode view --off-screen` draws it
    assert (ROOT / links[0]).stat().st_size < 500_000


@pytest.mark.parametrize(
    "phrase, page",
    [
        ("triangular lattice", "explanation/confinement"),
        ("screw", "how-to/supports"),
        ("boundary conditions", "how-to/supports"),
    ],
)
def test_a_search_finds_the_page_of_a_phrase_by_a_heading(phrase: str, page: str) -> None:
    """The site's search lists a heading that contains the phrase and is at most twice as long."""
    headings = re.findall(r"^#+ (.*)$", (DOCS / f"{page}.md").read_text(), re.MULTILINE)
    assert [each for each in headings if phrase in each.lower() and len(each) <= 2 * len(phrase)]


@pytest.mark.slow
def test_the_home_page_and_the_thesis_page_show_the_reference_plate() -> None:
    plate = antinode.load(ROOT / "studies" / "three-rows.toml")
    target = plate.modes(symmetry=plate.case.target_symmetry).target
    peak = plate.response().target_peak
    low, high = band_of_rows(plate.attenuation(), target.frequency_hz)
    text = (DOCS / "index.md").read_text()
    assert re.findall(r"\*\*(.*?)\*\*<br>", text) == [
        f"{target.frequency_hz / 1e3:.2f} ± {target.frequency_hz * target.frequency_error / 1e3:.2f} kHz",
        f"{peak.confinement_db:.1f} ± {peak.confinement_error_db:.1f} dB",
        f"{peak.volts_per_um:.1f} ± {peak.volts_error_per_um:.1f} V",
        f"{low / 1e3:.1f} to {high / 1e3:.1f} kHz",
    ]
    assert f"{target.confinement_db:.1f} dB as a mode" in text
    row = re.search(r"^\| three rows, 25 mm.*$", (DOCS / "thesis-reproduction.md").read_text(), re.MULTILINE)
    shown = [float(each) for each in re.findall(r"([\d.]+) dB", row[0] if row else "")]
    assert np.allclose(shown[0], target.confinement_db, 0.0, target.confinement_error_db)
    assert np.allclose(shown[1], peak.confinement_db, 0.0, peak.confinement_error_db)


def test_the_gallery_has_thirty_examples_whose_commands_are_commands(site: dict[str, ModuleType]) -> None:
    examples = site["pictures"].examples()
    assert len(examples) >= 30 and len({each.name for each in examples}) == len(examples)
    for each in examples:
        program, *words = shlex.split(each.command)
        if program == "antinode":
            _parser().parse_args(words)  # SystemExit for what is no command
        else:
            assert program == "python" and (ROOT / words[0]).is_file()
        assert each.title and each.text.endswith(".")
    for each in site["pictures"].figure_examples():
        if each.command.startswith("antinode"):
            assert re.split(" --plot| --out", each.command)[0] in "".join(page.read_text() for page in PAGES), each.name
            continue
        assert f"def {each.name.replace('-', '_')}(" in (DOCS / "site" / "figures.py").read_text()


def test_every_key_of_a_case_file_has_a_meaning(site: dict[str, ModuleType], monkeypatch: pytest.MonkeyPatch) -> None:
    reference = site["reference"]
    assert reference.unexplained() == []
    known = reference.meanings()
    del known["array"]["rows"]
    monkeypatch.setattr(reference, "meanings", lambda: known | {"zone": known["zone"] | {"colour": "Its paint."}})
    assert reference.unexplained() == ["array.rows", "zone.colour"]


def test_every_field_of_a_json_document_has_a_meaning(
    site: dict[str, ModuleType], monkeypatch: pytest.MonkeyPatch
) -> None:
    reference = site["reference"]
    known = deepcopy(reference.field_meanings())
    del known["any"]["pillar"], known["SectionRecord"]["base_m"]
    monkeypatch.setattr(reference, "field_meanings", lambda: known | {"PeakRecord": {"colour": "Its paint."}})
    left = reference.unexplained()
    assert {"DesignRecord.pillar", "SectionRecord.base_m", "PeakRecord.colour"} <= set(left)


def test_documents_hold_what_their_page_says(
    site: dict[str, ModuleType], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of `active` are held in test_active, where they are made."""
    reference = site["reference"]
    small = str(ROOT / "examples" / "small.toml")
    monkeypatch.setattr(paths, "RESULTS", tmp_path)
    for words in (["predesign", small], ["compare", small, small], ["list"], ["materials"], ["doctor"]):
        assert main([*words, "--quiet", "--json", str(tmp_path / "d.json")]) == 0
        keys = set(json.loads((tmp_path / "d.json").read_text())) - site_fields.EVERY
        if words[0] in registered():
            assert keys == registered()[words[0]].result.declared.keys()
            continue
        fields = site_fields.documents()[words[0]]
        of = set(reference.parts()[fields["of"]].model_fields) if "of" in fields else set()
        assert keys == of | set(fields) - {"of"}, words[0]


def test_generated_pages_hold_what_they_are_made_from(site: dict[str, ModuleType]) -> None:
    text = {name: (DOCS / name).read_text() for name in site["reference"].PAGES}
    assert text == {name: site["reference"].completed(name) for name in text}, "run python docs/site/reference.py"
    assert "| `pitch_mm` |" in text["reference/case-file.md"] and "aluminium" not in text["reference/columns.md"]
    assert "| `confinement_db` |" in text["reference/columns.md"] and "| `tracked_hz` |" in text["reference/columns.md"]
    assert (
        "### ModeRecord" in text["reference/json.md"]
        and "| `strength` | share of the target shape" in text["reference/json.md"]
        and "### `antinode search --json FILE`" in text["reference/json.md"]
        and "### `antinode active dq --json FILE`" in text["reference/json.md"]
    )
    assert "## attenuation" in text["reference/commands.md"] and "--kx" in text["reference/commands.md"]
    assert "| `Plate.modes` | Compute the modes" in text["reference/library.md"]
    assert "antinode.sweep" in "".join(site["reference"].library()) and "@software{antinode" in text["cite.md"]
    assert all("PosixPath" not in page and str(ROOT) not in page for page in text.values())


@pytest.mark.slow  # `make docs` builds the same site; that job of continuous integration runs this one, too
def test_the_site_has_no_dead_link_and_no_public_name_without_its_words(
    site: dict[str, ModuleType], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Built whole as `make docs` does, with empty files where that makes pictures."""
    build, pictures = site["build"], site["pictures"]
    monkeypatch.setattr(build, "WORK", tmp_path)
    build.pages(tmp_path / "source", with_pictures=False)
    gallery = tmp_path / "source" / "pictures" / "gallery"
    gallery.mkdir(parents=True, exist_ok=True)
    for each in [*pictures.examples(), *pictures.figure_examples()]:
        (gallery / each.file).touch()
    assert build.build(tmp_path / "source", tmp_path / "site") == []


def test_links_that_leave_the_docs_keep_their_words(site: dict[str, ModuleType]) -> None:
    page = "[a](../../x.toml) and [b](../y.md#z), [c](https://d.e/../../f), ![g](../pictures/h.svg)"
    kept = "a and [b](../y.md#z), [c](https://d.e/../../f), ![g](../pictures/h.svg)"
    assert site["build"]._within(page, Path("how-to")) == kept


def test_a_dead_link_and_a_missing_name_are_faults(
    site: dict[str, ModuleType], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = tmp_path / "source"
    source.mkdir()
    monkeypatch.setattr(site["build"], "WORK", tmp_path)
    library = "```{eval-rst}\n.. autofunction:: antinode.load\n```"
    (source / "index.md").write_text(f"# Site\n\n{library}\n")
    faults = site["build"].build(source, tmp_path / "one")
    assert "antinode.sweep: public, and not on the library's page" in faults
    assert not [fault for fault in faults if "antinode.load:" in fault or "warnings" in fault]
    (source / "index.md").write_text(f"# Site\n\n[there](nowhere.md)\n\n{library}\n")
    assert any("1 warnings" in fault for fault in site["build"].build(source, tmp_path / "two"))


def test_every_variable_of_the_environment_is_listed() -> None:
    sources = [path.read_text() for name in ("antinode", "pipeline", "solvers") for path in (ROOT / name).rglob("*.py")]
    read = {name for text in sources for name in re.findall(r"ANTINODE_[A-Z_]+", text)}
    page = (DOCS / "reference" / "commands.md").read_text()
    assert read == set(re.findall(r"`(ANTINODE_[A-Z_]+)`", page)) and len(read) >= 4


def test_every_warning_is_explained() -> None:
    page, codes = (DOCS / "how-to" / "warnings.md").read_text(), set()
    for folder in ("antinode", "pipeline", "solvers", "studies"):
        for path in (ROOT / folder).rglob("*.py"):
            calls = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call) and node.args]
            warned = [call.args[0] for call in calls if getattr(call.func, "attr", "") == "warning"]
            codes |= {each.value for word in warned for each in ast.walk(word) if isinstance(each, ast.Constant)}
    explained = {
        line.split("|")[1].strip() for line in page.splitlines() if line.startswith("| ") and line[2].isupper()
    }
    assert explained == {code for code in codes if str(code).isupper()} and len(explained) > 20
