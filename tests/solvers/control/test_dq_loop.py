"""The sampled loop against the plate's exact response, the envelope's recursion, its own margins and the firmware's code."""

from __future__ import annotations

import re
from dataclasses import replace
from math import inf, pi
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pipeline.active import thesis
from pipeline.active.thesis import beside
from pipeline.records.part import plain
from solvers.control.loop import (
    LEAVING_S,
    NEIGHBOUR_LOOP,
    Controller,
    ModePlant,
    Plate,
    Rates,
    Setup,
    feasibility,
    run,
    step_response,
)
from solvers.errors import SolverError
from solvers.thesis.loop_design import (
    FIRMWARE_RESPONSE_S,
    DqData,
    closed_loop_poles,
    dq_study,
    margins,
    planned_response_s,
    sampled_loop,
)

TRUE = 31_437.3
PLANT = ModePlant.from_quality_factor(TRUE, 300.0, 0.8)
IDEAL = Rates(bits=0)
BASE = Setup((PLANT,), delay_s=7.3e-6, rates=IDEAL)
PERIOD = 200e-6


def hold(frequency_hz: float, rate_hz: float = 250e3) -> complex:
    turn = 2j * pi * frequency_hz / rate_hz
    return (1 - np.exp(-turn)) / turn


@pytest.mark.parametrize("delay", [0.0, 1.3e-6, 4e-6, 9.7e-6])
@pytest.mark.parametrize("gain", [0.8, -0.5j])
def test_plate_in_time_is_the_plate_in_frequency(delay, gain):
    """Steady phasor = (sum of modes) e^{-j omega delay} times the hold, one sample late."""
    modes = (
        ModePlant.from_quality_factor(TRUE, 300.0, gain),
        ModePlant.from_quality_factor(TRUE + 900.0, 250.0, 0.1 * gain),
    )
    setup = Setup(modes, detuning_hz=40.0, delay_s=delay, rates=IDEAL)
    plate, control = Plate(setup), Controller(setup)
    result = [control.fit(plate.period(0.5, 0.5)) for _ in range(300)][-1]
    frequency = TRUE + 40.0
    turn = 2j * pi * frequency
    expected = 0j
    for mode in modes:
        if isinstance(gain, complex):  # displacement: omega_0 over j omega times a velocity response
            size = 1j * mode.gain
            expected += size * mode.omega_rad_s / turn * complex(replace(mode, gain=1.0).response(2 * pi * frequency))
        else:
            expected += complex(mode.response(2 * pi * frequency))
    expected *= 0.5 * hold(frequency) * np.exp(-turn * (delay + 4e-6))
    assert result == pytest.approx(expected, abs=2e-3 * abs(gain))  # terms of order 1/Q


def test_plate_against_its_differential_equation():
    """Held drive, solve_ivp from sample to sample."""
    setup = Setup((PLANT,), rates=IDEAL)
    result = Plate(setup).period(0.9, 0.9)
    omega0, width = PLANT.omega_rad_s, 2 / PLANT.tau_s
    turn, state, samples = setup.omega_rad_s / 250e3, [0.0, 0.0], []
    clamped = 0.0
    for n in range(50):
        samples.append(PLANT.gain * width * state[1])
        end = solve_ivp(
            lambda t, y, u=clamped: [y[1], u - width * y[1] - omega0**2 * y[0]], (0, 4e-6), state, rtol=1e-9, atol=1e-18
        )
        state, clamped = list(end.y[:, -1]), 0.9 * np.cos(turn * n)
    assert result == pytest.approx(
        np.array(samples)[4:], abs=1e-6 * np.abs(samples).max() + 2e-3 * np.abs(samples).max()
    )


