"""Figures for reading: digits by the bar, units that fit, nothing printed that means nothing."""

from __future__ import annotations

import doctest
import math
from random import Random

import pytest

from pipeline import quantity
from pipeline.quantity import (
    decimals,
    figure,
    frequency,
    frequency_with_bar,
    interval,
    level,
    percent,
    percentage,
    with_bar,
)

LEADING = (1.0, 1.04, 2.0, 3.54, 3.55, 4.9, 5.0, 7.0, 9.49, 9.5, 9.99)
BARS = [lead * 10.0**power for power in range(-3, 3) for lead in LEADING]


@pytest.mark.parametrize("bar", BARS)
def test_rounding_moves_a_figure_by_at_most_a_seventh_of_its_bar(bar: float) -> None:
    """Half a unit of the last digit over the smallest bar with one digit, 3.55: 1/7.1."""
    random = Random(2)
    for _ in range(50):
        value = random.uniform(1e2, 1e3)
        assert abs(float(figure(value, bar)) - value) <= bar / 7.0 + 1e-9 * value


@pytest.mark.parametrize("bar", BARS)
def test_no_figure_has_a_digit_beyond_the_second_of_its_bar(bar: float) -> None:
    """The last digit counts at least a 36th of the bar."""
    assert 10.0 ** -decimals(987.654321, bar) >= bar / 36.0 * (1.0 - 1e-9)


@pytest.mark.parametrize(
    ("value", "bar", "text"),
    [
        (33.49412, 0.00012, "33.49412"),
        (33.49412, 0.11, "33.49"),
        (33.49412, 0.36, "33.5"),
        (33.49412, 0.96, "33.5"),
        (33.49412, 4.0, "33"),
        (334.9412, 40.0, "330"),
        (334.9412, 12.0, "335"),
        (-0.0001, 0.4, "0.0"),
        (0.0, 0.04, "0.00"),
        (0.012345, None, "0.0123"),
        (56873.8, None, "56900"),
        (1.0 / 3.0, 1e-12, "0.3333333"),
        (1.0 / 3.0, 0.0, "0.3333333"),
        (54.0, 0.0, "54"),
        (50.0, None, "50.0"),
        (1.2345e-9, None, "1.23e-09"),
        (1.2345e-9, 2e-12, "1.2345e-09"),
        (3.3e-5, 0.08, "0.00"),
        (7.0e12, 0.0, "7.000000e+12"),
        (None, 0.1, "–"),
        (math.nan, 0.1, "–"),
        (2.3456, math.inf, "2.35"),
    ],
)
def test_a_figure_has_the_digits_of_its_bar(value: float | None, bar: float | None, text: str) -> None:
    assert figure(value, bar) == text


def test_value_and_bar_end_at_the_same_digit() -> None:
    assert with_bar(219.3012, 0.145, "Hz") == "219.30 ± 0.14 Hz"  # 0.145 is less than that in binary
    assert with_bar(12.25, 0.96, "dB") == "12.2 ± 1.0 dB"
    assert with_bar(12.25, None, "dB") == "12.2 dB"
    assert with_bar(None, 0.1, "dB") == "–"


@pytest.mark.parametrize(
    ("hz", "error", "text"),
    [
        (219.3012, 6.6e-4, "219.30 Hz"),
        (999.4, 1e-3, "999.4 Hz"),
        (33494.1, 3e-3, "33.49 kHz"),
        (1.0566e6, 4e-3, "1.057 MHz"),
        (2.5e9, None, "2.50 GHz"),
        (0.0, None, "0.00 Hz"),
        (33494.1, 1.2, "–"),
        (None, None, "–"),
    ],
)
def test_a_frequency_has_a_unit_that_fits(hz: float | None, error: float | None, text: str) -> None:
    assert frequency(hz, error) == text
    if text != "–":
        assert frequency(hz, error, "\u202f") == text.replace(" ", "\u202f")


def test_a_gap_of_a_locally_resonant_plate_can_be_read() -> None:
    """Both ends in one unit: 0.52 to 0.55 kHz says nothing."""
    assert interval(519.21, 548.77, 8e-4, 4e-3) == "519.2 to 548.8 Hz"
    assert interval(819.21, 1548.77, 8e-4, 4e-3) == "0.8192 to 1.549 kHz"
    assert interval(519.21, 548.77) == "519 to 549 Hz"


def test_a_bar_is_written_with_its_frequency() -> None:
    assert frequency_with_bar(33494.1, 3e-3) == "33.49 ± 0.10 kHz"
    assert frequency_with_bar(33494.1) == "33.5 kHz"
    assert frequency_with_bar(33494.1, 2.0) == "–"


def test_levels_and_percentages() -> None:
    assert [level(12.2519, bar) for bar in (0.0123, 0.5, 4.0, None)] == ["12.252 dB", "12.3 dB", "12 dB", "12.3 dB"]
    assert level(-0.01) == "0.0 dB"
    assert [percent(error) for error in (0.012, 0.00113, 1.2e-6, 0.5, None, math.inf)] == [
        "1.2 %", "0.11 %", "0.00012 %", "50 %", "–", "–",
    ]  # fmt: skip


def test_a_share_in_percent_has_the_digits_of_its_bar() -> None:
    assert [percentage(0.87349, bar) for bar in (None, 0.0021, 0.04, 3e-6)] == [
        "87.3 %",
        "87.35 %",
        "87 %",
        "87.34900 %",
    ]
    assert percentage(None) == percentage(math.inf) == "–" and percentage(-0.0123, 0.004) == "-1.2 %"


def test_a_column_of_frequencies_has_one_unit() -> None:
    assert quantity.frequency_unit([0.0, 219.3, None]).symbol == "Hz"
    assert quantity.frequency_unit([219.3, 2193.0]).symbol == "kHz"
    assert quantity.frequency_unit([]).symbol == "Hz"


def test_the_examples_hold() -> None:
    assert doctest.testmod(quantity).failed == 0
