"""Search spaces and results as the command creates them."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.case.model import load_case
from pipeline.search.space import Space, Variable, space_of, variable_of
from pipeline.search.terms import Range


def read_space(path: str, fixed: Sequence[str], texts: Sequence[str]) -> Space:
    """The space of a case file with --set and --vary texts."""
    return space_of(load_case(path, fixed), [Range.read(text) for text in texts])


def parse_vary(text: str) -> Variable:
    """The variable of a --vary text."""
    return variable_of(Range.read(text))
