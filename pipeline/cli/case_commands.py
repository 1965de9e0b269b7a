"""One function per command that takes a case: read it, solve, answer."""

from __future__ import annotations

from argparse import Namespace
from typing import Any

from pipeline.case.model import Case, load_case
from pipeline.case.plausible import warn_of_doubts
from pipeline.case.quantities import parse_band
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.records import outputs
from pipeline.views.answer import Answer, emit, of_case
from pipeline.views.rows import ROWS

Band = tuple[float, float]
SOLIDS = tuple(f"export {form}" for form in ("stl", "step", "3mf"))  # of any number of zones


def _read(arguments: Namespace, *overrides: str) -> tuple[Case, TerminalLog, Band | None]:
    """Case, log and band of a command line."""
    case = of_case(arguments, load_case(arguments.case, [*arguments.set, *overrides]))
    log, band = TerminalLog(arguments.quiet), getattr(arguments, "band", None)
    warn_of_doubts(case.design, log)
    return case, log, parse_band(band, "--band") if band else None


def _require_part(case: Case, part: str, command: str = "") -> None:
    if part == "plate":
        case.require_plate(command=command or "modes --part plate", several=command in SOLIDS)
    elif part == "zone":
        case.require("plate", "zone", command="modes --part zone")
    else:
        case.require("pillar", command="modes --part pillar")


def _explained(arguments: Namespace, which: str, *about: Any) -> int:
    """Print the plan of a command instead of following it."""
    from pipeline.planning import plan

    planned = getattr(plan, which)(*about)
    return emit(arguments, "plan", Answer(planned.to_dict(), [planned.text()]))


def touch(arguments: Namespace) -> int:
    """Put a finger on the driven plate."""
    case, log, band = _read(arguments)
    if arguments.explain:
        return _explained(arguments, "of_touch", case, band, not arguments.no_map, bool(arguments.out))
    from pipeline.analysis import touch as touched
    from pipeline.plots.touch import tactile_map

    record = touched.solve(case, log, band, mapped=not arguments.no_map)
    lines = [*touched.lines(record), *record.unknown]
    return _ran(arguments, "touch", record, lines, lambda: [tactile_map(record)] if record.map else [], log)


def hybrid(arguments: Namespace) -> int:
    """Compute confinement by rows, by patches and by both."""
    case, log, band = _read(arguments)
    if arguments.explain:
        return _explained(arguments, "of_hybrid", case, band, arguments.points, bool(arguments.out))
    from pipeline.driven import hybrid as together
    from pipeline.plots.response import hybrid_levels

    record = together.solve(case, log, band, arguments.points, arguments.alpha)
    return _ran(arguments, "hybrid", record, together.lines(record), lambda: [hybrid_levels(record)], log)


def travel(arguments: Namespace) -> int:
    """Hold two modes of the zone a quarter period apart."""
    if not 0.0 <= arguments.others <= 1.0:
        raise InputError(f"--others = {arguments.others:g}: must be from 0 to 1")
    case, log, band = _read(arguments)
    if arguments.explain:
        return _explained(arguments, "of_travel", case, band, bool(arguments.out))
    from pipeline.driven import played, travelling
    from pipeline.plots.response import travelling_wave
    from pipeline.plots.touch import shear_map

    record, wave = travelling.solve(case, log, band, arguments.others)
    place = outputs.folder(arguments.out) if arguments.out else None
    record = record.model_copy(update=played.board_outcome(wave, log, place, arguments.board))
    lines = [*travelling.lines(record), *played.lines(record)]

    def drawn() -> list[Any]:
        more = [shear_map(record.shear, case.design.width_m)] if record.shear else []
        return [travelling_wave(record), *more]

    return _ran(arguments, "travel", record, lines, drawn, log)


def _ran(arguments: Namespace, name: str, record: Any, lines: list[str], pictures: Any, log: TerminalLog) -> int:
    """Answer with a record: its own rows, its lines in words."""
    document = record.to_dict()
    rows = ROWS[name](document)
    return emit(
        arguments, name, Answer(document, lines, tuple(rows[0]), [[*row.values()] for row in rows], pictures), log
    )


def export(arguments: Namespace) -> int:
    """Write files for other programs."""
    case, log, _ = _read(arguments)
    from pipeline.exchange import exports

    if (arguments.part, arguments.format) != ("plate", "phonopy"):  # bands need a cell alone
        _require_part(case, arguments.part, f"export {arguments.format}")
    written = exports.write(case, arguments.format, arguments.output, log, arguments.part, arguments.force)
    answer = Answer({"schema": 1, "files": [str(path) for path in written]}, [f"wrote {path}" for path in written])
    return emit(arguments, "export", answer)
