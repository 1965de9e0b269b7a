"""The thesis' statements on the models beside ours: texts and ranges are data, and one function judges them."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from functools import cache
from math import nan
from string import Formatter
from typing import Any

from pipeline.paths import REFERENCE
from pipeline.quantity import figure, signed

FILE = REFERENCE / "thesis-models.toml"
NEAR = 0.15  # relative: a figure read from the text has one or two digits

Figures = dict[str, Any]
Range = tuple[float, float]


class FiguresInWords(Formatter):
    """Format texts with the digits that people read: '' and '+' of a spec count, 'g' is for what was given."""

    def format_field(self, value: Any, format_spec: str) -> str:
        """Format a floating-point number as a figure without a bar, with its sign for '+'; anything else as it is."""
        if not isinstance(value, float) or format_spec not in ("", "+"):
            return str(super().format_field(value, format_spec))
        return signed(figure(value)) if format_spec else figure(value)


IN_WORDS = FiguresInWords()


@cache
def statements() -> dict[str, dict[str, Any]]:
    """What the thesis states of each model, by the statement's key."""
    with FILE.open("rb") as file:
        return tomllib.load(file)


def beside(model: str, computed: Iterable[tuple[str, Figures]]) -> list[dict[str, str]]:
    """Per statement of a model its quantity, the thesis' value, ours and their agreement, from the computed figures."""
    entries = []
    for key, figures in computed:
        statement = statements()[model][key]
        every = _distances(statement["verdicts"], figures) | figures
        ours = {name: IN_WORDS.format(statement[name], **every) for name in ("quantity", "thesis", "ours")}
        entries.append(ours | {"agreement": agreement(statement, every)})
    return entries


def agreement(statement: dict[str, Any], figures: Figures) -> str:
    """The first verdict whose figures lie in their ranges, with every line of `also` that holds."""
    first = next(verdict for verdict in statement["verdicts"] if _holds(verdict, figures))
    lines = [first, *(line for line in statement.get("also", ()) if _holds(line, figures))]
    return IN_WORDS.format("".join(line["text"] for line in lines), **figures)


def _holds(verdict: dict[str, Any], figures: Figures) -> bool:
    ranges: dict[str, Range] = dict(verdict.get("within", {}))
    for name, stated in verdict.get("near", {}).items():
        low, high = stated if isinstance(stated, list) else (stated, stated)
        ranges[name] = (low * (1.0 - NEAR), high * (1.0 + NEAR))
    return all(low <= figures.get(name, nan) < high for name, (low, high) in ranges.items())


def _distances(verdicts: list[dict[str, Any]], figures: Figures) -> Figures:
    """Of every figure that is compared with a value: how far it lies apart, in its own unit, in %, and as a ratio."""
    values = {
        name: value for one in verdicts for name, value in one.get("near", {}).items() if isinstance(value, float)
    }
    apart = {f"{name}_apart": figures[name] - value for name, value in values.items()}
    off = {f"{name}_off": 100.0 * (figures[name] / value - 1.0) for name, value in values.items()}
    return apart | off | {f"{name}_times": figures[name] / value for name, value in values.items()}
