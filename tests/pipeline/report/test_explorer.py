"""The explorer beside a study's report."""

from __future__ import annotations

from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.explore import offline
from pipeline.logs import WarningLog
from pipeline.models import parametric as cell_model
from pipeline.report import page
from tests.helpers import synthetic
from tests.helpers.exploring import SMALL, small_explorer


@pytest.mark.slow
def test_a_study_links_an_explorer_where_its_bases_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = small_explorer(tmp_path).model
    folder = synthetic.put_study(tmp_path / "rows", pitches=(0.004,), rows=(1,))
    assert f'href="{page.NAME}"' not in page.build(folder).read_text(encoding="utf-8")
    monkeypatch.setattr(cell_model, "kept_model", lambda case, about: None)
    assert page.put_explorer(folder, SMALL) == [] and not (folder / page.NAME).exists()
    monkeypatch.setattr(cell_model, "kept_model", lambda case, about: model)
    assert page.put_explorer(folder, SMALL) == [folder / page.NAME]
    assert f'href="{page.NAME}"' in page.build(folder).read_text(encoding="utf-8")


def test_a_study_of_a_cell_that_the_bases_cannot_follow_has_none(tmp_path: Path) -> None:
    case = tmp_path / "tall.toml"
    case.write_text(SMALL.read_text(encoding="utf-8").replace('shape = "square"', 'shape = "round"'), encoding="utf-8")
    assert page.put_explorer(tmp_path, case) == []
    log = WarningLog()
    assert page.put_explorer(tmp_path, case, log) == [] and [each[0] for each in log.warnings] == ["NO_EXPLORER"]


@pytest.mark.slow
def test_bases_are_made_where_they_are_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`antinode run --explorer` after the report, once: what is beside it already is not made again."""
    from pipeline.batch import case_study
    from pipeline.batch.study_file import StudyFile

    model, modelled_cases = small_explorer(tmp_path).model, []
    monkeypatch.setattr(cell_model, "kept_model", lambda case, about: None)
    monkeypatch.setattr(cell_model, "cell_model", lambda case, log, about: modelled_cases.append(case) or model)
    folder = synthetic.put_study(tmp_path / "rows", pitches=(0.004,), rows=(1,))
    study = StudyFile("rows", tmp_path / "rows.toml", SMALL, (), {}, False)
    built = [folder / page.NAME, folder / "report.html"]
    assert case_study.explored(study, folder, WarningLog()) == built and len(modelled_cases) == 1
    assert f'href="{page.NAME}"' in built[1].read_text(encoding="utf-8")
    assert case_study.explored(study, folder, WarningLog()) == [] and len(modelled_cases) == 1


@pytest.mark.slow
def test_a_page_that_is_too_large_to_travel_is_refused_by_its_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(offline, "MAX_BYTES", 10_000)
    with pytest.raises(InputError, match=r"would have \d+\.\d+ MB, more than 0.01 MB"):
        offline.page(small_explorer(tmp_path))
