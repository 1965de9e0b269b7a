"""One mesh level finer: taken where the wanted mode's own estimate asks for it, not taken where it does not, and
said when it fails.
"""

from __future__ import annotations

from typing import Any

import pytest

from pipeline.analysis import modes
from pipeline.case.model import Case, case_from_dict
from pipeline.planning import mesh_rules
from pipeline.planning.request import Request
from solvers.errors import SolverError
from tests.helpers.recording_log import RecordingLog

pytestmark = pytest.mark.usefixtures("coarsest_cells")
BAND_HZ = (25e3, 45e3)


def case(accuracy: float) -> Case:
    return case_from_dict(
        {
            "name": "small",
            "material": "aluminium",
            "plate": {"thickness_mm": 2.0},
            "zone": {"length_mm": 28.0, "width_mm": 18.0, "nodal_lines": 2},
            "pillar": {"shape": "square", "side_mm": 2.0, "height_mm": 6.3},
            "array": {"pitch_mm": 4.0, "rows": 1, "extension_mm": 5.0},
            "solve": {"accuracy": accuracy},
        }
    )


def solved(accuracy: float) -> tuple[modes.PartModes, RecordingLog]:
    log = RecordingLog()
    return modes.solve_modes(case(accuracy), Request("plate", BAND_HZ, None, None), log), log


@pytest.fixture
def too_low(monkeypatch: pytest.MonkeyPatch) -> None:
    """A planner that starts at a degree that cannot carry the wanted mode."""
    monkeypatch.setattr(mesh_rules, "ALONG", {2: 100.0})


def climbs(log: RecordingLog) -> list[str]:
    return [line for line in log.facts if "degree 3 along the sides instead of 2" in line]


@pytest.mark.usefixtures("too_low")
def test_a_degree_too_low_is_raised_and_every_mode_comes_down() -> None:
    low, kept = solved(0.1)
    high, log = solved(0.01)
    assert climbs(log) and not climbs(kept)
    ours, theirs = ([row.frequency_hz for row in result.rows] for result in (high, low))
    assert len(ours) >= len(theirs) and all(a < b for a, b in zip(ours, theirs, strict=False))
    assert high.reduction_error < low.reduction_error / 2.0


@pytest.mark.slow
def test_what_is_good_enough_stays_on_its_rung() -> None:
    _, log = solved(0.01)
    assert not [line for line in log.facts if "too high" in line]


@pytest.mark.usefixtures("too_low")
def test_a_rung_that_cannot_be_solved_leaves_what_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    built = modes.parts.built

    def first_only(case: Case, choice: Any, log: Any, meshes: Any) -> Any:
        if choice.reduction.interface.along > 2:
            raise SolverError("the mesh holds no more")
        return built(case, choice, log, meshes)

    monkeypatch.setattr(modes.parts, "built", first_only)
    result, log = solved(0.01)
    assert result.rows and "no mesh level higher: the mesh holds no more" in log.facts
    assert "REDUCTION" in log.warnings


def test_modes_that_nobody_is_told_ask_for_no_finer_mesh() -> None:
    """Every class solves as many as are wanted of all together: the highest of them are left out, and their errors, too."""
    log = RecordingLog()
    result = modes.solve_modes(case(0.01), Request("zone", near_hz=1e3, count=3, search=False), log)
    assert len(result.rows) == 3 and not any("finer ones" in fact for fact in log.facts)
    assert result.wanted and max(row.frequency_hz for row in result.wanted.rows) > 1.5 * result.rows[-1].frequency_hz
    assert result.expected_error == max(row.error for row in result.rows if row.error is not None)
