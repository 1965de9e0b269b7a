"""Frequencies and bands from the command line."""

from __future__ import annotations

import pytest

from pipeline.case.limits import parse_band, parse_frequency
from pipeline.errors import InputError


@pytest.mark.parametrize("text", ["32kHz", "32 kHz", "32000Hz", "0.032MHz", "3.2e4Hz", "32.0KHZ", " 32khz "])
def test_units(text):
    assert parse_frequency(text) == pytest.approx(32_000.0, rel=1e-15)


@pytest.mark.parametrize(
    "text", ["", "kHz", "-32kHz", "0", "nan", "inf", "1e999", "32 GHz", "3 2kHz", "32kHz:34kHz", "٣٢"]
)
def test_refused_frequencies(text):
    with pytest.raises(InputError, match=r"--near = .*must be a frequency above 0"):
        parse_frequency(text, "--near")


@pytest.mark.parametrize("text", ["32", "32000", " 3.2e4 ", "+32", ".5"])
def test_a_bare_number_is_refused_with_both_readings(text):
    number = text.strip()
    with pytest.raises(InputError) as fault:
        parse_frequency(text, "--near")
    assert fault.value.exit_code == 2
    words = f"--near = {text!r}: {number} could mean {number} Hz or {number} kHz: write the unit"
    assert fault.value.lines == [words]


def test_band():
    assert parse_band("30kHz:34000Hz") == (30e3, 34e3)


def test_a_bare_band_is_refused_with_both_readings():
    with pytest.raises(InputError) as fault:
        parse_band("30:34", "--band")
    text = "--band = '30:34': 30:34 could mean 30 Hz to 34 Hz or 30 kHz to 34 kHz: write the unit"
    assert fault.value.lines == [text]


@pytest.mark.parametrize(("text", "end"), [("30:34kHz", "low end = '30'"), ("30kHz:34", "high end = '34'")])
def test_one_bare_end_is_refused(text, end):
    with pytest.raises(InputError, match=f"--band {end}: .* could mean .* Hz or .* kHz: write the unit"):
        parse_band(text, "--band")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("34kHz:30kHz", "low end must lie below"),
        ("30kHz:30kHz", "low end must lie below"),
        ("30kHz", "with a colon between them"),
        ("1:2:3", "with a colon between them"),
        ("-1Hz:2Hz", "low end"),
        ("1Hz:nan", "high end"),
        ("0:34kHz", "low end = '0': must be a frequency above 0"),
    ],
)
def test_refused_bands(text, expected):
    with pytest.raises(InputError, match=expected):
        parse_band(text, "--band")
