"""docs/verification.md holds the stored tables word for word, one heading lower, or says what was not run."""

from __future__ import annotations

from pathlib import Path

import pytest

from studies import verification


def test_headings_go_down_and_tables_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("accuracy", "extremes"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "report.md").write_text(f"# {name}\n\n## Part\n\n![x](x.png)\n\n| a |\n|---|\n| # 1 |\n")
    monkeypatch.setattr(verification, "RESULTS", tmp_path)
    page = verification.text()
    assert "## accuracy\n\n### Part\n" in page
    assert "| # 1 |" in page
    assert "x.png" not in page


def test_a_study_that_was_not_run_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(verification, "RESULTS", tmp_path)
    monkeypatch.setattr(verification, "PAGE", tmp_path / "page.md")
    assert verification.main() == 2
    assert "accuracy" in capsys.readouterr().err
    assert not (tmp_path / "page.md").exists()


def test_the_committed_page_has_both_studies() -> None:
    page = verification.PAGE.read_text()
    assert "## Error against run time" in page
    assert "## Stiff and extreme cases" in page
    assert "WRONG" not in page
