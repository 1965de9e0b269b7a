"""`antinode tolerance`: a case's samples as text, JSON, table and picture."""

from __future__ import annotations

from argparse import Namespace

from pipeline.case.model import load_case
from pipeline.case.quantities import parse_band
from pipeline.logs import TerminalLog
from pipeline.records import outputs
from pipeline.views import files


def tolerance(arguments: Namespace) -> int:
    """Draw the case's plates, measure them, and print the spread."""
    more = [f"tolerance.{key}={value}" for key in ("samples", "seed") if (value := getattr(arguments, key)) is not None]
    case = outputs.of_case(arguments, load_case(arguments.case, [*arguments.set, *more]))
    log = TerminalLog(arguments.quiet)
    outputs.check_places(arguments)
    band = parse_band(arguments.band, "--band") if arguments.band else None
    if arguments.explain:
        from pipeline.measures import registry

        planned = registry.plan_of(case, ["tolerance"])
        outputs.emit(arguments, "plan", planned.to_dict(), planned.text())
        return 0
    from pipeline.analysis import tolerance as drawn

    computed = drawn.solve(case, log, band)
    document = computed.record.to_dict() | {"seconds": log.seconds | {"total": log.elapsed}}
    head = tuple(computed.nominal.to_dict())
    rows = [list(one.to_dict().values()) for one in computed.samples]
    text = [
        f"{computed.pillars} pillars, driven by {computed.drive}",
        outputs.table(head, rows),
        *drawn.lines(computed),
    ]
    files.emit(arguments, "tolerance", document, "\n".join(text), head, rows)
    if arguments.out:
        from pipeline.plots import style
        from pipeline.plots.response import report_figure

        folder = outputs.folder(arguments.out)
        with style.style():
            style.save(report_figure(computed.record, computed.arrays()), folder)
    return 0
