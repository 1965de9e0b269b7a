"""The sweep that identifies a mode, answered by an exact plate: where it aims, and each way in which it gives up."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable

import pytest

RATE_HZ, TRUE_HZ, TAU_S, GAIN, DELAY_S = 250e3, 31437.3, 3.04e-3, 0.8, 9.3e-6
COARSE, RAISE, FINE, SURVEY, CHECK, DONE, FAILED, AGREES, DIFFERS = range(9)
Plate = Callable[["Swept", float], complex]


def exact(swept: Swept, hz: float) -> complex:
    """One mode of a velocity sensor, behind its delay."""
    return swept.own(hz)


class Swept:
    """A sweep whose every measurement is answered by a function of the frequency: sensor over drive."""

    def __init__(self, core, plate: Plate = exact, **changes) -> None:
        self.ffi, self.lib = core
        self.plate, self.lag = plate, -1j if changes.pop("displacement", False) else 1.0
        self.ident, mode = self.ffi.new("an_ident *"), self.ffi.new("an_mode *")
        self.true_hz, self.tau_s = changes.pop("true_hz", TRUE_HZ), TAU_S
        values = {"frequency_hz": self.true_hz - 30.0, "tau_s": TAU_S, "drive_limit": 1.0, "amplitude_limit": 1.0}
        for name, value in (values | changes).items():
            setattr(mode, name, value)
        self.lib.an_ident_init(self.ident, mode, self.lag != 1.0, RATE_HZ)
        self.levels: list[float] = []

    def own(self, hz: float) -> complex:
        """The mode's response."""
        turn = cmath.exp(-2j * math.pi * hz * DELAY_S)
        return self.lag * turn * GAIN / (1.0 + 2j * math.pi * self.tau_s * (hz - self.true_hz))

    def answer(self, value: complex | None = None, noise2: float = 0.0) -> None:
        """Answer one measurement, by the plate unless a value is given."""
        probe = self.ffi.new("an_probe *")
        self.lib.an_ident_probe(self.ident, probe)
        self.levels.append(probe.level)
        response = self.plate(self, probe.step * RATE_HZ / 2.0**32) if value is None else value / probe.level
        self.lib.an_ident_answer(self.ident, [probe.level * response.real, probe.level * response.imag], noise2)

    def until(self, *stages: int, noise2: float = 0.0) -> int:
        """Answer until one of the stages, or an end, is reached."""
        while self.ident.stage < DONE and self.ident.stage not in stages:
            self.answer(noise2=noise2)
        return int(self.ident.stage)


@pytest.mark.parametrize("displacement", [False, True])
def test_an_exact_plate_is_measured_exactly(core, displacement: bool) -> None:
    swept = Swept(core, displacement=displacement)
    assert swept.until() == DONE and swept.ident.repeats == 0
    mode, rate_hz = swept.ident.mode, 0.5 / math.pi / TAU_S
    assert mode.frequency_hz == pytest.approx(TRUE_HZ + 0.5 * rate_hz**2 / TRUE_HZ, abs=0.01)  # the undamped one
    assert mode.tau_s == pytest.approx(TAU_S, rel=1e-3)
    assert complex(mode.gain.re, mode.gain.im) == pytest.approx(GAIN * swept.lag, abs=2e-3)
    assert mode.delay_s == pytest.approx(DELAY_S, abs=1e-8) and swept.ident.neighbour < 2e-3


@pytest.mark.parametrize(("true_hz", "span_hz"), [(31437.3, 1500.0), (8000.0, 800.0)])
def test_the_survey_reaches_as_far_as_neighbours_matter(core, true_hz: float, span_hz: float) -> None:
    """1500 Hz, or a tenth of the frequency; as many points as there are decide where a plate is that sharp."""
    swept = Swept(core, true_hz=true_hz)
    assert swept.until(SURVEY) == SURVEY
    half_width_hz = 0.5 / math.pi / TAU_S
    assert span_hz - half_width_hz < swept.ident.span_hz < span_hz + 2.0 * half_width_hz


@pytest.mark.parametrize(("limit", "level"), [(1.0, 0.01), (0.05, 0.008)])
def test_the_first_level_is_a_hundredth_or_what_the_limit_allows(core, limit: float, level: float) -> None:
    swept = Swept(core, drive_limit=limit)
    swept.answer()
    assert swept.levels == [pytest.approx(level)]


@pytest.mark.parametrize(
    ("gain", "limit", "amplitude", "level"),
    [(0.5, 1.0, 1.0, 0.04), (0.5, 1.0, 0.04, 0.02), (0.01, 1.0, 1.0, 0.16), (0.01, 0.5, 1.0, 0.08)],
)
def test_a_check_aims_at_a_fiftieth_within_the_limits(
    core, gain: float, limit: float, amplitude: float, level: float
) -> None:
    known = core.ffi.new("an_mode *", [TRUE_HZ, TAU_S, [gain, 0.0], 0.0, limit, amplitude, 0.0])
    swept = Swept(core)
    core.lib.an_ident_check(swept.ident, known, core.lib.an_dds_step(TRUE_HZ, RATE_HZ), RATE_HZ)
    swept.answer(gain * level)
    assert swept.levels == [pytest.approx(level)] and swept.ident.stage == AGREES


