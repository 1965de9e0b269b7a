"""Pre-design as the command tells it."""

from __future__ import annotations

from typing import Any

from geometry.layout import Design
from pipeline.case.model import Case
from pipeline.planning import calibration
from pipeline.quantity import figure, frequency, percent, percentage
from pipeline.records.reading import named, reading_table
from solvers.analytic.predesign import predesign

THEORIES = {  # what the document and what the calibration call them
    "zone": {"thin_clamped_hz": "thin_clamped_hz", "clamped_hz": "clamped_hz"},
    "pillar": {"given_euler_hz": "euler", "given_timoshenko_hz": "timoshenko"},
}
TUNED = 0.005  # of the zone's frequency: a pillar no farther off needs no other height


def run(case: Case) -> tuple[dict[str, Any], str]:
    """Return the JSON document and the text of the analytic sizing, with each theory's expected error."""
    sizing = predesign(case.design)
    document = sizing.to_dict()
    lines = []
    for part in [each for each in THEORIES if document[each]]:
        calibrated = expected_errors(part, case.design)
        frequencies = [name for name, value in document[part].items() if name.endswith("_hz") and value is not None]
        errors = {name: calibrated.get(name) for name in frequencies}
        if known := {name: error for name, error in errors.items() if error is not None}:
            expected = ", ".join(f"{named(name)[0]} {percent(error)}" for name, error in known.items())
            lines.append(f"{part}, expected error beside a solid with clamped faces: {expected}")
        if unknown := [named(name)[0] for name in frequencies if name not in known]:
            lines.append(f"{part}, theory without an error estimate: {', '.join(unknown)}")
        document[part] = document[part] | {"expected_error": errors}
    return document, "\n".join([*_read(document, case.design), *lines, *(f"note: {text}" for text in sizing.limits)])


def _read(document: dict[str, Any], design: Design) -> list[str]:
    """What is proposed and what is given, a line each, and how the given pillar stands to the zone."""
    parts = [each for each in THEORIES if document[each]]
    rows = [[part, *each] for part in parts for each in document[part].items() if each[0] != "expected_error"]
    lines = [reading_table(("part", "quantity", "value"), rows)]
    zone, pillar = document.get("zone") or {}, document.get("pillar") or {}
    target, given = zone.get("frequency_hz"), pillar.get("given_timoshenko_hz")
    if target and given:
        known = expected_errors("pillar", design).get("given_timoshenko_hz")
        off, height = given / target - 1.0, pillar.get("timoshenko_height_mm")
        beside = f"{percentage(abs(off), known)} {'above' if off > 0.0 else 'below'} the zone's {frequency(target)}"
        better = f"; {figure(height)} mm of height would meet it" if height else ""
        lines.append(
            f"the pillar as given resonates at {frequency(given, known)}, "
            f"{beside + better if abs(off) >= TUNED else 'where the zone does'}"
        )
    return lines


def expected_errors(part: str, design: Design) -> dict[str, float]:
    """Expected relative error of each theory's frequency beside the solid; {} where none was calibrated."""
    slender = design.nodal_lines * design.thickness_m / design.length_m
    if part == "pillar":
        if not design.pillar or not design.pillar.is_square_prism:
            return {}
        slender = design.pillar.base_m / design.pillar.height_m
    elif design.nodal_lines < 2:
        return {}
    errors_by_theory = {name: calibration.by_theory(part, theory, slender) for name, theory in THEORIES[part].items()}
    return {name: error for name, error in errors_by_theory.items() if error is not None}
