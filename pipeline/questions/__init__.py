"""What can be asked of a case: a file a question, each found by its name."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules
from typing import Any

MECHANISM = ("question", "result", "command", "method")
# of help and reference; what is not listed follows
IN_ORDER = ("predesign", "modes", "bands", "attenuation", "broadband", "crosstalk", "touch", "hybrid", "travel")


def registered() -> dict[str, type[Any]]:
    """Return every question by name: those of this folder, and those that other modules have defined."""
    found = {each.name for each in iter_modules(__path__)} - set(MECHANISM)
    for name in (*(each for each in IN_ORDER if each in found), *sorted(found - set(IN_ORDER))):
        import_module(f"{__name__}.{name}")
    from pipeline.questions.question import QUESTIONS

    return QUESTIONS
