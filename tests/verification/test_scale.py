"""Elasticity has no length of its own: a body a thousand times smaller vibrates a thousand times faster."""

from __future__ import annotations

from typing import Any

import pytest

from pipeline.case.limits import unusual_size
from pipeline.case.model import Case, case_from_dict
from pipeline.logs import TerminalLog
from pipeline.questions.bands import Bands
from pipeline.questions.modes import Modes
from pipeline.questions.question import Question, Run, ask

RAW: dict[str, Any] = {
    "name": "scaled",
    "material": "aluminium",
    "plate": {"thickness_mm": 2.0},
    "zone": {"length_mm": 56.0, "width_mm": 20.0, "nodal_lines": 4},
    "pillar": {"side_mm": 2.0, "height_mm": 6.3},
    "array": {"pitch_mm": 4.0, "rows": 1, "extension_mm": 5.0},
    "bands": {"points": 1, "count": 6},
    "solve": {"accuracy": 0.1},
}
SAME = 1e-9  # of a frequency
STILL_HZ = 1.0  # of a body in mm


def scene(factor: float) -> Case:
    tables = {name: content for name, content in RAW.items() if isinstance(content, dict)}
    scaled = {
        name: {key: value * factor if key.endswith("_mm") else value for key, value in table.items()}
        for name, table in tables.items()
    }
    return case_from_dict(RAW | scaled)


def frequencies(question: Question[Any], factor: float) -> list[float]:
    rows = ask(scene(factor), question, Run(TerminalLog(True))).to_rows()
    return [row["frequency_hz"] for row in rows]


@pytest.mark.slow
@pytest.mark.parametrize("question", [Modes(part="pillar", count=4), Bands()], ids=lambda each: each.name)
@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_frequencies_go_as_the_inverse_of_length(question: Question[Any], factor: float) -> None:
    large, small = frequencies(question, 1.0), frequencies(question, factor)
    assert len(large) > 1
    assert [factor * hz for hz in small] == pytest.approx(large, rel=SAME, abs=STILL_HZ)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1e-3, 1e-6])
def test_modes_of_a_plate_go_as_the_inverse_of_length(factor: float) -> None:
    large, small = frequencies(Modes(), 1.0), frequencies(Modes(), factor)
    assert [factor * hz for hz in small] == pytest.approx(large, rel=SAME)


def test_an_unreasonable_size_is_a_warning() -> None:
    assert unusual_size(scene(1.0).design) is None and unusual_size(scene(1e-2).design) is None
    assert "a length is 56000 mm, not from 0.001 to 10000" in str(unusual_size(scene(1e3).design))
    assert "grains" in str(unusual_size(scene(1e-4).design))