def test_fit_is_exact_at_any_frequency_with_an_offset():
    for detuning in (-200.0, 0.0, 133.7):
        control = Controller(replace(BASE, detuning_hz=detuning))
        turn = 2 * pi * (TRUE + detuning) / 250e3
        for k in range(3):
            n = np.arange(4, 50) + 50 * k
            samples = 0.3 * np.cos(turn * n) - -0.2 * np.sin(turn * n) + 0.15
            assert control.fit(samples) == pytest.approx(0.3 - 0.2j, abs=1e-11)


@pytest.mark.parametrize("detuning", [-300.0, 0.0, 300.0])
def test_small_step_meets_its_time_without_overshoot(detuning):
    reference = 0.1 * abs(PLANT.gain)
    trace = step_response(replace(BASE, detuning_hz=detuning), reference)
    assert not trace.limited.any()
    assert trace.reached_s() < 2.0e-3 and trace.overshoot() < 0.02
    assert trace.measured[-1] == pytest.approx(reference, rel=2e-3)


@pytest.mark.parametrize("detuning", [0.0, 250.0])
def test_time_steps_follow_the_envelopes_recursion(detuning):
    """The whole simulation against (U, V, I) of the margins' model, written out; they differ by terms of order 1/Q."""
    setup = replace(BASE, detuning_hz=detuning, response_s=0.65e-3)
    trace = step_response(setup, 0.08, 8e-3)
    gains, size, delta = setup.gains, 0.8 * abs(hold(TRUE)), 2 * pi * detuning
    decay = lambda t: np.exp(-(1 / PLANT.tau_s + 1j * delta) * t)  # noqa: E731
    steady, model = size / (1 + 1j * delta * PLANT.tau_s), 0.8 / (1 + 1j * delta * PLANT.tau_s)
    feedback = gains.proportional - 1j * delta * PLANT.tau_s / 0.8
    u, v, integral, last, expected = 0j, 0j, 0j, 0.0, []
    for reference in trace.reference:
        measured = decay(92e-6) * u + steady * (1 - decay(92e-6)) * v
        expected.append(measured)
        u = decay(PERIOD) * u + steady * (1 - decay(PERIOD)) * v
        v = integral + gains.proportional * reference
        v -= feedback * (decay(108e-6) * measured + model * (1 - decay(108e-6)) * trace_drive(trace, len(expected)))
        integral += gains.integral * (reference - 0.54 * (reference - last) - measured)
        last = reference
    result = trace.measured
    assert np.abs(result - np.array(expected)).max() < 0.02 * 0.08


def trace_drive(trace, step: int) -> complex:
    return complex(trace.drive[step - 2]) if step > 1 else 0j


def test_saturated_rise_is_near_the_bound_and_the_anti_windups_rank():
    setup = replace(BASE, rates=Rates())
    share = 0.5
    reach = 0.8 * abs(hold(TRUE))  # what full drive gives through the hold
    bound = feasibility(replace(PLANT, gain=reach), share * reach, 1e-3, 1.0).least_time_s
    traces = {
        kind: step_response(replace(setup, anti_windup=kind), share * reach) for kind in ("match", "freeze", "none")
    }
    assert all(trace.limited.any() and np.all(np.abs(trace.drive) <= 1.0 + 1e-12) for trace in traces.values())
    assert all(trace.reached_s() > bound for trace in traces.values())
    assert traces["match"].settled_s() < 1.6 * bound and traces["match"].overshoot() < 0.02
    assert traces["freeze"].settled_s() > 1.3 * traces["match"].settled_s()
    assert traces["none"].overshoot() > 0.05


@pytest.mark.parametrize("detuning", [0.0, 200.0])
def test_margins_tell_when_the_simulation_diverges(detuning):
    """An error of the carrier's phase: the step dies out inside the margin and grows beyond it."""
    setup = replace(BASE, detuning_hz=detuning, drive_limit=inf, response_s=0.5e-3)
    limit = margins(setup).phase_deg
    late = setup.delay_s + 2e-6
    ends = []
    for share in (0.93, 1.07):
        worst = 0.0
        for sign in (1.0, -1.0):
            wrong = late + sign * share * limit / 360 / (TRUE + detuning)
            size = np.abs(step_response(replace(setup, known_delay_s=wrong), 0.05, 120e-3).measured - 0.05)
            worst = max(worst, size[-100:].max() / size[100:200].max())
        ends.append(worst)
    assert ends[0] < 1.0 < ends[1]


