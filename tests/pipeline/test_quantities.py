"""Frequencies and bands from the command line."""

from __future__ import annotations

import pytest

from pipeline.errors import InputFault
from pipeline.quantities import parse_band, parse_frequency


@pytest.mark.parametrize("text", ["32kHz", "32 kHz", "32000", "32000Hz", "0.032MHz", "3.2e4", "32.0KHZ", " 32khz "])
def test_units(text):
    assert parse_frequency(text) == pytest.approx(32_000.0, rel=1e-15)


@pytest.mark.parametrize(
    "text", ["", "kHz", "-32kHz", "0", "nan", "inf", "1e999", "32 GHz", "3 2kHz", "32kHz:34kHz", "٣٢"]
)
def test_refused_frequencies(text):
    with pytest.raises(InputFault, match=r"--near = .*must be a frequency above 0"):
        parse_frequency(text, "--near")


def test_band():
    assert parse_band("30kHz:34000") == (30e3, 34e3)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("34kHz:30kHz", "low end must lie below"),
        ("30kHz:30kHz", "low end must lie below"),
        ("30kHz", "joined by a colon"),
        ("1:2:3", "joined by a colon"),
        ("-1:2", "low end"),
        ("1:nan", "high end"),
    ],
)
def test_refused_bands(text, expected):
    with pytest.raises(InputFault, match=expected):
        parse_band(text, "--band")
