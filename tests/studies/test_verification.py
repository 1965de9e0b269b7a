"""docs/verification.md holds the stored tables word for word, one heading lower, or says what was not run."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest

from studies import accuracy, verification

NEAR = 1.25  # times the envelope's own time: what a repeat may differ by


def test_headings_go_down_and_tables_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("accuracy", "extremes"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "report.md").write_text(f"# {name}\n\n## Part\n\n![x](x.png)\n\n| a |\n|---|\n| # 1 |\n")
    monkeypatch.setattr(verification, "RESULTS", tmp_path)
    page = verification.text()
    assert "## accuracy\n\n### Part\n" in page
    assert "| # 1 |" in page
    assert "x.png" not in page


def test_the_tables_of_meshes_and_references_become_files_instead_of_sections() -> None:
    table = "| quantity | mesh |\n| --- | --- |\n| Zone, (0, N) | hex3,10mm |\n"
    page = f"# accuracy\n\n## References\n\nWords.\n\n{table}\n## Other\n\n| a |\n"
    assert verification.csv_of(page) == {"accuracy-references.csv": 'quantity,mesh\n"Zone, (0, N)","hex3,10mm"\n'}
    assert verification.shortened(page) == "# accuracy\n\n## Other\n\n| a |\n"


def test_a_study_that_was_not_run_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(verification, "RESULTS", tmp_path)
    monkeypatch.setattr(verification, "PAGE", tmp_path / "page.md")
    assert verification.main() == 2
    assert "accuracy" in capsys.readouterr().err
    assert not (tmp_path / "page.md").exists()


def test_rows_of_tasks_replace_their_own_and_stay_when_the_page_is_written_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    head = "What it is.\n\n| task | before |\n|---|---|"
    page = verification.with_speed("# Page\n", {"bands": "| bands | 2 |", "grid": "| grid | 9 |"}, head)
    page = verification.with_speed(page, {"bands": "| bands | 1 |"}, head)
    assert page.endswith(f"# Page\n\n{verification.SPEED}\n\n{head}\n| bands | 1 |\n| grid | 9 |\n")
    for name in ("accuracy", "extremes"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "report.md").write_text(f"# {name}\n")
    (tmp_path / verification.STORED).parent.mkdir()
    (tmp_path / verification.STORED).write_text("<svg/>")
    monkeypatch.setattr(verification, "RESULTS", tmp_path)
    monkeypatch.setattr(verification, "PAGE", tmp_path / "page.md")
    monkeypatch.setattr(verification, "FIGURE", tmp_path / "figure.svg")
    verification.PAGE.write_text(page)
    assert verification.main() == 0
    assert (
        verification.PAGE.read_text().endswith("| bands | 1 |\n| grid | 9 |\n")
        and "## extremes" in verification.PAGE.read_text()
    )
    assert verification.FIGURE.read_text() == "<svg/>"


def test_the_committed_page_has_both_studies() -> None:
    page = verification.PAGE.read_text()
    assert "## Error against run time" in page
    assert "## Stiff and extreme cases" in page
    assert "WRONG" not in page
    named = re.findall(r"\]\((pictures/[^)]*)\)", page)
    assert len(named) == 2 and all((verification.PAGE.parent / name).is_file() for name in named)


def test_every_mesh_that_an_accuracy_may_choose_is_on_the_committed_envelope_or_near_it() -> None:
    meshes, references = (
        list(csv.reader((verification.REFERENCE / name).read_text().splitlines()))[1:]
        for name in verification.FILES.values()
    )
    names = {title: part for part, listed in accuracy.QUANTITIES.items() for title in map(accuracy.NAMES.get, listed)}
    chosen = {
        (part, accuracy.name(mesh_level))
        for part, listed in accuracy.mesh_levels().items()
        for mesh_level in listed
        if accuracy._planned(part, mesh_level)
    }
    assert {(names[row[0]], row[1]) for row in meshes} == chosen
    uncertain = {row[0]: float(row[3]) for row in references}
    off = [row for row in meshes if float(row[4]) > NEAR]
    for title, _, error, seconds, _ in off:  # no further beyond a quicker mesh than the reference itself is uncertain
        quicker = [float(row[2]) for row in meshes if row[0] == title and float(row[3]) < float(seconds)]
        assert quicker and float(error) <= min(quicker) + uncertain[title], off
