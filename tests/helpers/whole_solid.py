"""Modes of a small plate from reduced cells and from the whole solid mesh, each with its own error bars."""

from __future__ import annotations

from typing import Any

import pytest

from pipeline.case.model import case_from_dict
from pipeline.logs import TerminalLog
from pipeline.models.modes import solve_modes
from pipeline.planning.model_choice import Request
from pipeline.planning.plan import modes_step


def check_within_both_bars(raw: dict[str, Any], band_hz: tuple[float, float], symmetry: str | None = "SS") -> None:
    """Check that both models have equally many modes in a band, each within the sum of both errors, which are below 3 %."""
    query = Request("plate", band_hz=band_hz, symmetry=symmetry, search=False)
    cases = (case_from_dict(raw, None, [("solve.model", model)]) for model in ("superelement", "solid"))
    ours, theirs = (solve_modes(case, query, TerminalLog(True), modes_step(case, query).choice).rows for case in cases)
    assert len(ours) == len(theirs) > 2
    for one, other in zip(ours, theirs, strict=True):
        assert one.error is not None and other.error is not None
        assert one.frequency_hz == pytest.approx(other.frequency_hz, rel=one.error + other.error)
        assert max(one.error, other.error) < 0.03
