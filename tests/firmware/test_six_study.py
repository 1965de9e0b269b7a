"""The six-channel image with the exported table, on the ideal beam of the shaping study: what moves, seen along the beam."""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pytest

from firmware.emulate.plant import Beam, Structure
from firmware.mode_table import MIN_MODE_HZ, from_bytes, to_bytes
from pipeline.board import six_channels
from pipeline.board.six_channels import full_scale, shaping_table
from pipeline.errors import InputError
from solvers.shaping.modal_table import field_matrix, sensor_matrix
from solvers.shaping.travelling_wave import inner_window, travelling_wave_ratio, two_wave_fit
from solvers.shaping.voltages import REGIONS, contrast, region_points
from solvers.thesis.shaped_beam import LINE, ShapedBeam, patched, pointed
from solvers.thesis.shaping_study import ShapingData, travel_window

TONE = 2400.0
NAMES = ("left", "middle", "right", "left max", "mid max", "rightmax", "wave+", "wave-")


@pytest.fixture(scope="module")
def model() -> ShapedBeam:
    data = ShapingData()
    return pointed("150 mm, points", data.beam, data.modes)


def structure(model: ShapedBeam, noise: float = 1e-3) -> Structure:
    """The study's own modes, all of them, with noise and full scales as the table's."""
    table, scale = model.table, full_scale(model, "displacement", (TONE,))
    return Structure(
        table.angular, float(table.quality_factor[0]), scale * table.actuators, table.field[:, LINE:], noise=noise
    )


@pytest.fixture(params=["here", pytest.param("image", marks=pytest.mark.slow)])
def board(request, model, make_image, core):
    """The core on this machine, which test_six compares with the image bit for bit; slow: the image itself."""
    table = to_bytes(shaping_table(model, "displacement", (TONE,)))
    if request.param == "here":
        from tests.helpers.hosted_boards import HostedSix

        made = HostedSix(table, structure(model))
    else:
        pytest.importorskip("unicorn", reason="unicorn is not installed: pip install unicorn")
        from firmware.emulate.images import EmulatedSix

        made = EmulatedSix(make_image(table, "six").elf, structure(model))
    made.run(5e-3)
    made.app.base.confirmed = True
    return made


def order(board, name: str, *arguments: float) -> int:
    """A function of the application, on this machine or on the emulated board."""
    if hasattr(board, "lib"):
        return getattr(board.lib, name)(board.app, *arguments)
    return board.call(name, board.symbol("app"), *arguments)


def play(board, name: str, seconds: float = 0.4) -> np.ndarray:
    """Holds a pattern; returns the drives."""
    pattern = NAMES.index(name)
    arguments = ("an_six_start", pattern, 0.0) if board.state == 0 else ("an_six_change", pattern)
    assert order(board, *arguments) == 1
    board.run(seconds)
    assert board.state == 2, hex(board.faults)
    return board.drives


@pytest.mark.slow
def test_the_image_confines_left_middle_and_right_as_the_inverse_of_t_would(board, model: ShapedBeam) -> None:
    """Ratios of the largest motion inside over outside: 4.6, 3.1 and 4.6 with the study's own inverse; here within 4 %."""
    targets = from_bytes(to_bytes(shaping_table(model, "displacement", (TONE,)))).shapes[0].patterns
    for region, pattern in zip(REGIONS, targets, strict=False):
        field = model.field(TONE) @ play(board, pattern.name)
        inside = region_points(region, model.places_m, model.line_m)
        exact = np.linalg.solve(model.matrix(TONE, "displacement"), np.array(pattern.targets))
        ideal = contrast(model.field(TONE) @ exact, inside)
        result = contrast(field, inside)
        assert result.peak_ratio == pytest.approx(ideal.peak_ratio, rel=0.04), region
        assert result.peak_ratio > 3.0 and result.contrast_db > 15.0, region


def test_the_image_makes_waves_that_travel_both_ways(board, model: ShapedBeam) -> None:
    """TWR 0.9975 with the study's best voltages; the wave that goes back is below 1 % of the one that goes forward."""
    window = inner_window(model.line_m, *travel_window(model, TONE))
    guess = 2.0 * pi / model.free_wavelength_m(TONE)
    for name, forward in (("wave+", True), ("wave-", False)):
        field = (model.field(TONE) @ play(board, name))[window]
        fit = two_wave_fit(model.line_m[window], field, guess)
        with_it, against = abs(fit.forward), abs(fit.backward)
        assert (with_it > 100.0 * against) if forward else (against > 100.0 * with_it)
        assert travelling_wave_ratio(field) > 0.98


