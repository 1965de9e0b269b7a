"""Identification by chirps: a blank board with a table of a plate up to 3 % off, on the rig with its serial line."""

from __future__ import annotations

import cmath
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from firmware.client import identify as identification
from firmware.client import margins
from firmware.client.chirp import SAMPLE_S, WINDOW, WINDOW_S, Mode, Sweep
from firmware.client.client import BoardError, Client, Refused
from firmware.client.identify import Found, NotIdentified, describe, draw, identify
from firmware.emulate.plant import Plate, Resonance
from firmware.mode_table import Mode as TableMode
from firmware.mode_table import ModeTable, hold, to_bytes
from firmware.protocol import FAULT, IDENTIFY, IDLE, RUN, Chirp, Fault, Measured
from tests.helpers.hosted_boards import Rig, RigPort

TRUE, GAIN, DELAY_S, NOISE = 31437.3, 0.8, 7.3e-6, 1e-3


class Clock:
    """The time of a port, in the place of the computer's: a busy machine is no silent board."""

    def __init__(self, port: RigPort) -> None:
        self.port = port

    def monotonic(self) -> float:
        """Seconds that the board has run."""
        return self.port.elapsed_s

    def sleep(self, seconds: float) -> None:
        """Let the board run."""
        self.port.rig.run(seconds)
        self.port.elapsed_s += seconds


class Bench:
    """A rig with a client on its serial line."""

    def __init__(
        self, quality_factor: float, away: float = 0.0, true: float = TRUE, gain: float = GAIN, **changes
    ) -> None:
        table = TableMode(true / (1.0 + away), 3e-3, delay_s=2e-6, **changes.pop("table", {}))
        self.own = Resonance(true, quality_factor / (math.pi * true), gain)
        others = [
            replace(self.own, frequency_hz=true + hz, gain=share * gain) for hz, share in changes.pop("others", ())
        ]
        plate = Plate((self.own, *others), **{"delay_s": DELAY_S, "noise": NOISE, **changes})
        self.rig = Rig(to_bytes(ModeTable(250e3, bytes(16), (table,))), plate, confirmed=False)
        self.rig.run(5e-3)
        self.port = RigPort(self.rig)
        self.client = Client(self.port)
        identification.time = Clock(self.port)  # type: ignore[attr-defined]

    @property
    def gain(self) -> float:
        """Gain with the droop of the hold."""
        return self.own.gain * abs(hold(self.own.frequency_hz, 250e3))

    def held(self, seconds: float = 0.5) -> float:
        """Start at the lowest useful level; the error of the motion relative to the reference afterwards."""
        self.client.start()
        for _ in range(round(seconds / 0.1)):
            self.rig.run(0.1)
            self.client.status()
        assert self.rig.state == RUN, hex(self.rig.faults)
        windows = self.rig.windows(0.05)
        return float(np.abs(windows["measured"]).mean() / windows["reference"][-1] - 1.0)

    def refused(self) -> str:
        """The line with which identification is refused; nothing is loaded, and the board rests without a fault."""
        with pytest.raises(NotIdentified) as raised:
            identify(self.client)
        assert self.rig.app.base.measured == 0 and not self.client.drives
        assert self.rig.state == IDLE and self.rig.faults == 0
        text = str(raised.value)
        assert text.startswith("identify: ") and "\n" not in text
        return text


@pytest.fixture(autouse=True)
def own_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give the client's clock back after a bench has replaced it."""
    monkeypatch.setattr(identification, "time", identification.time)  # type: ignore[attr-defined]


def close(found: Found, bench: Bench, hz: float, share: float) -> bool:
    values, own = found.values, bench.own
    return (
        abs(values.frequency_hz - own.frequency_hz) < hz
        and abs(values.tau_s / own.tau_s - 1.0) < share
        and abs(abs(values.gain) / bench.gain - 1.0) < share
    )


