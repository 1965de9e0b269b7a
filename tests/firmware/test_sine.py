"""Sine, phase and synthesis against double precision."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from firmware import sine_table

TURN = 2.0**32
THIRD_ORDER = (math.pi / 256) ** 3 / 6  # left out of the expansion about a sector's middle
ROUNDING = 2.0**-24


def test_committed_table_is_the_generated_one() -> None:
    assert sine_table.PATH.read_text() == sine_table.text()


def test_turn_is_the_unit_circle_to_third_order(core) -> None:
    edges = [sector << 24 for sector in range(256)]
    phases = [*edges, *[edge - 1 for edge in edges[1:]], *np.random.default_rng(1).integers(0, 2**32, 20000).tolist()]
    worst = 0.0
    for phase in phases:
        result = core.lib.an_turn(phase)
        angle = 2.0 * math.pi * phase / TURN
        worst = max(worst, abs(complex(result.re, result.im) - complex(math.cos(angle), math.sin(angle))))
    assert worst < THIRD_ORDER + 3.0 * ROUNDING


@given(angle=st.floats(-math.pi, math.pi), size=st.floats(1e-9, 1e9))
def test_phase_of_inverts_turn(core, angle: float, size: float) -> None:
    z = core.ffi.new("an_complex *", {"re": size * math.cos(angle), "im": size * math.sin(angle)})[0]
    exact = math.atan2(z.im, z.re)
    result = core.lib.an_phase_of(z) / TURN * 2.0 * math.pi
    assert abs(math.remainder(result - exact, 2.0 * math.pi)) < THIRD_ORDER + 4.0 * ROUNDING


def test_phase_of_nothing_is_zero(core) -> None:
    for re, im in ((0.0, 0.0), (math.nan, 1.0), (math.inf, 1.0)):
        assert core.lib.an_phase_of(core.ffi.new("an_complex *", {"re": re, "im": im})[0]) == 0


def test_step_and_frequency_invert_each_other(core) -> None:
    for frequency_hz in (25e3, 31404.5, 40e3):
        step = core.lib.an_dds_step(frequency_hz, 250e3)
        assert abs(step / TURN * 250e3 - frequency_hz) < frequency_hz * 2.0**-23
        assert abs(core.lib.an_dds_frequency(step, 250e3) - frequency_hz) < frequency_hz * 2.0**-22


def test_a_shift_keeps_the_resolution_of_the_accumulator(core) -> None:
    step = core.lib.an_dds_step(31404.5, 250e3)
    for shift_hz in (0.001, -0.25, 300.0):
        shifted = core.lib.an_dds_shifted(step, shift_hz, 250e3)
        assert abs((shifted - step) / TURN * 250e3 - shift_hz) < abs(shift_hz) * 2.0**-22 + 250e3 / TURN
        assert abs(core.lib.an_dds_detuning(shifted, step, 250e3) - shift_hz) < abs(shift_hz) * 2.0**-22 + 250e3 / TURN


def test_frequencies_out_of_range_give_no_step(core) -> None:
    for frequency_hz in (0.0, -1.0, 125e3, math.nan, math.inf):
        assert core.lib.an_dds_step(frequency_hz, 250e3) == 0
    assert core.lib.an_dds_shifted(12345, math.nan, 250e3) == 12345
