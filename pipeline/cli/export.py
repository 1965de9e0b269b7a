"""`antinode export`: files for other programs."""

from __future__ import annotations

from argparse import Namespace

from pipeline.case.limits import warn_of_doubts
from pipeline.case.model import Case, load_case
from pipeline.logs import TerminalLog
from pipeline.questions.command import Answer, emit, of_case
from pipeline.records.part import DOCUMENT_SCHEMA

SOLIDS = tuple(f"export {form}" for form in ("stl", "step", "3mf"))  # for any number of zones


def export(arguments: Namespace) -> int:
    """Write files for CAD, printing and other programs."""
    case, log = of_case(arguments, load_case(arguments.case, arguments.set)), TerminalLog(arguments.quiet)
    case.refuse_unused((), f"export {arguments.format}")
    warn_of_doubts(case.design, log)
    from pipeline.exchange import exports

    if (arguments.part, arguments.format) != ("plate", "phonopy"):  # bands need only a cell
        _require_part(case, arguments.part, f"export {arguments.format}")
    written = exports.write(case, arguments.format, arguments.output, log, arguments.part, arguments.force)
    answer = Answer(
        {"schema": DOCUMENT_SCHEMA, "files": [str(path) for path in written]}, [f"wrote {path}" for path in written]
    )
    return emit(arguments, "export", answer)


def _require_part(case: Case, part: str, command: str) -> None:
    if part == "plate":
        case.require_plate(command=command, several=command in SOLIDS, larger=True)
        if command not in SOLIDS:
            case.refuse_supports(command)
    elif part == "zone":
        case.require("plate", "zone", command="modes --part zone")
    else:
        case.require("pillar", command="modes --part pillar")
