"""Frequencies and bands as people type them on a command line."""

from __future__ import annotations

import re
from math import inf, nan

from pipeline.case.limits import FREQUENCY_KHZ, span
from pipeline.errors import InputError
from pipeline.units import KHZ, MS, US

SECONDS = {"ms": MS, "us": US, "s": 1.0}
MAX_DURATION_S = 1.0  # of a loop's times: a slower one controls no vibration
HERTZ = {"hz": 1.0, "khz": KHZ, "mhz": 1e6}
FREQUENCY = re.compile(r"\s*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*([A-Za-z]*)\s*")
ALLOWED = f"a frequency above 0 with its unit Hz, kHz or MHz, such as 32kHz, {span(FREQUENCY_KHZ)} kHz"


def parse_frequency(text: str, what: str = "frequency") -> float:
    """Hz from "32kHz", "32 kHz" or "0.032MHz"; InputError names `what` otherwise, and both readings of a bare number.

    A bare number has two readings because the keys of a case file are in kHz and the fields of a document in Hz. A bare
    0 would be the same in both, but is no frequency above 0.
    """
    match = FREQUENCY.fullmatch(text)
    number, unit = match.groups() if match else ("nan", "")
    value = float(number) * HERTZ.get(unit.lower(), 1.0 if not unit else nan)
    if not unit and 0.0 < value < inf:
        raise InputError(f"{what} = {text!r}: {number} could mean {number} Hz or {number} kHz: write the unit")
    if not FREQUENCY_KHZ[0] <= value / KHZ <= FREQUENCY_KHZ[1]:
        raise InputError(f"{what} = {text!r}: must be {ALLOWED}")
    return value


def parse_seconds(text: str, what: str = "time") -> float:
    """Seconds from "2ms", "4us" or "0.002s"; InputError names `what` otherwise, or below 0."""
    unit = next((unit for unit in SECONDS if text.strip().endswith(unit)), None)
    try:
        value = float(text.strip().removesuffix(unit)) * SECONDS[unit] if unit else nan
    except ValueError:
        value = nan
    if 0.0 <= value <= MAX_DURATION_S:
        return value
    limit = f"must be a time of 0 or more in s, ms or us, such as 4us, and at most {MAX_DURATION_S:g} s"
    raise InputError(f"{what} = {text!r}: {limit}")


def parse_band(text: str, what: str = "band") -> tuple[float, float]:
    """(low, high) in Hz from "30kHz:34kHz"; InputError when an end is wrong or the band is empty or reversed."""
    ends = text.split(":")
    if len(ends) != 2:
        raise InputError(f"{what} = {text!r}: must be two frequencies with a colon between them, such as 30kHz:34kHz")
    _refuse_bare(ends, text, what)
    low, high = (parse_frequency(end, f"{what} {side} end") for end, side in zip(ends, ("low", "high"), strict=True))
    if not low < high:
        raise InputError(f"{what} = {text!r}: the low end must lie below the high end")
    return low, high


def _refuse_bare(ends: list[str], text: str, what: str) -> None:
    """InputError with both readings of a band whose two ends are bare numbers above 0."""
    bare = [match.group(1) for end in ends if (match := FREQUENCY.fullmatch(end)) and not match.group(2)]
    if len(bare) == 2 and all(0.0 < float(number) < inf for number in bare):
        readings = " or ".join(f"{bare[0]} {unit} to {bare[1]} {unit}" for unit in ("Hz", "kHz"))
        raise InputError(f"{what} = {text!r}: {':'.join(bare)} could mean {readings}: write the unit")
