"""Pre-design as the command tells it."""

from __future__ import annotations

from typing import Any

from pipeline.case import Case
from solvers.analytic.predesign import predesign


def run(case: Case) -> tuple[dict[str, Any], str]:
    """The JSON document and the text of a case's analytic sizing."""
    found = predesign(case.design)
    document = found.as_json()
    lines = [f"{part}: {', '.join(_pairs(document[part]))}" for part in ("zone", "pillar") if document[part]]
    return document, "\n".join([*lines, *(f"limit: {text}" for text in found.limits)])


def _pairs(values: dict[str, Any]) -> list[str]:
    return [f"{key} = {value:.6g}" if isinstance(value, float) else f"{key} = {value}" for key, value in values.items()]
