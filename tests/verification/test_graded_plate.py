"""Rows that differ, as a user asks for them: reduced cells against the whole solid mesh, each with its own stated error."""

from __future__ import annotations

from typing import Any

import pytest

from tests.helpers.whole_solid import check_within_both_bars

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
    check_within_both_bars(RAW, (25e3, 70e3))
