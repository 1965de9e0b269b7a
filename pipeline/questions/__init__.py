"""Questions that a case can answer, one file per question, each found by its name.

The help line of each question is kept in index.json, so that only the requested question is loaded.
`python -m pipeline.questions` rewrites it; a question missing from it is found by loading its module.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, NamedTuple

MECHANISM = ("question", "result", "command", "late", "study", "__main__")
INDEX = Path(__file__).with_name("index.json")
# order in help and reference; unlisted questions follow
IN_ORDER = (
    *("predesign", "modes", "bands", "attenuation", "broadband", "response", "tolerance", "touch", "hybrid", "travel"),
    *("drift", "crosstalk", "search", "active", "active_dq"),
)


class Listed(NamedTuple):
    """Entry of a question in the help: module, name, words of its command, sentence and example."""

    module: str
    name: str
    command: str
    summary: str
    example: str


def registered() -> dict[str, type[Any]]:
    """Return every question that has a command by name: those of this folder, and those that other modules have defined."""
    _load()
    from pipeline.questions.question import QUESTIONS

    return QUESTIONS


def known() -> dict[str, type[Any]]:
    """Return every question by name, including those that only studies ask."""
    _load()
    from pipeline.questions.question import IN_STUDIES, QUESTIONS

    return QUESTIONS | IN_STUDIES


def listed() -> list[Listed]:
    """Return the help entries of all questions with a command, loading only those missing from the index."""
    index = json.loads(INDEX.read_text(encoding="utf-8"))
    modules = list(_modules())
    found = [Listed(module, *words) for module in modules for words in index.get(module, ())]
    for module in modules:
        if module not in index:
            import_module(module)
    return found + [each for each in _loaded() if each.module not in index]


def load(of: Listed) -> type[Any]:
    """Return a listed question, loading its module."""
    import_module(of.module)
    from pipeline.questions.question import QUESTIONS

    return QUESTIONS[of.name]


def index() -> dict[str, list[tuple[str, ...]]]:
    """Return the content of the index: the help entries of each module's questions, in the order of help."""
    _load()
    return {module: [tuple(each[1:]) for each in _loaded() if each.module == module] for module in _modules()}


def _loaded() -> list[Listed]:
    if "pipeline.questions.question" not in sys.modules:
        return []
    from pipeline.questions.question import QUESTIONS

    return [Listed(q.__module__, q.name, q.command(), q.summary(), q.example) for q in QUESTIONS.values()]


def _load() -> None:
    for module in _modules():
        import_module(module)


def _modules() -> Iterator[str]:
    found = {each.name for each in iter_modules(__path__)} - set(MECHANISM)
    for name in (*(each for each in IN_ORDER if each in found), *sorted(found - set(IN_ORDER))):
        yield f"{__name__}.{name}"
