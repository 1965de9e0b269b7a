"""Rows that differ, as a user asks for them: reduced cells against the whole solid mesh, each with its own stated error."""

from __future__ import annotations

from typing import Any

import pytest

from pipeline.analysis.modes import solve_modes
from pipeline.case.model import case_from_dict
from pipeline.logs import TerminalLog
from pipeline.planning.request import Request

RAW: dict[str, Any] = {
    "name": "graded",
    "material": "aluminium",
    "plate": {"thickness_mm": 2.0},
    "zone": {"length_mm": 12.0, "width_mm": 8.0, "nodal_lines": 2},
    "pillar": {"shape": "square"},
    "array": {
        "pitch_x_mm": 4.0,
        "heights_mm": [5.6, 4.9],
        "sides_mm": [2.0, 1.7],
        "pitches_y_mm": [4.0, 3.6],
        "extension_mm": 2.0,
    },
    "solve": {"accuracy": 0.01},
}


@pytest.mark.slow
def test_graded_cells_have_the_modes_of_the_whole_solid_within_both_bars() -> None:
    query = Request("plate", band_hz=(25e3, 70e3), symmetry="SS", search=False)
    ours, theirs = (
        solve_modes(case_from_dict(RAW, None, [("solve.model", model)]), query, TerminalLog(True)).rows
        for model in ("superelement", "solid")
    )
    assert len(ours) == len(theirs) > 2
    for one, other in zip(ours, theirs, strict=True):
        assert one.error is not None and other.error is not None
        assert one.frequency_hz == pytest.approx(other.frequency_hz, rel=one.error + other.error)
        assert max(one.error, other.error) < 0.03
