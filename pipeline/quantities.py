"""Frequencies and bands as people type them on a command line."""

from __future__ import annotations

import re
from math import isfinite

from pipeline.errors import InputFault

HERTZ = {"": 1.0, "hz": 1.0, "khz": 1e3, "mhz": 1e6}
FREQUENCY = re.compile(r"\s*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*([A-Za-z]*)\s*")
ALLOWED = "a frequency above 0 in Hz, kHz or MHz, such as 32kHz"


def parse_frequency(text: str, what: str = "frequency") -> float:
    """Hz from "32kHz", "32 kHz", "32000" or "0.032MHz"; InputFault names `what` otherwise."""
    match = FREQUENCY.fullmatch(text)
    scale = HERTZ.get(match.group(2).lower()) if match else None
    if match is None or scale is None:
        raise InputFault(f"{what} = {text!r}: must be {ALLOWED}")
    value = float(match.group(1)) * scale
    if not (isfinite(value) and value > 0.0):
        raise InputFault(f"{what} = {text!r}: must be {ALLOWED}")
    return value


def parse_band(text: str, what: str = "band") -> tuple[float, float]:
    """(low, high) in Hz from "30kHz:34kHz"; InputFault when an end is wrong or the band is empty or reversed."""
    ends = text.split(":")
    if len(ends) != 2:
        raise InputFault(f"{what} = {text!r}: must be two frequencies joined by a colon, such as 30kHz:34kHz")
    low, high = (parse_frequency(end, f"{what} {side} end") for end, side in zip(ends, ("low", "high"), strict=True))
    if not low < high:
        raise InputFault(f"{what} = {text!r}: the low end must lie below the high end")
    return low, high
