"""Docstrings in numpydoc: every public name of `antinode`, every public function of solvers and geometry.

Checked are the rules RULES of `numpydoc.validate`, that a number states its unit, and that an array states its shape.
"""

from __future__ import annotations

import importlib
import inspect
import re
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from numpydoc.docscrape import NumpyDocString
from numpydoc.validate import validate

import antinode

ROOT = Path(__file__).resolve().parents[2]
RULES = {"GL07", "GL08", "SS01", "SS03", "PR01", "PR02", "PR03", "PR04", "PR07", "RT01", "RT03", "YD01"}
# a name that ends in a unit states it
UNIT_NAME = re.compile(
    r"_(m|m2|m3|mm|um|hz|khz|pa|gpa|kg|kg_m2|kg_m3|s|ms|v|db|deg|n_m|bytes|count|ratio|share|error)$"
)
UNIT = re.compile(
    r"\b(metres?|mm|µm|um|m|m\^?[234]|Hz|kHz|rad(/[sm])?|radians?|Pa|GPa|kg(/\w+)?|s|seconds?|N(/\w+)?|V|volts?|dB|degrees?"
    r"|W|mW|bytes|GiB|dimensionless|relative(ly)?|ratios?|fractions?|factors?|shares?|scaled|normalised|pixels?|counts?|numbers?)\b"
    r"|units?\b|\b(per|times)\b|1/\w|%|/m|\d",
    re.IGNORECASE,
)
NUMBER, ARRAY = re.compile(r"\b(float|complex)\b"), re.compile(r"array", re.IGNORECASE)
SHAPE = re.compile(r"\(\s*[\w.+*/ ]+,|shape|\bscalar\b")


def functions(package: str) -> Iterator[str]:
    """Public functions of a package, by module and name."""
    for file in sorted((ROOT / package).rglob("*.py")):
        name = ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        module = importlib.import_module(name)
        yield from (f"{name}.{each}" for each in vars(module) if _is_own(module, each))


def _is_own(module: ModuleType, name: str) -> bool:
    thing = inspect.unwrap(vars(module)[name]) if callable(vars(module)[name]) else None
    return inspect.isfunction(thing) and thing.__module__ == module.__name__ and not name.startswith("_")


def names() -> Iterator[str]:
    """Public names of `antinode` with their own public methods."""
    for name in antinode.__all__:
        thing = getattr(antinode, name)
        if not callable(thing):
            continue
        yield (whole := f"{thing.__module__}.{thing.__qualname__}")
        if inspect.isclass(thing):
            yield from (f"{whole}.{each}" for each in vars(thing) if _is_method(thing, each, getattr(thing, each)))


def _is_method(owner: type, name: str, own: Any) -> bool:
    """Whether a public attribute is a function written in the class: not a column that the class was given."""
    if isinstance(own, (property, cached_property)):
        own = own.fget if isinstance(own, property) else own.func
    own = getattr(own, "__func__", own)
    return not name.startswith("_") and inspect.isfunction(own) and own.__qualname__ == f"{owner.__qualname__}.{name}"


def faults(name: str) -> list[str]:
    """What a name's docstring lacks."""
    report = validate(name)
    said = [f"{code}: {text}" for code, text in report["errors"] if code in RULES]
    doc = NumpyDocString(inspect.cleandoc(report["docstring"] or ""))
    for section in ("Parameters", "Attributes", "Returns", "Yields"):
        for entry in doc[section]:
            label, text = entry.name or entry.type, " ".join((entry.type, *entry.desc))
            if NUMBER.search(entry.type) and not (UNIT_NAME.search(entry.name) or UNIT.search(" ".join(entry.desc))):
                said.append(f"{section}: {label} states no unit")
            if ARRAY.search(entry.type) and not SHAPE.search(text):
                said.append(f"{section}: {label} states no shape")
    return said


@pytest.mark.parametrize("package", ["geometry", "solvers"])
def test_every_public_function_documents_its_parameters_returns_and_units(package: str) -> None:
    wrong = [f"{name}: {fault}" for name in functions(package) for fault in faults(name)]
    assert not wrong, "\n".join(wrong)


def test_every_public_name_of_antinode_documents_its_parameters_returns_and_units() -> None:
    wrong = [f"{name}: {fault}" for name in names() for fault in faults(name)]
    assert not wrong, "\n".join(wrong)


def a_function_without_units(length: float, points: Any) -> float:
    """Measure something.

    Parameters
    ----------
    length : float
        How long it is.
    points : ndarray
        Where it is.

    Returns
    -------
    float
        The measure in m.
    """
    raise NotImplementedError


def test_a_number_without_unit_and_an_array_without_shape_are_found() -> None:
    said = faults(f"{__name__}.a_function_without_units")
    assert said == ["Parameters: length states no unit", "Parameters: points states no shape"]
