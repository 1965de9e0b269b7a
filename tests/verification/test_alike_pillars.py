"""Pillars all off by the same: what the explorer's column says of the spread, against plates meshed and solved one by one."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.case.model import load_case
from pipeline.explore import answer
from pipeline.explore.answer import Explorer, Scene
from pipeline.logs import TerminalLog
from pipeline.models.modes import solve_modes
from pipeline.models.parametric import cell_model
from pipeline.planning.model_choice import Request
from tests.helpers.exploring import SMALL

CHANGE_M = 0.05e-3
QUIET = TerminalLog(True)


@pytest.mark.slow
def test_a_shift_from_plate_to_plate_is_known_ten_times_better_than_the_frequency() -> None:
    case = load_case(SMALL)
    explorer = Explorer(Scene(case, {}, ()), cell_model(case, QUIET))
    answers = [answer.printed(case, sign * np.array([CHANGE_M, 0.0])) for sign in (-1.0, 1.0)]
    lower, higher = (explorer.plate(each)["frequency_hz"] for each in answers)
    target = [solve_modes(each, Request("plate", band_hz=(33e3, 36e3)), QUIET).target for each in answers]
    true = [one.row.frequency_hz for one in target if one and one.row]
    error = explorer.document(case, {})["plate"]["frequency_error"]
    assert true[0] - true[1] > 0.01 * true[0], "a higher pillar holds a lower mode"
    assert abs((lower - higher) - (true[0] - true[1])) < 0.1 * error * true[0]
    assert all(abs(one / other - 1.0) < error for one, other in zip((lower, higher), true, strict=True))