@pytest.mark.parametrize("away", [-0.03, 0.03])
@pytest.mark.parametrize("quality_factor", [30.0, 100.0, 300.0, 1000.0])
def test_a_plate_three_percent_off_is_held_within_ten_seconds(core, quality_factor: float, away: float) -> None:
    """At Q = 30 one pole stands for a resonance up to terms of 1/Q: 3 %."""
    bench = Bench(quality_factor, away)
    found = identify(bench.client)
    assert close(found, bench, TRUE / quality_factor / 500.0, max(0.01, 1.0 / quality_factor))
    assert found.values.delay_s == pytest.approx(DELAY_S + 2e-6, abs=0.1e-6)
    assert found.coherence > 0.999 and found.fit.misfit < 0.005 and len(found.fit.modes) == 1
    assert found.loop.holds and found.loop.phase_deg > 65.0
    assert abs(bench.held()) < 1e-3
    assert bench.port.elapsed_s + 0.5 < 10.0
    assert found.seconds == pytest.approx(bench.port.elapsed_s, abs=0.05)


@pytest.mark.parametrize("true", [15e3, 62.4e3, 95e3])
def test_other_frequencies(core, true: float) -> None:
    bench = Bench(1000.0, 0.03, true)
    found = identify(bench.client)
    assert close(found, bench, true / 1000.0 / 100.0, 0.01)
    assert abs(bench.held(0.2)) < 1e-3 and bench.port.elapsed_s < 10.0


@pytest.mark.slow
@pytest.mark.parametrize(("true", "noise"), [(2.06e3, 1e-4), (4e3, NOISE), (8e3, NOISE)])
def test_a_slow_plate_is_held_within_ten_seconds(core, true: float, noise: float) -> None:
    """Of a table of 2 kHz, the lowest, too. Three sweeps settle for five time constants, and record ten, twenty and ten."""
    bench = Bench(1000.0, 0.03, true, noise=noise)
    found = identify(bench.client)
    if true < 8e3:
        assert found.seconds < 1.15 * 55.0 * bench.own.tau_s
    assert close(found, bench, true / 1000.0 / 100.0, 0.01) and found.coherence > 0.999
    bench.client.start()
    checked = 0.0
    while bench.rig.state == IDENTIFY:
        checked += bench.rig.run_while(IDENTIFY, 0.2)
        bench.client.status()
    assert bench.rig.state == RUN and found.seconds + checked < 10.0
    bench.client.stop()
    bench.rig.run(0.5)
    assert abs(bench.held(2.0)) < 1e-3


@pytest.mark.parametrize(
    ("quality_factor", "hz", "share"),
    [(300.0, 60.0, 0.5), (300.0, 60.0, -0.5), (1000.0, 20.0, 0.5), (1000.0, -60.0, -0.6)],
)
def test_a_second_mode_close_by_is_told_apart(core, quality_factor: float, hz: float, share: float) -> None:
    bench = Bench(quality_factor, 0.01, others=((hz, share),))
    found = identify(bench.client)
    first, second = found.fit.modes
    assert close(found, bench, 0.3, 0.01)
    assert second.away_hz - first.away_hz == pytest.approx(hz, abs=0.5)
    assert (second.gain / first.gain).real == pytest.approx(share, abs=0.02)
    assert "another one at" in describe(found)
    assert found.loop.holds and found.loop.proportional * abs(second.gain) <= 0.5
    assert abs(bench.held()) < 2e-3


@pytest.mark.parametrize("sensor", ["RIG_REVERSED", "RIG_DEAD"])
@pytest.mark.parametrize(("half_bandwidths", "share"), [(2.0, -0.5), (-2.0, 0.7)])
def test_close_modes_of_little_damping_are_held_and_their_sensor_is_watched(
    core, half_bandwidths: float, share: float, sensor: str
) -> None:
    """Their loop is slow: for as long, the second mode may answer the drive with another sign than the first one."""
    true = 14e3
    bench = Bench(1000.0, 0.01, true, others=((half_bandwidths * 0.5 * true / 1000.0, share),))
    found = identify(bench.client)
    assert len(found.fit.modes) == 2 and found.loop.proportional * bench.gain < 1.0
    assert abs(bench.held(1.0)) < 2e-3
    bench.client.reference(0.1)
    bench.rig.run(5e-3)
    bench.rig.rig.plate.sensor = getattr(bench.rig.lib, sensor)
    bench.rig.run(0.2)
    assert bench.rig.state == FAULT and bench.rig.faults == Fault.MISMATCH


