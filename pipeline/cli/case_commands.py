"""One function per command that takes a case: read it, solve, answer."""

from __future__ import annotations

from argparse import Namespace
from typing import Any

from pipeline.case.model import Case, load_case
from pipeline.case.plausible import warn_of_doubts
from pipeline.case.quantities import parse_band
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.quantity import figure, percent
from pipeline.records.reading import filled, reading_table
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


def response(arguments: Namespace) -> int:
    """Compute the forced response."""
    case, log, band = _read(arguments)
    if arguments.explain:
        return _explained(arguments, "of_response", case, band, arguments.points, bool(arguments.out))
    from pipeline.analysis import response as forced
    from pipeline.measured import comparison, synthetic

    measured = comparison.read(case, arguments.measured, arguments.map, arguments.at, band)
    solved = forced.solve(case, log, band, arguments.points)
    beside = comparison.compare(case, solved, measured, log) if measured else None
    made = synthetic.write(arguments, case, solved) if arguments.synthetic_data else []
    document = solved.record.to_dict() | ({"measured": beside.record.to_dict()} if beside else {})
    known = ROWS["response"](document)
    sensor = document["sensor_V_per_V"] or [[None, None]] * len(known)
    head = (*known[0], "sensor_re", "sensor_im")
    rows = [[*row.values(), *pair] for row, pair in zip(known, sensor, strict=True)]
    near = sorted(rows, key=lambda row: abs(row[0] - solved.peak.frequency_hz))[:15]
    lines = [
        f"{solved.model}, {solved.dof} degrees of freedom; around the peak of "
        f"the {'wanted mode' if solved.wanted else 'zone'}, per volt of drive:",
        reading_table(*filled(head, sorted(near))),
        *forced.lines(solved),
        *(beside.lines if beside else []),
        *(f"wrote {path}" for path in made),
    ]
    return emit(arguments, "response", Answer(document, lines, head, rows, lambda: _drawn(case, solved, beside)), log)


def _drawn(case: Case, solved: Any, beside: Any) -> list[Any]:
    """Pictures of a response, and of what was measured beside it."""
    from pipeline.plots import measured, response
    from pipeline.records.record import DesignRecord

    pictures = [response.curves(solved.record, solved.shape_points, solved.shape)]
    if beside:
        pictures.append(measured.report_figure(beside.record, beside.arrays, DesignRecord.of_design(case.design)))
    return pictures


def tolerance(arguments: Namespace) -> int:
    """Draw plates whose pillars differ, measure them, and print the spread."""
    more = [f"tolerance.{key}={value}" for key in ("samples", "seed") if (value := getattr(arguments, key)) is not None]
    case, log, band = _read(arguments, *more)
    if arguments.explain:
        from pipeline.measures import registry

        planned = registry.plan_of(case, ["live" if arguments.alike else "tolerance"])
        return emit(arguments, "plan", Answer(planned.to_dict(), [planned.text()]))
    if arguments.alike:
        return _alike(arguments, case, log, band)
    from pipeline.analysis import tolerance as drawn
    from pipeline.plots.response import report_figure

    solved = drawn.solve(case, log, band)
    per = "V" if case.patches else "N"
    head = tuple(f"{name}_m_per_{per}" if name == "zone_rms" else name for name in solved.nominal.to_dict())
    rows = [list(one.to_dict().values()) for one in solved.samples]
    lines = [
        f"{solved.pillars} pillars, driven by {solved.drive}",
        reading_table(head, rows),
        *drawn.lines(solved.record),
    ]
    pictures = lambda: [report_figure(solved.record, solved.arrays())]  # noqa: E731
    return emit(arguments, "tolerance", Answer(solved.record.to_dict(), lines, head, rows, pictures), log)


def _alike(arguments: Namespace, case: Case, log: TerminalLog, band: Band | None) -> int:
    """Plates whose pillars are all off by the same, answered from the explorer's bases."""
    if band:
        raise InputError("--band: the wanted mode of a column has a window of its own; leave --band or --alike out")
    from pipeline.analysis.tolerance import lines
    from pipeline.explore import alike
    from pipeline.plots.response import report_figure
    from pipeline.search.fidelity import column_level_error_db

    record = alike.solve(case, log)
    level = column_level_error_db(record.nominal.confinement_db, case.design.nodal_lines)
    head = ("peak_hz", "confinement_db", "tracking")
    rows = [[getattr(one, name) for name in head] for one in record.samples]
    said = [
        f"{record.pillars} pillars, all of a plate off by the same; one column of cells stands for the plate, within "
        f"{percent(record.frequency_error)} of its frequency"
        + (f" and {figure(level, level)} dB of its confinement" if level else ""),
        reading_table(head, rows),
        *lines(record),
    ]
    return emit(
        arguments, "tolerance", Answer(record.to_dict(), said, head, rows, lambda: [report_figure(record, {})]), log
    )


def active(arguments: Namespace) -> int:
    """Run an analogy or control model."""
    from pipeline.active.models import run

    return run(arguments)


def export(arguments: Namespace) -> int:
    """Write files for other programs."""
    case, log, _ = _read(arguments)
    from pipeline.exchange import exports

    if (arguments.part, arguments.format) != ("plate", "phonopy"):  # bands need a cell alone
        _require_part(case, arguments.part, f"export {arguments.format}")
    written = exports.write(case, arguments.format, arguments.output, log, arguments.part, arguments.force)
    answer = Answer({"schema": 1, "files": [str(path) for path in written]}, [f"wrote {path}" for path in written])
    return emit(arguments, "export", answer)