@pytest.mark.parametrize("factor", [0.2, 5.0, -1.0, 0.0])
def test_a_check_that_shows_another_plate_differs(core, factor: float) -> None:
    known = core.ffi.new("an_mode *", [TRUE_HZ, TAU_S, [0.5, 0.0], 0.0, 1.0, 1.0, 0.0])
    swept = Swept(core)
    core.lib.an_ident_check(swept.ident, known, core.lib.an_dds_step(TRUE_HZ, RATE_HZ), RATE_HZ)
    swept.answer(factor * 0.02)
    assert swept.ident.stage == DIFFERS


def test_only_noise_raises_the_level_to_a_sixth_and_no_further(core) -> None:
    swept = Swept(core, lambda swept, hz: 1e-3 / swept.ident.level, drive_limit=0.5)
    assert swept.until(noise2=1e-6) == FAILED
    assert sorted(set(swept.levels)) == pytest.approx([0.01, 0.04, 0.08])


def test_a_response_without_a_peak_is_no_resonance(core) -> None:
    swept = Swept(core, lambda swept, hz: 0.5)
    assert swept.until() == FAILED and set(swept.levels) == {swept.levels[0]}


def test_a_response_too_strong_at_every_level_ends_the_sweep(core) -> None:
    """A quarter each time, down to a ten-thousandth of full scale."""
    swept = Swept(core)
    while swept.ident.stage == COARSE:
        swept.answer(0.6)
    assert swept.ident.stage == FAILED
    assert swept.levels == pytest.approx([0.01 / 4.0**n for n in range(4)])


def test_a_level_that_was_too_strong_is_not_raised_again(core) -> None:
    swept = Swept(core, lambda swept, hz: 0.0)
    swept.answer(0.6)
    assert swept.until() == FAILED and swept.levels[1:] == [pytest.approx(0.0025)] * (len(swept.levels) - 1)


@pytest.mark.parametrize("factor", [0.3, 3.5])
def test_a_response_that_does_not_rise_with_the_drive_ends_the_sweep(core, factor: float) -> None:
    swept = Swept(core, lambda swept, hz: (factor if swept.ident.stage == RAISE else 1.0) * swept.own(hz))
    assert swept.until(FINE) == FAILED


def moved(swept: Swept, hz: float) -> complex:
    """It jumps by most of a bandwidth before each fine sweep, so that no two agree."""
    if swept.ident.stage == FINE and swept.ident.index == 0:
        swept.true_hz += 0.8 / math.pi / TAU_S
    return swept.own(hz)


def scattered(swept: Swept, hz: float) -> complex:
    wrong = 0.05 * GAIN * (-1.0) ** swept.ident.index if swept.ident.stage == FINE else 0.0
    return swept.own(hz) + wrong


def damped(factor: float) -> Plate:
    def plate(swept: Swept, hz: float) -> complex:
        swept.tau_s = TAU_S * (factor if swept.ident.stage == FINE else 1.0)
        return swept.own(hz)

    return plate


@pytest.mark.parametrize("plate", [moved, scattered, damped(9.0), damped(0.1)])
def test_a_fine_sweep_that_fits_no_plate_is_repeated_twice_and_given_up(core, plate: Plate) -> None:
    """Sweeps that never agree, a response that no mode explains, a time constant eight times another than was guessed."""
    swept = Swept(core, plate)
    assert swept.until(SURVEY) == FAILED and swept.ident.repeats == 2
    assert swept.levels[-1] == pytest.approx(max(swept.levels) / 16.0)


def test_a_plate_that_falls_silent_ends_the_sweep_at_once(core) -> None:
    swept = Swept(core, lambda swept, hz: 0.0 if swept.ident.stage == FINE else swept.own(hz))
    assert swept.until() == FAILED and swept.ident.repeats == 0


@pytest.mark.parametrize(("amplitude", "repeats"), [(1.0, 2), (0.08, 0)])
def test_a_gain_that_falls_with_the_level_is_measured_lower_unless_noise_is_near(
    core, amplitude: float, repeats: int
) -> None:
    """A peak of a hundredth of full scale is the least that is swept again."""
    swept = Swept(
        core,
        lambda swept, hz: (0.8 if swept.ident.stage == FINE else 1.0) * swept.own(hz),
        amplitude_limit=amplitude,
    )
    assert swept.until(SURVEY) == SURVEY and swept.ident.repeats == repeats


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("stage", [COARSE, FINE, SURVEY])
def test_what_is_no_number_ends_the_sweep(core, value: float, stage: int) -> None:
    swept = Swept(core)
    swept.until(stage)
    swept.answer(complex(value, 0.0))
    assert swept.ident.stage == FAILED


def test_a_sweep_lasts_a_minute_at_most(core) -> None:
    swept = Swept(core)
    swept.answer()
    swept.ident.elapsed_s = 59.9
    swept.answer()
    assert swept.ident.stage == COARSE
    swept.ident.elapsed_s = 60.0
    swept.answer()
    assert swept.ident.stage == FAILED


def test_an_answer_after_the_end_changes_nothing(core) -> None:
    swept = Swept(core)
    assert swept.until() == DONE
    swept.answer(1.0)
    assert swept.ident.stage == DONE