@pytest.mark.parametrize("away", [-0.03, 0.01])
def test_a_plate_among_modes_farther_off_is_held(core, away: float) -> None:
    """Places in half-bandwidths and shares of the gain: of a plate of three rows, whose strongest neighbour is far off."""
    modes = (-22.7, 0.0), (-21.6, -0.115), (-15.8, -0.019), (-10.7, -0.037), (12.1, -0.013), (16.3, 0.13)
    half = 34810.0 / (2.0 * 300.8)
    bench = Bench(300.8, away, 34810.0, 1.175, others=tuple((at * half, share) for at, share in modes))
    found = identify(bench.client)
    assert close(found, bench, 0.02 * half, 0.01) and len(found.fit.modes) == 1
    assert found.loop.holds and found.fit.misfit < identification.MISFIT_MOST
    assert abs(bench.held()) < 2e-3


@pytest.mark.parametrize("half_bandwidths", [-1.0, 1.0])
@pytest.mark.parametrize("quality_factor", [pytest.param(100.0, marks=pytest.mark.slow), 300.0, 1000.0])
def test_a_plate_that_softens_or_stiffens_is_measured_at_a_lower_level(
    core, quality_factor: float, half_bandwidths: float
) -> None:
    """By a half-bandwidth at 0.36 of full scale: at the level of the measurement at most 0.05 of one."""
    bench, half_hz = Bench(quality_factor, -0.01), 0.5 * TRUE / quality_factor
    bench.rig.rig.plate.softening = 2.0 * math.pi * half_bandwidths * half_hz / 250e3 / 0.36
    found = identify(bench.client)
    assert found.values.motion < 0.07 and close(found, bench, 0.05 * half_hz, 0.02)
    assert abs(bench.held()) < 2e-3


def test_a_plate_that_softens_at_the_least_level_too_is_refused(core) -> None:
    """At 0.028 of the drive limit; a third of that is the least level, so that they cannot differ four times."""
    bench = Bench(300.0, -0.01, gain=4.0)
    bench.rig.rig.plate.softening = 2.0 * math.pi * 2.0 * TRUE / 300.0 / 250e3 / 0.36
    assert re.search(r"changes by 2. % with the level, at 0.02", bench.refused())


def test_levels_too_close_to_compare_are_told(core) -> None:
    found = identify(Bench(300.0, 0.02).client)
    assert "level" not in describe(found) and "not compared with a lower level" in describe(replace(found, bent=None))


@pytest.mark.parametrize(("quality_factor", "gain"), [(300.0, 0.02), (1000.0, 0.05)])
def test_the_steps_of_the_converter_are_not_taken_for_a_plate_that_bends(
    core, quality_factor: float, gain: float
) -> None:
    """Without noise, a quarter of the level leaves a few steps of the ADC, or none."""
    bench = Bench(quality_factor, 0.02, gain=gain, noise=0.0)
    found = identify(bench.client)
    share = identification.STEPS_ERROR / gain + 1.0 / quality_factor
    assert found.bent == 0.0 and close(found, bench, share * TRUE / quality_factor, share)
    assert abs(bench.held()) < share


def test_an_amplifier_that_clips_is_measured_where_it_does_not(core) -> None:
    bench = Bench(300.0, 0.02)
    bench.rig.rig.plate.swing = 0.1
    found = identify(bench.client)
    assert found.response.level <= 0.1 and close(found, bench, 0.3, 0.01)


