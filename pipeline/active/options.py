"""Options of `antinode active` read from the command line, and lines of the comparison with the thesis."""

from __future__ import annotations

from argparse import Namespace
from math import inf, nan

from pipeline.case.limits import QUALITY, span
from pipeline.case.quantities import parse_frequency
from pipeline.errors import InputError
from pipeline.units import MS, US

MAX_DURATION_S = 1.0  # of a loop's times: a slower one controls no vibration
SECONDS = {"ms": MS, "us": US, "s": 1.0}


def frequencies_hz(arguments: Namespace, default: tuple[float, ...]) -> tuple[float, ...]:
    """Return every --frequency in Hz, or the default."""
    return tuple(parse_frequency(text, "--frequency") for text in arguments.frequency or ()) or default


def only_frequency_hz(arguments: Namespace, default: float) -> float:
    """Return the one --frequency in Hz, or the default. Raises InputError when there are several."""
    value = frequencies_hz(arguments, (default,))
    if len(value) > 1:
        raise InputError(f"--frequency: active {arguments.model} takes one, {len(value)} came")
    return value[0]


def quality_factor(arguments: Namespace, default: float) -> float:
    """Return --quality-factor, infinite for "inf", or the default."""
    if arguments.quality_factor is None:
        return default
    value = number(arguments.quality_factor)
    if not (QUALITY[0] <= value <= QUALITY[1] or value == inf):
        allowed = f"must be a number above 0, {span(QUALITY)}, or inf for no losses"
        raise InputError(f"--quality-factor = {arguments.quality_factor}: {allowed}")
    return value


def seconds(text: str, what: str) -> float:
    """Read seconds from "2ms", "4us" or "0.002s". Raises InputError otherwise or below 0."""
    unit = next((unit for unit in SECONDS if text.strip().endswith(unit)), None)
    value = number(text.strip().removesuffix(unit)) * SECONDS[unit] if unit else nan
    if 0.0 <= value <= MAX_DURATION_S:
        return value
    limit = f"must be a time of 0 or more in s, ms or us, such as 4us, and at most {MAX_DURATION_S:g} s"
    raise InputError(f"{what} = {text!r}: {limit}")


def number(text: str) -> float:
    """Read a float; NaN for anything else."""
    try:
        return float(text)
    except ValueError:
        return nan


def compared(entries: list[dict[str, str]]) -> list[str]:
    """One block a quantity: the thesis' value, ours, and how they agree."""
    form = "{quantity}\n  thesis: {thesis}\n  ours:   {ours}\n  {agreement}"
    return [form.format(**entry) for entry in entries]
