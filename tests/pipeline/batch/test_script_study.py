"""Studies that are Python modules: found, faults told, pages written from records alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.batch import script_study
from pipeline.errors import InputError
from pipeline.report.html import Page, Section, Table, markdown, text, write_page


def written(tmp_path: Path, body: str) -> Path:
    path = tmp_path / "mine.toml"
    path.write_text(body)
    return path


def test_a_study_of_a_case_is_none_of_these(tmp_path: Path) -> None:
    assert script_study.load_script(written(tmp_path, '[study]\ncase = "a.toml"\n')) is None


def test_every_fault_of_the_file_is_told(tmp_path: Path) -> None:
    path = written(tmp_path, '[study]\nscript = "extreme"\nname = "a b"\njobs = 2\n[sweep]\nx = [1]\n')
    with pytest.raises(InputError) as text:
        script_study.load_script(path)
    assert len(text.value.lines) == 4 and any("extremes" in line for line in text.value.lines)


def test_cases_of_the_extremes_have_their_own_folders_and_the_hash_of_their_source(tmp_path: Path) -> None:
    study = script_study.load_script(written(tmp_path, '[study]\nscript = "extremes"\n'))
    assert study is not None and study.name == "mine"
    jobs = script_study.jobs_of(study)
    assert len({job.case_id for job in jobs}) == len(jobs) > 50
    assert set(jobs[0].payload["sources"]) >= {"extremes", "ladder"}


def test_a_page_escapes_and_holds_what_its_tables_hold(tmp_path: Path) -> None:
    page = Page([Section("Errors <b>", ["words"], [Table("t", ["a|b", "c"], [[1.5, None], ["x", 1e-9]])])])
    table, html = write_page(tmp_path, "n", "Title", "Lead", page)
    assert table.read_text() == "a|b,c\n1.5,\nx,1e-09\n"
    assert "Errors &lt;b&gt;" in html.read_text() and "1.00e-09" in html.read_text()
    assert "| 1.5 | – |" in markdown("Title", "Lead", page)


def test_a_cell_is_written_for_people() -> None:
    assert [text(v) for v in (None, True, 0.0, 12.3456789, 1e-5, 3, "s")] == [
        "–",
        "yes",
        "0",
        "12.3457",
        "1.00e-05",
        "3",
        "s",
    ]