def test_gain_margin_is_where_the_simulation_diverges():
    setup = replace(BASE, drive_limit=inf)
    limit = margins(setup).gain
    for share, grows in ((0.9, False), (1.1, True)):
        louder = replace(setup, modes=(replace(PLANT, gain=0.8 * limit * share / abs(hold(TRUE))),), known=PLANT)
        size = np.abs(step_response(louder, 0.05, 20e-3).measured)
        assert (size[-1] > 10.0) == grows


def test_poles_and_return_ratio_are_of_one_loop():
    """1 + L vanishes at each closed-loop pole: here by its zero at the gain margin on the unit circle."""
    setup = replace(BASE, detuning_hz=150.0)
    result = margins(setup)
    assert result.stable and result.sensitivity >= 1.0
    loop = sampled_loop(setup)
    turned = np.min(np.abs(1 + np.exp(1j * np.radians(result.phase_deg)) * loop.open_loop))
    other = np.min(np.abs(1 + np.exp(-1j * np.radians(result.phase_deg)) * loop.open_loop))
    assert min(turned, other) < 5e-3
    assert np.abs(closed_loop_poles(setup, np.exp(1j * np.radians(result.phase_deg) * 0.99))).max() < 1.0
    assert loop.closed_loop[loop.omega_rad_s.size // 2] == pytest.approx(1.0, abs=1e-2)
    with pytest.raises(SolverError, match="unstable"):
        margins(replace(setup, known=replace(PLANT, gain=-0.8)))


def test_neighbours_slow_the_loop_instead_of_upsetting_it():
    others = tuple(
        ModePlant.from_quality_factor(TRUE + away, 300.0, gain) for away, gain in ((-700.0, 0.48), (900.0, -0.6))
    )
    setup = Setup((PLANT, *others), delay_s=7.3e-6)
    assert setup.gains.bounded and setup.gains.proportional == pytest.approx(0.5 / 0.6)
    trace = step_response(setup, 0.1, 0.2)
    assert trace.measured[-1] == pytest.approx(0.1, rel=0.03)


def test_noise_offset_and_bits_only_blur():
    noisy = Setup((PLANT,), delay_s=7.3e-6, noise=3e-3, offset=0.05)
    trace = step_response(noisy, 0.1, 60e-3)
    late = trace.measured[100:]
    floor = 3e-3 * np.sqrt(2 / 46) * 2  # of a fitted phasor, both axes; the loop passes part of it on
    assert abs(late.mean() - 0.1) < 4 * floor / np.sqrt(late.size) + 1e-3 * 0.1
    assert 0.5 * floor < np.std(late) < 2.0 * floor
    again = step_response(noisy, 0.1, 60e-3)
    assert np.array_equal(again.measured, trace.measured)


def test_planned_time_constant_meets_the_asked_time():
    for within in (1.5e-3, 2e-3, 4e-3):
        planned = planned_response_s(BASE, within)
        trace = step_response(replace(BASE, response_s=planned, drive_limit=inf), 0.1)
        assert trace.reached_s() == pytest.approx(within, rel=1e-2)
    with pytest.raises(SolverError, match="not that fast"):
        planned_response_s(BASE, 0.2e-3)


@pytest.fixture(scope="module")
def firmware():
    """The firmware's portable core on this machine."""
    pytest.importorskip("cffi", reason="cffi is not installed: pip install cffi")
    from firmware.host import NoCompiler, load

    try:
        return load()
    except NoCompiler as missing:
        pytest.skip(str(missing))


@pytest.mark.parametrize(("quality_factor", "gain", "response"), [(300.0, 0.8, 0.53e-3), (80.0, -0.3j, 0.6e-3)])
def test_gains_are_those_the_firmware_plans(firmware, quality_factor, gain, response):
    ffi, lib = firmware
    mode = ModePlant.from_quality_factor(TRUE, quality_factor, gain)
    setup = Setup((mode,), detuning_hz=120.0, response_s=response, delay_s=7.3e-6)
    known = ffi.new("an_mode *", {
        "frequency_hz": TRUE, "tau_s": mode.tau_s, "gain": {"re": complex(gain).real, "im": complex(gain).imag},
        "delay_s": 9.3e-6, "drive_limit": 1.0, "amplitude_limit": 0.8,
    })  # fmt: skip
    spec = ffi.new(
        "an_pi_spec *",
        {
            "period_s": PERIOD,
            "ahead_s": 108e-6,
            "response_s": response,
            "leaving_s": LEAVING_S,
            "proportional_max": 1e9,
        },
    )
    gains = ffi.new("an_pi_gains *")
    lib.an_pi_plan(gains, known, lib.an_dds_step(TRUE + 120.0, 250e3), 120.0, spec)
    ours, control = setup.gains, Controller(setup)
    assert gains.law[0].integral == pytest.approx(ours.integral, rel=2e-3)
    for law in range(2):
        planned = gains.law[law]
        assert planned.proportional == pytest.approx(control.proportional[law], rel=2e-3)  # its exp is good to 1e-4
        for theirs, mine in ((planned.state, control.states[law]), (planned.feed, control.feeds[law])):
            assert complex(theirs.re, theirs.im) == pytest.approx(mine, abs=2e-3 * abs(mine))
    assert complex(gains.lead.re, gains.lead.im) == pytest.approx(control.lead, abs=2e-3)
    assert (setup.rates.period, setup.rates.gap) == (lib.AN_PERIOD, lib.AN_GAP)
    assert gains.age == pytest.approx(setup.rates.ahead_s / PERIOD)


@pytest.mark.parametrize(("reference", "detuning"), [(0.08, 0.0), (0.08, 300.0), (0.35, 0.0)])
def test_the_firmware_itself_follows_the_same_path(firmware, reference, detuning):
    """The core's whole application on an emulated plate of other authorship, from rest to the reference."""
    from firmware.emulate import plant as emulated
    from firmware.mode_table import Mode, ModeTable, to_bytes
    from tests.helpers.hosted_boards import HostedSingle

    droop = abs(hold(TRUE))
    plate = emulated.Plate((emulated.Resonance(TRUE, PLANT.tau_s, 0.8),), delay_s=7.3e-6)
    table = ModeTable(250e3, bytes(16), (Mode(TRUE, PLANT.tau_s, -0.8j * droop, 9.3e-6, frequency_identified=True),))
    board = HostedSingle(to_bytes(table), plate)
    board.run(1e-3)
    assert board.start(0.1, detuning)
    board.lib.an_single_set_reference(board.app, 0.0)
    board.run(40e-3)
    board.reports.clear()
    board.lib.an_single_set_reference(board.app, reference)
    board.run(12e-3)
    theirs = np.array([measured for measured, _, _ in board.reports])
    sensed = replace(PLANT, gain=-0.8j)
    known = replace(PLANT, gain=-0.8j * droop)
    ours = step_response(Setup((sensed,), known=known, detuning_hz=detuning, delay_s=7.3e-6), reference, 12e-3).measured
    assert np.abs(theirs - ours).max() < 0.01 * reference + 2e-3


def test_study_closes_the_chain():
    """Sweep, identification, gains and response of one plate; the table carries the identified plant."""
    others = (
        ModePlant.from_quality_factor(30_200.0, 300.0, 0.04),
        ModePlant.from_quality_factor(32_100.0, 300.0, -0.05),
    )
    study = dq_study(DqData(neighbours=others))
    document = plain(study.to_dict())
    target = study.data.target
    entry = document["table_entry"]
    assert entry["frequency_hz"] == pytest.approx(target.frequency_hz, abs=0.1)
    assert entry["tau_s"] == pytest.approx(target.tau_s, rel=5e-3)
    assert complex(*entry["gain"]) == pytest.approx(-1j * target.gain * abs(hold(target.frequency_hz)), rel=5e-3)
    assert entry["delay_s"] == pytest.approx(9e-6, abs=5e-8)
    assert study.query.trace.reached_s() == pytest.approx(2e-3, rel=0.05)
    assert study.query.trace.overshoot() < 0.02
    assert {step["name"] for step in document["steps"]} == {"alone", "firmware's constant", "with neighbours"}
    feasible = [one["feasible"] for one in document["feasibility"]]
    assert feasible == sorted(feasible, reverse=True) and feasible[0] and not feasible[-1]
    (entry,) = beside("dq", thesis.dq(study))
    assert entry["agreement"].startswith("agrees")


def test_a_faster_wish_is_met_and_costs_amplitude():
    slow, fast = (dq_study(DqData(within_s=within, share=0.05)) for within in (4e-3, 1.5e-3))
    assert fast.query.trace.reached_s() == pytest.approx(1.5e-3, rel=0.05)
    assert fast.largest_share < 0.5 * slow.largest_share


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda: dq_study(DqData(within_s=0.2e-3)), "latency"),
        (lambda: dq_study(DqData(within_s=inf)), "finite"),
        (lambda: dq_study(DqData(share=0.0)), "above 0"),
        (lambda: Setup(()), "at least one mode"),
        (lambda: Setup((ModePlant(120e3, 1e-3, 1.0),)), "0.45 of the sample rate"),
        (lambda: Setup((PLANT,), response_s=0.0), "above 0"),
        (lambda: Setup((PLANT,), anti_windup="clamp"), "match, freeze or none"),
        (lambda: Rates(gap=45), "at least 8"),
        (lambda: step_response(BASE, 0.0), "above 0"),
    ],
)
def test_refused(call, expected):
    with pytest.raises(SolverError, match=expected):
        call()


