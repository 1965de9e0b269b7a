"""The response at the target mode beside the highest of the band: two figures wherever they are two."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pipeline.cli.main import main
from solvers.piezo.forced import Curve
from solvers.piezo.responses import Peak, curve_about, highest_hz, near_hz, own_or, peak_of

pytestmark = pytest.mark.usefixtures("coarsest_cells")
ROOT = Path(__file__).resolve().parents[3]
PATCHED = ["--set", "patches={size_mm=[8.0,3.0,0.3]}", "--set", "solve.accuracy=0.05"]


class Two:
    """Two resonances, (Hz, height), of one quality factor."""

    def __init__(self, *peaks: tuple[float, float], quality_factor: float = 300.0) -> None:
        self.peaks, self.loss = peaks, 1.0 / quality_factor

    def loss_at(self, frequency_hz: float) -> float:
        return self.loss

    def curve(self, frequency_hz: np.ndarray) -> Curve:
        f = np.asarray(frequency_hz, dtype=float)
        total = sum(a * self.loss / (1.0 - (f / f0) ** 2 + 1j * self.loss) for f0, a in self.peaks)
        return Curve(f, np.abs(total), np.abs(total) / 4.0, np.empty((len(f), 0), dtype=complex))


def test_a_weaker_peak_is_found_where_its_mode_is() -> None:
    plate = Two((26e3, 3.0), (34e3, 1.0))
    assert highest_hz(plate, 20e3, 45e3, 101) == pytest.approx(26e3, abs=0.02 * 26e3 / 300)
    assert near_hz(plate, 34e3) == pytest.approx(34e3, abs=0.05 * 34e3 / 300)
    curve = curve_about(plate, 20e3, 45e3, 51, [near_hz(plate, 34e3)])
    result = peak_of(curve, near_hz(plate, 34e3))
    assert result.quality_factor == pytest.approx(300.0, rel=0.02)
    assert result.confinement_db == pytest.approx(20.0 * np.log10(4.0))


def test_a_mode_on_anothers_flank_keeps_its_own_frequency_and_has_no_quality_factor() -> None:
    """1/1000 as strong, two half-power widths beside another: the response only falls there."""
    plate = Two((34e3, 1.0), (34.25e3, 1e-3))
    assert near_hz(plate, 34.25e3) == 34.25e3
    curve = curve_about(plate, 30e3, 38e3, 51, [34.25e3])
    assert peak_of(curve, 34.25e3).quality_factor is None


def test_a_curve_that_rises_to_the_end_of_its_band_has_no_peak() -> None:
    plate = Two((50e3, 1.0))
    top = highest_hz(plate, 30e3, 45e3, 51)
    assert top == 45e3 and peak_of(curve_about(plate, 30e3, 45e3, 51, [top]), top).quality_factor is None


@pytest.mark.parametrize("quality_factor", [20.0, 300.0])
def test_a_peak_found_twice_is_one_peak_with_its_quality_factor(quality_factor: float) -> None:
    """Each search ends somewhere else within its own precision: two points beside each other are not both a top."""
    plate = Two((34e3, 1.0), (38e3, 0.2), quality_factor=quality_factor)
    highest = highest_hz(plate, 30e3, 40e3, 401)
    own = own_or(plate, 34e3, highest)
    curve = curve_about(plate, 30e3, 40e3, 401, [own, highest])
    assert peak_of(curve, own) == peak_of(curve, highest)
    assert peak_of(curve, own).quality_factor == pytest.approx(quality_factor, rel=0.05)
    assert own_or(plate, 38e3, highest) == near_hz(plate, 38e3)


def test_two_peaks_are_one_within_a_half_power_width() -> None:
    peak = Peak(34e3, 1.0, None, None)
    assert peak.is_at(34.1e3, 1.0 / 300.0) and not peak.is_at(34.2e3, 1.0 / 300.0)
    assert peak.confinement_db is None


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> dict:
    file = tmp_path_factory.mktemp("peak") / "r.json"
    assert main(["response", str(ROOT / "examples" / "small.toml"), "--quiet", "--json", str(file), *PATCHED]) == 0
    return json.loads(file.read_text())


@pytest.mark.slow
def test_a_plate_whose_highest_peak_is_another_modes_tells_both(document: dict) -> None:
    """The small plate's response is highest at 26 kHz, which leaks; its target mode at 34.5 kHz is confined."""
    target, highest = document["target_peak"], document["highest_peak"]
    assert document["target_status"] == "single"
    assert abs(target["frequency_hz"] / document["target_hz"] - 1.0) < 1.0 / document["quality_factor_given"]
    assert highest["zone_rms_m_per_V"] == max(document["zone_rms_m_per_V"]) > target["zone_rms_m_per_V"]
    assert highest["frequency_hz"] < 0.8 * target["frequency_hz"]
    assert target["confinement_db"] > highest["confinement_db"] + 6.0
    assert target["quality_factor"] == pytest.approx(document["quality_factor_given"], rel=0.05)


@pytest.mark.slow
def test_no_peak_is_higher_than_the_highest_however_narrow(tmp_path: Path) -> None:
    """A patch that listens is open and stiffens its mode by more than the half-power width: the short one's is no peak."""
    file = tmp_path / "r.json"
    patches = "patches={size_mm=[6.0,3.0,0.3],centres_mm=[[0.0,0.0],[14.0,0.0],[-14.0,0.0]],sensors=[1]}"
    sets = ["--set", patches, "--set", "damping.quality=1e6", "--set", "solve.accuracy=0.05"]
    command = ["response", str(ROOT / "examples" / "small.toml"), "--quiet", "--json", str(file), *sets]
    assert main([*command, "--band", "30kHz:40kHz"]) == 0
    document = json.loads(file.read_text())
    peaks = document["highest_peak"], document["target_peak"]
    assert peaks[0]["zone_rms_m_per_V"] == max(document["zone_rms_m_per_V"]) >= peaks[1]["zone_rms_m_per_V"]
    assert [peak["quality_factor"] for peak in peaks] == pytest.approx([1e6] * 2, rel=0.05)


@pytest.mark.slow
def test_it_is_said_and_so_is_a_band_without_the_target_mode(capsys: pytest.CaptureFixture[str]) -> None:
    small = str(ROOT / "examples" / "small.toml")
    assert main(["response", small, "--quiet", "--points", "51", *PATCHED]) == 0
    said = capsys.readouterr()
    assert "warning OTHER_PEAK" in said.err and "highest peak at" in said.out and "target mode's peak at" in said.out
    assert main(["response", small, "--quiet", "--points", "51", "--band", "27kHz:31kHz", *PATCHED]) == 0
    said = capsys.readouterr()
    assert "warning NO_MODE" in said.err and "target mode's peak" not in said.out and "nan" not in said.out


def test_a_peak_is_one_point_of_its_curve() -> None:
    """The even grid's own middle is the peak but for rounding: as high, it would hide that the curve falls to both sides."""
    plate = Two((34e3, 1.0))
    for shift in np.linspace(0.0, 1e-11, 41):
        top = near_hz(plate, 34e3) * (1.0 + shift)
        curve = curve_about(plate, 30e3 * (1.0 + shift), 38e3, 5, [top])
        assert top in curve.frequency_hz and np.diff(curve.frequency_hz).min() > 1e-7 * top
        assert peak_of(curve, top).quality_factor is not None
