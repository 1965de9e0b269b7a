"""Gains in a mode table: by residues, against the forced response itself; and what a table says without patches."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from firmware.mode_table import from_bytes, hold
from pipeline.board import export
from pipeline.board.export import (
    SAMPLE_RATE_HZ,
    ModalGains,
    can_be_computed,
    metres_per_volt,
    modal_gains,
    table_with_gains,
)
from pipeline.case.model import Case, load_case
from pipeline.cli.main import main
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models.forced import forced_plate
from pipeline.paths import ROOT
from solvers.piezo.forced import ForcedPlate, in_phase_signs
from tests.helpers.recording_log import RecordingLog
from tests.helpers.scenes import three_patches

CASE = three_patches((12.0, 40.0), 0.03)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("gains") / "small.toml"
    path.write_text(CASE)
    return path


@pytest.fixture(scope="module")
def case(file: Path) -> Case:
    return load_case(str(file), [])


@pytest.fixture(scope="module")
def forced(case: Case, coarsest_cells: None) -> ForcedPlate:
    return forced_plate(case, TerminalLog(quiet=True))


@pytest.fixture(scope="module")
def likest_hz(forced: ForcedPlate) -> float:
    """The mode of the band most like the target mode, which lies far above it."""
    low, high = forced.band_hz
    assert forced.target_place() is None and (forced.target_hz() or 0.0) > high
    assert forced.target_window_hz is not None
    (basis,) = forced.modes  # patches off both mirror lines: the plate is solved whole
    tones = basis.frequency_hz  # extrapolated by the bond's two meshes, as the gains are
    modes = forced._measured(basis.group, tones, basis.columns[:, : len(tones)], [None] * len(tones))
    return max((mode for mode in modes if low < mode.frequency_hz < high), key=lambda mode: mode.mac).frequency_hz


@pytest.fixture(scope="module")
def gains(forced: ForcedPlate, likest_hz: float) -> ModalGains:
    return modal_gains(forced, likest_hz)


def fitted(forced: ForcedPlate, gains: ModalGains, index: int) -> complex:
    """G of one mode from the forced curve about its resonance, what the others add there taken as a parabola."""
    centre = gains.frequency_hz[index]
    tone = centre * (1.0 + np.linspace(-2e-3, 2e-3, 9))
    own = 1.0 / (1.0 + 2j * np.pi * gains.tau_s[index] * (tone - centre))
    away = (tone - centre) / centre / 2e-3
    basis = np.stack([own, np.ones_like(own), away, away**2], axis=1)
    return complex(np.linalg.lstsq(basis, forced.curve(tone).sensor_v_per_v[:, 0], rcond=None)[0][0])


@pytest.mark.slow
def test_residues_are_what_the_forced_response_shows(forced: ForcedPlate, gains: ModalGains) -> None:
    """Within the rest's own error: it is taken at the target mode, where both agree best; above the band nobody asks."""
    largest = np.abs(gains.gain).max()
    inside = np.flatnonzero(gains.frequency_hz <= forced.band_hz[1])
    assert len(inside) >= 4
    for index in inside:
        target = index == gains.target
        error = abs(fitted(forced, gains, index) - gains.gain[index, 0])
        assert error < (1e-3 if target else 2e-2) * abs(gains.gain[index, 0]) + 1e-5 * largest, index


@pytest.mark.slow
def test_open_sensors_stiffen_the_modes_and_the_signs_add_up(likest_hz: float, gains: ModalGains) -> None:
    assert 1.0 <= gains.frequency_hz[gains.target] / likest_hz < 1.01
    assert gains.tau_s * np.pi * gains.frequency_hz == pytest.approx(300.0, rel=0.02)
    target = gains.parts[gains.target, :, 0]
    assert set(gains.signs.tolist()) == {1.0, -1.0}  # the shape bends one way on the left, the other on the right
    assert abs(gains.gain[gains.target, 0]) == pytest.approx(np.abs(target).sum(), rel=1e-2)
    phase = np.degrees(np.angle(gains.gain[gains.target, 0]))
    assert abs(abs(phase) - 90.0) < 1.0  # displacement, 90 degrees behind or ahead


def test_the_sign_of_an_eigenvector_decides_nothing() -> None:
    gain = np.array([1e-9, -0.4, 0.5, -0.2])  # the first patch stands on a nodal line, the last one listens
    assert list(in_phase_signs(gain, [0, 1, 2])[1:]) == [1.0, -1.0, 1.0]
    assert np.array_equal(in_phase_signs(gain, [0, 1, 2])[1:], in_phase_signs(-gain, [0, 1, 2])[1:])


