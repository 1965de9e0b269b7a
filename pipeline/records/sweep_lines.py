"""A sweep as lines: the most varied numeric key runs along a line, every set of the other keys is one."""

from __future__ import annotations

from typing import Any

from pipeline.records.study import StoredCase, StoredStudy

UNITS = {"mm": "mm", "kHz": "kHz", "GPa": "GPa", "kg": "kg", "deg": "°"}


def axis_label(key: str) -> str:
    """A swept key in words: array.pitch_mm -> array pitch (mm)."""
    words = key.replace(".", " ").split("_")
    unit = UNITS.get(words[-1])
    text = " ".join(words[:-1] if unit else words)
    return f"{text} ({unit})" if unit else text


def swept(cases: list[StoredCase]) -> list[StoredCase]:
    """Without the case that a study computes once beside its sweep."""
    return [case for case in cases if case.sweep]


def main_key(study: StoredStudy, cases: list[StoredCase]) -> str | None:
    """The numeric key that takes the most values over these cases; None where none takes two."""
    cases = swept(cases)
    numeric = [key for key in study.swept if all(_is_number(case.sweep.get(key)) for case in cases)]
    varied = {key: len({case.sweep[key] for case in cases}) for key in numeric}
    return max(varied, key=lambda name: varied[name]) if varied and max(varied.values()) > 1 else None


def lines_along(study: StoredStudy, cases: list[StoredCase], key: str) -> dict[str, list[StoredCase]]:
    """Cases in ascending order of a key, by the values of the other keys in words ('' where no other varies)."""
    cases = swept(cases)
    others = [name for name in study.swept if name != key and len({str(case.sweep.get(name)) for case in cases}) > 1]
    lines: dict[str, list[StoredCase]] = {}
    for case in sorted(cases, key=lambda case: case.sweep[key]):
        name = ", ".join(f"{axis_label(other)} = {case.sweep.get(other)}" for other in others)
        lines.setdefault(name, []).append(case)
    return dict(sorted(lines.items()))


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
