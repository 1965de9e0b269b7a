"""One mesh level finer: taken where the target mode's own estimate asks for it, not taken where it does not, and
said when it fails.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from pipeline.case.model import Case, case_from_dict
from pipeline.models import modes
from pipeline.planning import mesh_rules, refinement
from pipeline.planning.model_choice import Request, model_choice_of
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
            "zone": {"length_mm": 24.0, "width_mm": 18.0, "nodal_lines": 2},
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
    """A planner that starts at a degree that cannot carry the target mode."""
    monkeypatch.setattr(mesh_rules, "ALONG", {0.0: {2: 100.0}})


def climbs(log: RecordingLog) -> list[str]:
    return [line for line in log.facts if "degree 3 along the sides instead of 2" in line]


@pytest.mark.slow
@pytest.mark.usefixtures("too_low")
def test_a_degree_too_low_is_raised_and_every_mode_comes_down() -> None:
    low, kept = solved(0.1)
    high, log = solved(0.01)
    assert climbs(log) and not climbs(kept)
    ours, theirs = ([row.frequency_hz for row in result.rows] for result in (high, low))
    assert len(ours) >= len(theirs) and all(a < b for a, b in zip(ours, theirs, strict=False))
    assert high.reduction_error < low.reduction_error / 2.0


@pytest.mark.slow
def test_what_is_good_enough_stays_on_its_mesh_level() -> None:
    _, log = solved(0.01)
    assert not [line for line in log.facts if "truncation error of" in line]


@pytest.mark.usefixtures("too_low")
def test_a_mesh_level_that_cannot_be_solved_leaves_the_modes_of_the_one_below(monkeypatch: pytest.MonkeyPatch) -> None:
    built = modes.parts.built

    def first_only(case: Case, choice: Any, log: Any, meshes: Any) -> Any:
        if choice.reduction.interface.along > 2:
            raise SolverError("the mesh holds no more")
        return built(case, choice, log, meshes)

    monkeypatch.setattr(modes.parts, "built", first_only)
    result, log = solved(0.01)
    assert result.rows and "refinement stopped: the mesh holds no more" in log.facts
    assert "REDUCTION" in log.warnings


@pytest.mark.slow
def test_modes_that_nobody_is_told_ask_for_no_finer_mesh() -> None:
    """Every class solves as many as are target of all together: the highest of them are left out, and their errors, too."""
    log = RecordingLog()
    result = modes.solve_modes(case(0.01), Request("zone", near_hz=1e3, count=3, search=False), log)
    assert len(result.rows) == 3 and not any("from the calibration" in fact for fact in log.facts)
    assert result.target and max(row.frequency_hz for row in result.target.rows) > 1.5 * result.rows[-1].frequency_hz
    assert result.expected_error == max(row.error for row in result.rows if row.error is not None)


def with_pitch(pitch_mm: float, accuracy: float) -> int:
    """Degree along the sides that a plate with this pitch begins with."""
    design = case(accuracy).design
    spaced = replace(design, pitch_x_m=pitch_mm * 1e-3, pitch_y_m=pitch_mm * 1e-3)
    return mesh_rules.plate_reduction(spaced, accuracy, 45e3).interface.along


def test_a_higher_degree_is_taken_for_longer_sides_and_for_finer_accuracies() -> None:
    spacing = case(0.003).design.line_spacing_m * 1e3
    shares = (0.25, 0.35, 0.42, 0.85, 1.2)
    rough, fine = ([with_pitch(share * spacing, accuracy) for share in shares] for accuracy in (0.003, 0.001))
    assert rough == sorted(rough) and fine == sorted(fine) and rough[-1] == fine[-1] == 6
    assert all(a <= b for a, b in zip(rough, fine, strict=True)) and rough != fine


def test_cells_serve_somewhat_above_what_they_were_reduced_for_and_no_further() -> None:
    """Their own estimate tells whether well; far above it they are reduced again."""
    choice = model_choice_of(case(0.003), "plate", BAND_HZ[1])
    assert choice.reduction is not None
    own_hz, made_for = choice.reduction.top_hz, BAND_HZ[1]
    assert refinement.raise_cutoff(choice, made_for * 1.1, case(0.003), RecordingLog()) is None
    again = refinement.raise_cutoff(choice, made_for * 1.3, case(0.003), RecordingLog())
    assert again is not None and again.reduction is not None
    assert again.reduction.top_hz == pytest.approx(own_hz * 1.3)


def test_a_finer_accuracy_keeps_more_fixed_interface_modes_while_the_plate_is_thin() -> None:
    """At 1 % and where the waves are short as the plate is thick the cut-off is that of the frequency alone."""
    design = case(0.003).design
    shear_hz = mesh_rules.shear_cutoff_hz(design)
    for high_hz in (0.06 * shear_hz, 0.24 * shear_hz):
        rough, usual, fine = (mesh_rules.cutoff_to_hz(design, accuracy, high_hz) for accuracy in (0.03, 0.01, 0.003))
        assert rough == usual == mesh_rules.REACH * high_hz < fine
    thick = [mesh_rules.cutoff_to_hz(design, accuracy, 0.5 * shear_hz) for accuracy in (0.01, 0.003)]
    assert thick[0] == thick[1]