def test_the_table_carries_them(case: Case, gains: ModalGains) -> None:
    table = table_with_gains(case, gains)
    mode = table.modes[table.target]
    droop = abs(hold(mode.frequency_hz, SAMPLE_RATE_HZ))
    assert mode.gain is not None and abs(mode.gain) == pytest.approx(abs(gains.gain[gains.target, 0]) * droop, rel=1e-9)
    delayed = np.exp(-2j * np.pi * mode.frequency_hz * mode.delay_s)
    exact = gains.gain[gains.target, 0] * hold(mode.frequency_hz, SAMPLE_RATE_HZ)
    assert mode.gain * delayed == pytest.approx(exact, rel=1e-9)
    pa4, pa5 = mode.actuator_weights
    assert max(abs(pa4), abs(pa5)) == pytest.approx(1.0, abs=1e-12) and (pa4 / pa5).real < 0.0
    assert not mode.frequency_identified and not mode.tau_identified


def test_metres_per_volt_are_those_of_the_driven_plate(case: Case, forced: ForcedPlate, gains: ModalGains) -> None:
    """Gain times metres per volt is the motion per volt of drive, which a curve gives at other frequencies, too."""
    metres = metres_per_volt(forced, gains)
    mode = table_with_gains(case, gains, metres).modes[gains.target]
    assert mode.metres_per_volt == metres > 0.0
    half_hz = 0.5 / np.pi / gains.tau_s[gains.target]
    tone = gains.frequency_hz[gains.target] + np.array([-0.5, 0.0, 0.5]) * half_hz
    curve = forced.curve(tone)
    own = np.abs(gains.gain[gains.target, 0] / (1.0 + 1j * np.array([-0.5, 0.0, 0.5])))
    assert metres * own == pytest.approx(curve.zone_rms_m_per_v, rel=0.02)  # what neighbours add, twice
    assert all(each.metres_per_volt == 0.0 for each in table_with_gains(case, gains).modes)


@pytest.mark.slow
def test_export_computes_them_only_for_patches_that_drive_and_listen(file: Path, case: Case, capsys) -> None:
    target = file.parent / "table.bin"
    assert can_be_computed(case)
    assert main(["export", "table", str(file), "-o", str(target), "--force"]) == 0
    text = capsys.readouterr().err
    table = from_bytes(target.read_bytes())
    assert table.modes[table.target].metres_per_volt > 0.0 and "um rms in the zone per volt" in text
    assert table.modes[table.target].gain is not None and "gain 0." in text and "on PA5" in text
    assert main(["export", "table", str(file), "-o", str(target), "--force", "--set", "patches.sensors=[]"]) == 0
    text = capsys.readouterr().err
    assert all(mode.gain is None for mode in from_bytes(target.read_bytes()).modes)
    assert "no gains" in text and "bond the patches" not in text


@pytest.mark.parametrize(("near_hz", "target_hz"), [(None, None), (None, 60e3), (30e3, None), (55e3, 60e3)])
def test_a_patched_plate_without_its_target_mode_is_refused_or_named(
    case: Case, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, near_hz: float | None, target_hz: float | None
) -> None:
    """Without --force there is no nearest mode to take; with it, the plate is solved about that mode."""
    plate = SimpleNamespace(target_place=lambda: None, target_hz=lambda: target_hz, band_hz=(12e3, 40e3))
    asked: list[Any] = []

    def solved(case: Case, log: RecordingLog, band_hz: Any = None) -> Any:
        asked.append(band_hz)
        return plate

    def stopped(plate: Any, near_hz: float | None) -> None:
        raise StopIteration

    monkeypatch.setattr("pipeline.models.forced.forced_plate", solved)
    monkeypatch.setattr(export, "modal_gains", stopped)
    log = RecordingLog()
    refused = near_hz is None and target_hz is None
    with pytest.raises(InputError if refused else StopIteration, match="with --force" if refused else None):
        export.write_gains(case, tmp_path, log, near_hz=near_hz)
    about = near_hz or target_hz
    outside = [] if about is None or about < 40e3 else [pytest.approx((0.8 * about, 1.2 * about))]
    assert asked == [None, *outside]
    assert ("TABLE" in log.warnings) == (near_hz is not None)


@pytest.mark.slow
def test_a_sensor_on_a_node_of_the_target_mode_gives_a_table_without_its_gain(tmp_path: Path) -> None:
    """The middle of three patches listens on the nodal line of an odd shape, and two drive it."""
    path, target = tmp_path / "node.toml", tmp_path / "node.bin"
    path.write_text((ROOT / "examples/small.toml").read_text())
    given = ["solve.accuracy=0.1", "zone.nodal_lines=3", "patches.size_mm=[8.0,3.0,0.3]", "patches.sensors=[1]"]
    given.append("patches.centres_mm=[[-20,0],[0,0],[20,0]]")
    options = [word for each in given for word in ("--set", each)]
    assert main(["export", "table", str(path), *options, "-o", str(target)]) == 0
    table = from_bytes(target.read_bytes())
    assert table.modes[table.target].gain is None
