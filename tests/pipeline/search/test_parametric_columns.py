"""Columns of a search from the parametric cell, where an explorer has made it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.case.model import load_case
from pipeline.models import parametric
from pipeline.search.fidelity import COLUMN, SLACK, EvaluationCache, evaluate
from tests.helpers.exploring import MESH, SMALL, small_explorer


@pytest.mark.usefixtures("coarsest_here")
def test_a_kept_cell_answers_columns_within_their_slack(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same design by both cells; the evaluations are kept apart, and a design outside the box is meshed."""
    case, cache = load_case(SMALL), EvaluationCache(tmp_path / "search")
    explorer = small_explorer(tmp_path)
    model = explorer.model
    monkeypatch.setattr(parametric, "_loaded", lambda materials, foot: None)
    meshed = evaluate(case, COLUMN, None, cache)
    monkeypatch.setattr(parametric, "_loaded", lambda materials, foot: model)
    live = evaluate(case, COLUMN, None, cache)
    assert live != meshed
    page = explorer.estimate(case)  # both at the wavenumber between free ends
    assert (live.frequency_hz, live.confinement_db) == (page["frequency_hz"], page["confinement_db"])
    assert meshed.frequency_hz is not None
    assert live.frequency_hz == pytest.approx(
        meshed.frequency_hz, rel=2.0 * SLACK[COLUMN]
    )  # its own, and as much of these bases' coarse mesh
    assert parametric.kept_cell(case) is model.cell
    assert parametric.kept_cell(load_case(SMALL, ("pillar.height_mm=8",))) is None
    for mesh in (None, replace(MESH, margin=10.0)):  # not known, or too rough
        monkeypatch.setattr(parametric, "_loaded", lambda materials, foot, mesh=mesh: replace(model, mesh=mesh))
        assert parametric.kept_cell(case) is None
    monkeypatch.setattr(parametric, "_loaded", lambda materials, foot: model)
    assert parametric.kept_cell(load_case(SMALL, ["pillar.fillet_mm=0.2"])) is None
