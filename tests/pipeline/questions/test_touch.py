"""A finger on the small patched plate: states, loop, power, what is unknown, and pictures from the record alone."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.case.model import Case, case_from_dict
from pipeline.logs import TerminalLog
from pipeline.models import touch
from pipeline.models.forced import forced_plate
from pipeline.questions.touch import TouchResult
from solvers.piezo.forced import ForcedPlate
from studies.reproduction import _by_power
from tests.helpers.asked import touch_of
from tests.helpers.scenes import three_patches

QUIET = TerminalLog(quiet=True)
FILM = {"touch.force_N": 0.5, "touch.gap_um": [2.0, 10.0]}


def case_of(**more: Any) -> Case:
    settings = {"touch.radius_mm": 2.0, **{key.replace("__", "."): value for key, value in more.items()}}
    return case_from_dict(tomllib.loads(three_patches((75.0, 95.0), 0.1)), overrides=list(settings.items()))


@pytest.fixture(scope="module")
def forced(coarsest_cells: None) -> ForcedPlate:
    return forced_plate(case_of(), QUIET)


@pytest.fixture(scope="module")
def record(forced: ForcedPlate) -> TouchResult:
    return touch_of(case_of(**FILM, touch__limit_V=1e-3), QUIET, forced=forced)


@pytest.mark.slow
def test_every_state_is_told_and_its_power_balances(record: TouchResult) -> None:
    assert [state.state for state in record.states] == ["free", "touched", "retuned", "held", "shaped"]
    for state in record.states:
        assert state.patches_W == pytest.approx(state.plate_W + state.finger_W, rel=1e-9)
        assert state.dielectric_W
        assert state.drawn_W == pytest.approx(state.patches_W + state.dielectric_W, rel=1e-12)
        assert state.drawn_mW_at_1um == pytest.approx(1e3 * state.drawn_W * (1e-6 / state.finger_m) ** 2, rel=1e-12)
        assert state.finger_m * (state.drive_V_at_1um or 0.0) == pytest.approx(1e-6 * state.drive_V, rel=1e-12)
    free, touched = record.state("free"), record.state("touched")
    assert free and touched and free.finger_W == 0.0 < touched.finger_W and touched.finger_m < free.finger_m


@pytest.mark.slow
def test_a_shift_is_surer_than_both_of_its_ends(record: TouchResult) -> None:
    """The error of the free frequency moves the loaded one along: a bar of theirs apart would be hundreds of times as wide."""
    mode = record.mode
    assert mode and mode.free_error and mode.frequency_error and mode.shift_error_hz
    assert mode.shift_error_hz < 0.5 * mode.frequency_error * mode.frequency_hz


@pytest.mark.slow
def test_the_loop_asks_for_what_the_sensor_lost_and_is_limited(record: TouchResult, forced: ForcedPlate) -> None:
    free, touched, regulated = (record.state(name) for name in ("free", "touched", "held"))
    assert record.loop and free and touched and regulated and free.sensor_V and touched.sensor_V
    assert record.loop.needed_V == pytest.approx(free.sensor_V / touched.sensor_V, rel=1e-12)
    assert record.loop.saturates and regulated.drive_V == 1e-3
    able = touch_of(case_of(touch__limit_V=1e5), QUIET, mapped=False, forced=forced)
    regulated = able.state("held")
    assert able.loop and able.loop.saturates is False and regulated
    assert regulated.sensor_V == pytest.approx(free.sensor_V, rel=1e-9)


@pytest.mark.slow
def test_without_impedance_nothing_changes(forced: ForcedPlate) -> None:
    """The same figures to the last digit, and no pull of the loop."""
    nothing = touch_of(case_of(touch__impedance={}), QUIET, mapped=False, forced=forced)
    free, touched = nothing.state("free"), nothing.state("touched")
    assert free and touched and nothing.mode and nothing.loop
    assert replace(free, state="touched") == touched
    assert (nothing.mode.shift_hz, nothing.mode.added_loss, nothing.loop.needed_V) == (0.0, 0.0, 1.0)


@pytest.mark.slow
def test_what_is_not_known_is_not_told(forced: ForcedPlate) -> None:
    plain = touch_of(case_of(), QUIET, mapped=False, forced=forced)
    assert plain.map is None and plain.loop and plain.loop.saturates is None
    assert any("touch.gap_um and touch.force_N are not given" in reason for reason in plain.unknown)
    loud = touch_of(case_of(**FILM, touch__impedance="light", patches__drive_V=1e4), QUIET, mapped=False, forced=forced)
    assert all(state.friction_low is None for state in loud.states)
    assert any("not below a gap of 2 um" in reason for reason in loud.unknown)


@pytest.mark.slow
def test_a_map_that_no_memory_holds_is_left_out(forced: ForcedPlate, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(touch, "room_bytes", lambda: 1e3)
    assert touch_of(case_of(), QUIET, forced=forced).map is None


@pytest.mark.slow
def test_the_map_holds_the_case_s_own_place_and_is_drawn_from_the_record(record: TouchResult, tmp_path: Path) -> None:
    places, touched = record.map, record.state("touched")
    assert places and touched and places.friction and places.needed_V and record.loop
    here = [
        int(np.argmin(np.abs(np.array(ticks) - at))) for ticks, at in ((places.x_m, record.at_m[0]), (places.y_m, 0.0))
    ]
    distance = np.hypot(places.x_m[here[0]] - record.at_m[0], places.y_m[here[1]])
    near = places.touched_m[here[0]][here[1]]
    assert distance < 0.5 * record.radius_m and near == pytest.approx(touched.finger_m, rel=0.5)
    assert touched.finger_error_m and places.touched_error_m and places.needed_error_V and places.friction_error
    own = places.touched_error_m[here[0]][here[1]] / near  # as the state's bar, found on other plates with another rule
    assert 0.5 < own / (touched.finger_error_m / touched.finger_m) < 2.0
    relative = np.array(places.touched_error_m) / np.array(places.touched_m)
    assert (relative > 0.0).all() and relative.max() < 4.0 * np.median(relative)
    assert record.loop.needed_error_V and places.needed_error_V[here[0]][here[1]] < 4.0 * record.loop.needed_error_V
    (figure,) = record.pictures()
    assert len(figure.figure.axes) == 3 and "positions on the touch face" in figure.alt
    record.as_figure().savefig(tmp_path / "touch.svg")
    _by_power(2 * [SimpleNamespace(sweep={}, of=lambda kind: record)]).savefig(tmp_path / "power.svg")
    assert all((tmp_path / name).stat().st_size > 1000 for name in ("touch.svg", "power.svg"))
    assert TouchResult.from_document(record.to_dict()) == record