def test_the_table_holds_the_studys_matrix_with_the_hold_in_it(model: ShapedBeam) -> None:
    from firmware.mode_table import hold

    table = shaping_table(model, "displacement", (2200.0, TONE))
    assert [pattern.name for pattern in table.shapes[1].patterns] == list(NAMES)
    scale = full_scale(model, "displacement", (2200.0, TONE))
    for shape in table.shapes:
        exact = scale * model.matrix(shape.frequency_hz, "displacement") * hold(shape.frequency_hz, 40e3)
        assert np.array(shape.matrix) == pytest.approx(exact, rel=1e-12)
    assert shape.tau_s == pytest.approx(2.0 * 50.0 / model.table.angular[0])
    with pytest.raises(InputError, match="at most 2"):
        shaping_table(model, "displacement", (1e3, 2e3, 3e3))


def test_the_emulated_clamped_beam_is_the_solvers(model: ShapedBeam) -> None:
    """Shapes and frequencies to mode 20, where the textbook's cosh and sinh would cancel."""
    from solvers.analytic.beams import beam_mode

    beam = Beam(modes=20)
    at = np.linspace(0.0, 1.0, 97)
    for mode, shape in enumerate(beam.shapes(at * beam.length_m), 1):
        exact = beam_mode("clamped", "clamped", mode).shape(at)
        sign = np.sign(exact[3] * shape[3])
        assert np.abs(shape - sign * exact).max() < 1e-9, mode
    assert beam.angular / 2.0 / pi == pytest.approx(
        np.sqrt(
            beam.young_pa / 7850.0 / (model.beam.material.as_isotropic.young_pa / model.beam.material.density_kg_m3)
        )
        * model.table.frequencies_hz,
        rel=1e-9,
    )


def test_a_structure_answers_as_its_matrix(model: ShapedBeam) -> None:
    exact = full_scale(model, "displacement", (TONE,)) * model.matrix(TONE, "displacement")
    assert structure(model).matrix(TONE) == pytest.approx(exact, rel=1e-12)


def test_the_command_writes_a_table_for_the_real_patches(tmp_path: Path, capsys) -> None:
    file = tmp_path / "six.bin"
    assert six_channels.main([str(file), "--frequency", "2.4kHz"]) == 0
    table = from_bytes(file.read_bytes())
    assert table.shapes[0].frequency_hz == TONE and table.sample_rate_hz == 40e3
    metres = table.shapes[0].metres_per_volt
    said = capsys.readouterr().out
    assert "matrix identified, patterns left, middle, right" in said and f"{1e6 * metres:.4g} um/V" in said
    data = ShapingData()
    own = patched("", data.beam, data.modes, data.calibrate_near_hz)
    tone, driver = (
        float(own.table.frequencies_hz[own.calibrated_on]),
        np.argmax(np.abs(own.table.actuators[own.calibrated_on])),
    )
    under, volts = field_matrix(own.table, tone)[LINE, driver], sensor_matrix(own.table, tone)[0, driver]
    assert metres == pytest.approx(abs(under / volts), rel=1e-6)
    assert six_channels.main([str(file), "--points", "--unmeasured"]) == 0
    assert all(shape.matrix is None and not shape.metres_per_volt for shape in from_bytes(file.read_bytes()).shapes)
    assert six_channels.main([str(file), "--frequency", "loud"]) == 2
    error = capsys.readouterr().err
    assert "loud" in error and error.count("\n") == 1


def test_tones_that_the_board_refuses_are_not_exported(tmp_path: Path, capsys, core) -> None:
    """The limit is the board's own, and what is chosen without being asked for keeps it."""
    assert six_channels.MIN_SHAPE_HZ == core.lib.AN_SIX_FREQUENCY_MIN_HZ
    assert MIN_MODE_HZ == core.lib.AN_SINGLE_FREQUENCY_MIN_HZ
    assert six_channels.BAND_HZ[0] == six_channels.MIN_SHAPE_HZ
    assert six_channels.main([str(tmp_path / "low.bin"), "--points", "--frequency", "260Hz"]) == 2
    assert "350 Hz" in capsys.readouterr().err and not (tmp_path / "low.bin").exists()
