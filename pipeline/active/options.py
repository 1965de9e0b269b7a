"""Options of `antinode active` read from the command line, and what every model gives back."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING, Any

from pipeline.case.limits import QUALITY, span
from pipeline.case.quantities import parse_frequency
from pipeline.errors import InputError

if TYPE_CHECKING:
    from pipeline.plots.style import ReportFigure

MAX_DURATION_S = 1.0  # of a loop's times: a slower one controls no vibration
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}


@dataclass(frozen=True)
class Found:
    """What a model gives: its JSON document, its lines of text, its figures (drawn only when asked), further files."""

    document: dict[str, Any]
    lines: list[str]
    report_figures: Callable[[], list[ReportFigure]]
    files: dict[str, bytes] = field(default_factory=dict)


def frequencies_hz(arguments: Namespace, default: tuple[float, ...]) -> tuple[float, ...]:
    """Return every --frequency in Hz, or the default."""
    return tuple(parse_frequency(text, "--frequency") for text in arguments.frequency or ()) or default


def only_frequency_hz(arguments: Namespace, default: float) -> float:
    """Return the one --frequency in Hz, or the default. Raises InputError when there are several."""
    value = frequencies_hz(arguments, (default,))
    if len(value) > 1:
        raise InputError(f"--frequency: active {arguments.model} takes one, {len(value)} came")
    return value[0]


def quality(arguments: Namespace, default: float) -> float:
    """Return --quality, infinite for "inf", or the default."""
    if arguments.quality is None:
        return default
    value = number(arguments.quality)
    if not (QUALITY[0] <= value <= QUALITY[1] or value == inf):
        allowed = f"must be a number above 0, {span(QUALITY)}, or inf for no losses"
        raise InputError(f"--quality = {arguments.quality}: {allowed}")
    return value


def seconds(text: str, what: str) -> float:
    """Read seconds from "2ms", "4us" or "0.002s". Raises InputError otherwise or below 0."""
    for unit in ("ms", "us", "s"):
        if text.strip().endswith(unit):
            value = number(text.strip()[: -len(unit)])
            if 0.0 <= value * SECONDS[unit] <= MAX_DURATION_S:
                return value * SECONDS[unit]
            break
    limit = f"must be a time of 0 or more in s, ms or us, such as 4us, and at most {MAX_DURATION_S:g} s"
    raise InputError(f"{what} = {text!r}: {limit}")


def number(text: str) -> float:
    """Read a float; NaN for anything else."""
    try:
        return float(text)
    except ValueError:
        return float("nan")


def compared(entries: list[dict[str, str]]) -> list[str]:
    """One block a quantity: the thesis' value, ours, and how they agree."""
    lines = []
    for entry in entries:
        lines += [
            entry["quantity"],
            f"  thesis: {entry['thesis']}",
            f"  ours:   {entry['ours']}",
            f"  {entry['agreement']}",
        ]
    return lines