def test_references_may_change_in_time():
    trace = run(BASE, np.concatenate([np.full(60, 0.1), np.full(60, 0.03)]))
    assert abs(trace.measured[59]) == pytest.approx(0.1, rel=2e-3) and abs(trace.measured[-1]) == pytest.approx(
        0.03, rel=5e-3
    )


def test_constants_are_the_firmwares():
    """Its own time constant of the loop and the gain it allows a neighbour, as its source states them."""
    core = Path(__file__).resolve().parents[3] / "firmware" / "core" / "single"
    source = "".join((core / name).read_text() for name in ("an_single.c", "an_pi.h"))
    stated = {name: float(value) for name, value in re.findall(r"#define (AN_\w+) ([0-9.e-]+)f", source)}
    assert (stated["AN_RESPONSE_S"], stated["AN_NEIGHBOUR_LOOP"]) == (FIRMWARE_RESPONSE_S, NEIGHBOUR_LOOP)
    assert stated["AN_LEAVING_S"] == LEAVING_S


@pytest.mark.parametrize("quality_factor", [100.0, 210.0, 300.0, 600.0])
def test_95_percent_within_2_ms_whatever_the_modes_own_time_constant(quality_factor):
    """The loop's pole does not depend on tau; a fifth of what full drive holds, or what it lifts in that time."""
    mode = ModePlant.from_quality_factor(TRUE, quality_factor, 0.8)
    trace = step_response(Setup((mode,), delay_s=7.3e-6), 0.05, 10e-3)
    assert not trace.limited.any()
    assert trace.reached_s() <= 2.0e-3 and trace.overshoot() <= 0.02
