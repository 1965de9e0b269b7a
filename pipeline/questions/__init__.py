"""What can be asked of a case: a file a question, each found by its name."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules
from typing import Any

MECHANISM = ("question", "result", "command", "method", "answer", "study")
# of help and reference; what is not listed follows
IN_ORDER = (
    *("predesign", "modes", "bands", "attenuation", "broadband", "response", "tolerance", "touch", "hybrid", "travel"),
    *("crosstalk", "search", "active", "active_dq"),
)


def registered() -> dict[str, type[Any]]:
    """Return every question that has a command by name: those of this folder, and those that other modules have defined."""
    _read()
    from pipeline.questions.question import QUESTIONS

    return QUESTIONS


def known() -> dict[str, type[Any]]:
    """Return every question by name, those that studies alone ask, too."""
    _read()
    from pipeline.questions.question import IN_STUDIES, QUESTIONS

    return QUESTIONS | IN_STUDIES


def _read() -> None:
    found = {each.name for each in iter_modules(__path__)} - set(MECHANISM)
    for name in (*(each for each in IN_ORDER if each in found), *sorted(found - set(IN_ORDER))):
        import_module(f"{__name__}.{name}")