@pytest.mark.parametrize("noise", [1e-2, 2e-2])
def test_noise_costs_accuracy_only(core, noise: float) -> None:
    bench = Bench(300.0, 0.03, noise=noise)
    found = identify(bench.client)
    assert close(found, bench, 1.0, 0.02) and found.values.misfit < 0.01
    bench.held()


@pytest.mark.parametrize("limits", [{"amplitude_limit": 0.05, "drive_limit": 0.1}, {"drive_limit": 0.02}])
def test_the_limits_of_the_table_are_kept(core, limits: dict) -> None:
    bench = Bench(300.0, 0.03, table=limits)
    found = identify(bench.client)
    assert found.values.motion <= 0.5 * limits.get("amplitude_limit", 0.8) and close(found, bench, 1.0, 0.02)


def hold_fast(bench: Bench, when: Callable[[int], bool]) -> None:
    """A hand damps the plate in some of the recordings."""
    plate, count, chirp = bench.rig.plate, 0, bench.client.chirp

    def touched(request: Chirp) -> None:
        nonlocal count
        count += 1
        bench.rig.touch(0.2 if when(count) else 1.0, 0.0, plate)
        chirp(request)

    bench.client.chirp = touched  # type: ignore[method-assign]


REFUSED: dict[str, tuple[Callable[[], Bench], str]] = {
    "far below": (lambda: Bench(300.0, -0.06), "6.0 % from the table's"),
    "far above": (lambda: Bench(1000.0, 0.05), "5.0 % from the table's"),
    "nothing": (lambda: Bench(300.0, gain=1e-5), "no response within 4 %"),
    "noise": (lambda: Bench(300.0, gain=0.02, noise=0.1), "no response within 4 %"),
    "flat": (lambda: Bench(300.0, gain=1e-5, feedthrough=0.5), "flat, not a resonance"),
    "alike": (lambda: Bench(300.0, others=((150.0, 0.97),)), "respond alike"),
    "against each other": (lambda: Bench(300.0, others=((60.0, -0.8),)), "respond alike"),
    "opposed": (lambda: Bench(100.0, others=((30.0, -0.85),), noise=5e-3), "cannot be told apart"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_a_response_that_supports_no_values_is_refused(core, what: str) -> None:
    make, words = REFUSED[what]
    text = make().refused()
    assert words in text and text.count(": ") >= 2  # what is wrong, and what to do


@pytest.mark.parametrize("sensor", ["RIG_DEAD", "RIG_STUCK"])
def test_a_lost_sensor_is_refused(core, sensor: str) -> None:
    bench = Bench(300.0)
    bench.rig.rig.plate.sensor = getattr(bench.rig.lib, sensor)
    assert "no response" in bench.refused()


@pytest.mark.parametrize("when", [lambda count: count % 2 == 1, lambda count: count > 2])
def test_a_hand_during_the_measurement_never_loads_a_wrong_mode(core, when: Callable[[int], bool]) -> None:
    """It is refused, or what is loaded is the plate with or without the hand."""
    bench = Bench(300.0)
    hold_fast(bench, when)
    try:
        tau_s = identify(bench.client).values.tau_s
    except NotIdentified as error:
        assert "hands off" in str(error) and bench.rig.app.base.measured == 0
    else:
        assert min(abs(tau_s / bench.own.tau_s - 1.0), abs(tau_s / bench.own.tau_s - 0.2)) < 0.05


def test_recordings_that_disagree_are_refused(core) -> None:
    """A hand in one recording of three: what is left to tell is the coherence."""
    bench = Bench(1000.0)
    hold_fast(bench, lambda count: count == 4)
    assert "coherence 0." in bench.refused()


@pytest.mark.slow
def test_report_and_picture(core, tmp_path: Path) -> None:
    bench = Bench(300.0, 0.02, others=((60.0, -0.5),))
    found = identify(bench.client)
    text = describe(found)
    assert "31437." in text and "+2.00 % from the table" in text and "fit of 2 modes" in text
    assert f"phase margin {found.loop.phase_deg:.0f} deg (at least 60)" in text and "coherence 1.0000" in text
    for name in ("a.png", "a.svg", "a.pdf"):
        draw(tmp_path / name, found.response, found.fit)
    drawn = (tmp_path / "a.svg").read_text()
    assert drawn.count("<use ") > len(found.response.sweep.lines_hz)  # one mark per line, and more
    draw(tmp_path / "b.png", found.response, None)


def test_the_report_speaks_metres_where_the_table_has_them(core) -> None:
    """Full scale is 4 um at the sensor and 1.65 V at the DAC."""
    found = identify(Bench(300.0, table={"metres_per_volt": 4e-6 / 1.65}).client)
    gain, loop = abs(found.values.gain), found.loop
    text = describe(found)
    assert found.metres == pytest.approx(4e-6, rel=1e-6)
    assert f"gain {gain * 4.0 / 1.65:.4g} um/V" in text and f"up to {4.0 * found.values.motion:.2g} um" in text
    assert f"proportional gain {loop.proportional * 1.65 / 4.0:.3g} V/um" in text
    assert f"neighbours up to {loop.neighbour * 4.0 / 1.65:.3g} um/V" in text and "full scale" not in text
    assert " um" not in describe(replace(found, metres=0.0))


def test_values_out_of_range_are_refused_by_the_board(core) -> None:
    bench = Bench(300.0)
    values = Measured(31e3, 3e-3, 0.5j, 9e-6, 0.01, 0.3, 0.001)
    wrong = [
        {"frequency_hz": 1e3}, {"frequency_hz": math.nan}, {"tau_s": 0.0}, {"tau_s": 11.0}, {"gain": 0j}, {"gain": 2e3j},
        {"delay_s": -1e-6}, {"delay_s": 2e-3}, {"neighbour": -0.1}, {"neighbour": math.inf}, {"motion": 1.1},
        {"misfit": math.nan},
    ]  # fmt: skip
    for change in wrong:
        with pytest.raises(Refused, match="out of range"):
            bench.client.set(replace(values, **change))
    assert bench.rig.app.base.measured == 0
    bench.client.set(values)
    assert bench.rig.app.base.measured == 1 and not bench.rig.app.base.confirmed
    chirp = Sweep(31e3, 512).request(0.1)
    for change in [
        {"level": 1.1},
        {"steps": 0},
        {"steps": 1025},
        {"every": 0},
        {"every": 40},
        {"settle": 0},
        {"settle": 1025},
        {"frequency_hz": 1.5e5},
    ]:
        with pytest.raises(Refused, match="out of range"):
            bench.client.chirp(replace(chirp, **change))
    bench.client.chirp(chirp)
    for request in (chirp, values):
        with pytest.raises(Refused, match="refused in the present state"):
            bench.client.set(request)


def test_wrong_values_are_found_by_the_check_and_measured_again(core) -> None:
    """Values of another plate, or of this one with its sign reversed."""
    bench = Bench(300.0)
    for wrong in (1000.0 * TRUE / 1000.0 + 900.0, TRUE):
        bench.client.set(Measured(wrong, bench.own.tau_s, 1j * bench.gain, DELAY_S + 2e-6, 0.01, 0.3, 0.001))
        bench.client.start()
        for _ in range(40):
            bench.rig.run(0.1)
            bench.client.status()
        assert bench.rig.state == RUN and bench.rig.frequency_hz == pytest.approx(TRUE, abs=0.3)
        bench.client.stop()
        bench.rig.run(0.1)


def test_a_chirp_ends_by_itself_and_a_silent_host_ends_the_job(core) -> None:
    bench = Bench(300.0)
    bench.client.chirp(Sweep(TRUE, 128).request(0.3))
    bench.rig.run(0.2)
    assert abs(bench.rig.app.fast.drive.re) + abs(bench.rig.app.fast.drive.im) > 0.0
    bench.rig.run(0.1)  # (128 + 1024) windows of 0.2 ms
    assert bench.rig.app.fast.drive.re == 0.0 and bench.rig.app.fast.drive.im == 0.0
    bench.rig.run(0.5)
    with pytest.raises(BoardError, match="faults host silent"):
        identification._check_drives(bench.client)


@pytest.mark.parametrize("neighbour", [0.0, 0.05, 0.6])
@pytest.mark.parametrize("quality_factor", [30.0, 300.0, 1000.0])
def test_the_gains_are_the_boards(core, quality_factor: float, neighbour: float) -> None:
    ffi, lib = core
    gains, mode, spec = ffi.new("an_pi_gains *"), ffi.new("an_mode *"), ffi.new("an_pi_spec *")
    tau_s = quality_factor / (math.pi * TRUE)
    mode.frequency_hz, mode.tau_s, mode.drive_limit = TRUE, tau_s, 1.0
    mode.gain.re = spec.free_gain = GAIN
    spec.period_s, spec.ahead_s, spec.response_s, spec.leaving_s = WINDOW_S, margins.AHEAD_S, margins.RESPONSE_S, 0.2e-3
    spec.proportional_max = margins.NEIGHBOUR_LOOP / neighbour if neighbour else 1e9
    lib.an_pi_plan(gains, mode, lib.an_dds_step(TRUE, 250e3), 0.0, spec)
    law = gains.law[0]
    found = margins.gains(Mode(0.0, tau_s, GAIN), neighbour)
    assert found == pytest.approx((law.proportional, law.integral, law.state.re, law.feed.re), rel=2e-4)


def decays(modes: tuple[Mode, ...], neighbour: float, factor: complex) -> bool:
    """Close the board's law around the modes' envelopes, sample by sample; true if a disturbance dies out.

    The new drive acts from the fifth sample of a period; the window's 46 samples begin one sample before.
    """
    law = margins.gains(modes[0], neighbour)
    poles = np.array([complex(-1.0 / mode.tau_s, 2.0 * math.pi * mode.away_hz) for mode in modes])
    powers = np.exp(np.outer(np.arange(51), poles) * SAMPLE_S)
    pushed = factor * np.array([mode.gain / mode.tau_s for mode in modes]) * (powers - 1.0) / poles
    state, integral, old, new, sizes = np.full(len(modes), 0.1 + 0j), 0j, 0j, 0j, []
    for _ in range(12000):
        before, start = (powers[n] * state + pushed[n] * old for n in (3, 4))
        seen = before.sum() + (powers[: WINDOW - 1] * start + pushed[: WINDOW - 1] * new).sum()
        state = powers[46] * start + pushed[46] * new
        measured = seen / WINDOW
        old, new = new, integral - law.state * measured - law.feed * new
        integral -= law.integral * measured
        sizes.append(abs(measured))
        if sizes[-1] > 1e3:
            return False
    return max(sizes[-1000:]) < 0.5 * max(sizes[1000:2000])


PLATES = {
    "one": (Mode(0.0, 3.04e-3, 0.8),),
    "damped": (Mode(0.0, 0.3e-3, 0.8),),
    "two": (Mode(0.0, 3.04e-3, 0.8), Mode(60.0, 3.04e-3, -0.4)),
    "far": (Mode(0.0, 3.04e-3, 0.8), Mode(700.0, 3.04e-3, 0.3)),
}


@pytest.mark.parametrize("plate", PLATES)
def test_the_loop_is_stable_within_its_margins_and_not_beyond(plate: str) -> None:
    modes, neighbour = PLATES[plate], 0.05
    loop = margins.loop(modes, 0.0, neighbour, 0.5 * SAMPLE_S)
    assert loop.stable
    gain, turn = 10.0 ** (loop.gain_db / 20.0), math.radians(loop.phase_deg)
    assert decays(modes, neighbour, 0.97 * gain) and not decays(modes, neighbour, 1.03 * gain)
    outcomes = [decays(modes, neighbour, cmath.rect(1.0, side * turn)) for side in (-0.96, 0.96, -1.04, 1.04)]
    assert all(outcomes[:2]) and not all(outcomes[2:])
