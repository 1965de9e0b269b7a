"""Control of one mode against a double-precision model of the same law and of the plate's baseband."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

PERIOD, AHEAD, RESPONSE, LEAVING = 200e-6, 108e-6, 0.53e-3, 0.2e-3
FREQUENCY, TAU, LIMIT = 31400.0, 300.0 / math.pi / 31400.0, 1.0


def planned(
    core,
    gain: complex,
    detuning_hz: float = 0.0,
    delay_s: float = 0.0,
    proportional_max: float = 1e9,
    ahead_s: float = AHEAD,
):
    mode = core.ffi.new(
        "an_mode *",
        {
            "frequency_hz": FREQUENCY,
            "tau_s": TAU,
            "gain": {"re": gain.real, "im": gain.imag},
            "delay_s": delay_s,
            "drive_limit": LIMIT,
            "amplitude_limit": 0.8,
        },
    )
    step = core.lib.an_dds_step(FREQUENCY + detuning_hz, 250e3)
    gains = core.ffi.new("an_pi_gains *")
    spec = {
        "period_s": PERIOD,
        "ahead_s": ahead_s,
        "response_s": RESPONSE,
        "leaving_s": LEAVING,
        "proportional_max": proportional_max,
        "noise2": 0.0,
        "free_gain": abs(gain),
    }
    core.lib.an_pi_plan(gains, mode, step, detuning_hz, core.ffi.new("an_pi_spec *", spec))
    return gains


def as_complex(value) -> complex:
    return complex(value.re, value.im)


class DoubleLaw:
    """V = Kp (r - U') + I + j tau dw U' / G, limited to a disc; U' = U when V begins to act.

    From the limit Kp is that of a pole of its own. I = U / G while limited and for the two steps after.
    """

    def __init__(self, gain: float, detuning_hz: float) -> None:
        self.gain, self.slope = gain, 2.0 * math.pi * detuning_hz * TAU
        self.integral, self.drive, self.reference = 0j, 0j, 0.0
        pole = math.exp(-PERIOD / TAU)
        self.integral_gain = (1.0 - math.exp(-PERIOD / RESPONSE)) / gain
        self.proportional = self.integral_gain / (1.0 - pole)
        self.leaving = (1.0 - math.exp(-PERIOD / LEAVING)) / gain / (1.0 - pole)
        self.limited = 0

    def step(self, measured: complex, reference: float) -> complex:
        decay = cmath.exp(-(1.0 + 1j * self.slope) * AHEAD / TAU)
        now = decay * measured + (1.0 - decay) * self.gain / (1.0 + 1j * self.slope) * self.drive
        proportional = self.leaving if self.limited == 2 else self.proportional
        target = proportional * (reference - now) + self.integral + 1j * self.slope / self.gain * now
        then = reference + AHEAD / PERIOD * (self.reference - reference)
        self.reference = reference
        if abs(target) > LIMIT:
            self.integral, self.limited = measured / self.gain, 2
            self.drive = target * LIMIT / abs(target)
        elif self.limited:
            self.integral, self.limited = measured / self.gain, self.limited - 1
            self.drive = target
        else:
            self.integral += self.integral_gain * (then - measured)
            self.drive = target
        return self.drive


class Baseband:
    """tau U' + (1 + j slope) U = G V, exact from tick to tick; U is measured as the mean over ticks 4 to 50 of a period."""

    def __init__(self, gain: float, detuning_hz: float) -> None:
        self.pole = -(1.0 + 2j * math.pi * detuning_hz * TAU) / TAU
        self.steady = gain / (1.0 + 2j * math.pi * detuning_hz * TAU)
        self.decay = cmath.exp(self.pole * PERIOD / 50)
        self.state, self.old = 0j, 0j

    def step(self, drive: complex) -> complex:
        path = []
        for tick in range(50):
            path.append(self.state)
            force = self.steady * (self.old if tick < 4 else drive)
            self.state = force + (self.state - force) * self.decay
        self.old = drive
        return sum(path[4:]) / 46


def closed_loop(core, gain: float, detuning_hz: float, reference: float, steps: int, law_gain: float = 0.0):
    """(measured, drive) a period each, by the core and by the double-precision law on plates of their own."""
    gains, pi = planned(core, law_gain or gain, detuning_hz), core.ffi.new("an_pi *")
    core.lib.an_pi_init(pi, gains, core.ffi.new("an_complex *")[0])
    law, plates = DoubleLaw(law_gain or gain, detuning_hz), (Baseband(gain, detuning_hz), Baseband(gain, detuning_hz))
    measured, result = [0j, 0j], []
    for _ in range(steps):
        z = core.ffi.new("an_complex *", {"re": measured[0].real, "im": measured[0].imag})[0]
        drive = as_complex(core.lib.an_pi_step(pi, gains, z, reference))
        exact = law.step(measured[1], reference)
        result.append((measured[0], drive, measured[1], exact))
        measured = [plates[0].step(drive), plates[1].step(exact)]
    return np.array(result)


@pytest.mark.parametrize("detuning_hz", [0.0, 100.0, -300.0, 300.0])
@pytest.mark.parametrize("reference", [0.1, 0.5])
def test_core_follows_the_double_precision_law(core, detuning_hz: float, reference: float) -> None:
    result = closed_loop(core, 0.8, detuning_hz, reference, 60)
    assert np.abs(result[:, 0] - result[:, 2]).max() < 2e-5
    assert np.abs(result[:, 1] - result[:, 3]).max() < 5e-4


def test_the_closed_loop_has_the_pole_that_its_description_states(core) -> None:
    """On the plant U -> a U + (1 - a) G V, measured without age, the error falls by p a step."""
    gains = planned(core, 0.8, ahead_s=0.0)
    pi, measured, errors = core.ffi.new("an_pi *"), 0.0, []
    core.lib.an_pi_init(pi, gains, core.ffi.new("an_complex *")[0])
    pole, p = math.exp(-PERIOD / TAU), math.exp(-PERIOD / RESPONSE)
    for _ in range(12):
        z = core.ffi.new("an_complex *", {"re": measured, "im": 0.0})[0]
        drive = as_complex(core.lib.an_pi_step(pi, gains, z, 0.1)).real
        errors.append(0.1 - measured)
        measured = pole * measured + (1.0 - pole) * 0.8 * drive
    assert np.array(errors[3:]) / np.array(errors[2:-1]) == pytest.approx(p, rel=2e-3)


@pytest.mark.parametrize("detuning_hz", [0.0, 300.0])
def test_small_steps_reach_95_percent_within_2_ms_without_overshoot(core, detuning_hz: float) -> None:
    reference = 0.1
    size = np.abs(closed_loop(core, 0.8, detuning_hz, reference, 100)[:, 0])
    assert np.argmax(size >= 0.95 * reference) * PERIOD <= 2.0e-3
    assert size.max() <= 1.02 * reference
    assert abs(size[-1] - reference) < 1e-4 * reference


def test_recovery_from_saturation_is_near_the_bound(core) -> None:
    gain, reference = 0.8, 0.5
    size = np.abs(closed_loop(core, gain, 0.0, reference, 100)[:, 0])
    settled = np.flatnonzero(np.abs(size - reference) > 0.05 * reference)[-1] + 1
    bound = -TAU * math.log(1.0 - 0.95 * reference / (gain * LIMIT))
    assert settled * PERIOD <= 1.5 * bound + 2 * PERIOD
    assert size.max() <= 1.02 * reference


def test_drive_never_leaves_the_disc(core) -> None:
    result = closed_loop(core, 0.8, 300.0, 0.75, 200, law_gain=0.4)
    assert np.abs(result[:, 1]).max() <= LIMIT * (1.0 + 1e-6)


def test_lead_undoes_one_sample_the_delay_and_the_phase_of_the_gain(core) -> None:
    gain, delay_s = 0.8 * cmath.exp(-1.2j), 9.3e-6
    lead = as_complex(planned(core, gain, 120.0, delay_s).lead)
    frequency_hz = FREQUENCY + 120.0
    expected = cmath.exp(2j * math.pi * frequency_hz * (4e-6 + delay_s) + 1.2j)
    assert abs(lead - expected) < 2e-5


def test_off_resonance_the_quadrature_takes_drive_as_well(core) -> None:
    """V = (1 + j (w - w0) tau) U / G."""
    for detuning_hz in (0.0, -300.0, 300.0):
        turning = planned(core, 0.8, detuning_hz).turning
        assert turning == pytest.approx(2.0 * math.pi * detuning_hz * TAU / 0.8, rel=1e-6)


def test_neighbours_bound_the_gain_and_the_zero_stays_on_the_pole(core) -> None:
    free, bounded = planned(core, 0.8), planned(core, 0.8, proportional_max=2.0)
    assert free.law[0].proportional > 4.0 and bounded.law[0].proportional == 2.0
    assert free.law[1].proportional > free.law[0].proportional and bounded.law[1].proportional == 2.0
    for gains in (free, bounded):
        law = gains.law[0]
        assert law.integral / law.proportional == pytest.approx(1.0 - math.exp(-PERIOD / TAU), rel=1e-4)
