"""`antinode compare A B`: two designs side by side, what differs in them and in what they give."""

from __future__ import annotations

import json
from argparse import Namespace
from pathlib import Path
from typing import Any

Flat = dict[str, Any]
SHOWN_DIGITS = 6
NOT_COMPARED = ("seconds", "proof", "plan", "meshes", "times")


def run(arguments: Namespace) -> int:
    """Read both, line up their quantities, and print those that differ."""
    from pipeline.records import outputs
    from pipeline.views.answer import Answer, emit

    one, two = (read(Path(place), arguments.solve, arguments.quiet) for place in (arguments.a, arguments.b))
    rows = [row for row in lined_up(one, two) if arguments.all or row["a"] != row["b"]]
    head = ("quantity", "a", "b", "difference")
    cells = [[row[key] for key in head] for row in rows]
    document = {"a": arguments.a, "b": arguments.b, "rows": rows}
    words = outputs.table(head, cells) if cells else "nothing differs"
    return emit(arguments, "compare", Answer(document, [words], head, cells))


def read(place: Path, solve: bool, quiet: bool) -> Flat:
    """Quantities by their dotted names. InputError for what is neither a case nor a result."""
    from pipeline.errors import InputError

    if place.suffix == ".toml":
        return _of_case(place, solve, quiet)
    file = place / "record.json" if place.is_dir() else place
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{file}: cannot be read as a case (.toml), a record or a JSON result: {error}") from error
    if not isinstance(document, dict):
        raise InputError(f"{file}: holds no record and no JSON result")
    return flat({key: value for key, value in document.items() if key not in NOT_COMPARED})


def _of_case(place: Path, solve: bool, quiet: bool) -> Flat:
    from pipeline.analysis import predesign
    from pipeline.case.model import load_case
    from pipeline.logs import TerminalLog

    case = load_case(place)
    quantities = {"case": case.to_dict()}
    design = quantities["case"]["design"]
    design |= {f"row_{number}": pillar for number, pillar in enumerate(design.pop("graded", ()), start=1)}
    if {"plate", "zone"} <= case.given:
        quantities["predesign"] = {key: value for key, value in predesign.run(case)[0].items() if key != "limits"}
    if solve:
        from pipeline.analysis.bands import solve_bands
        from pipeline.analysis.modes import solve_modes
        from pipeline.planning.request import of_case

        log = TerminalLog(quiet)
        case.require_plate(command="compare --solve")
        wanted = solve_modes(case, of_case(case), log).record.to_dict()["wanted"] or {}
        quantities["wanted"] = {key: value for key, value in wanted.items() if not isinstance(value, list)}
        if "array.pitch_mm" in case.given and not case.design.is_graded:
            quantities["gaps"] = {
                f"{gap.lower_band}-{gap.upper_band}": vars(gap) for gap in solve_bands(case, log, every_gap=False).gaps
            }
    return flat(quantities)


def flat(value: Any, name: str = "") -> Flat:
    """Numbers, words and short lists by their dotted names; tables of points are left out."""
    if isinstance(value, dict):
        inside = (flat(item, f"{name}.{key}" if name else str(key)) for key, item in value.items())
        return {key: item for part in inside for key, item in part.items()}
    if isinstance(value, list):
        return {name: value} if len(value) <= 3 and not any(isinstance(item, (dict, list)) for item in value) else {}
    return {name: value}


def lined_up(one: Flat, two: Flat) -> list[dict[str, Any]]:
    """One row a quantity that either has; the difference relative to A where both are numbers."""
    both = ((name, one.get(name), two.get(name)) for name in dict.fromkeys((*one, *two)))
    return [{"quantity": name, "a": a, "b": b, "difference": _difference(a, b)} for name, a, b in both]


def _difference(a: Any, b: Any) -> float | None:
    numbers = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in (a, b))
    return float(f"{b / a - 1.0:.{SHOWN_DIGITS}g}") if numbers and a else None
