"""`antinode export`: files for other programs."""

from __future__ import annotations

from argparse import Namespace

from pipeline.case.limits import warn_of_doubts
from pipeline.case.model import load_case
from pipeline.logs import TerminalLog
from pipeline.questions.command import Answer, emit, of_case
from pipeline.records.part import DOCUMENT_SCHEMA


def export(arguments: Namespace) -> int:
    """Write files for CAD, printing and other programs."""
    case, log = of_case(arguments, load_case(arguments.case, arguments.set)), TerminalLog(arguments.quiet)
    warn_of_doubts(case.design, log)
    from pipeline.exchange import exports

    written = exports.write(case, arguments.format, arguments.output, log, arguments.part, arguments.force)
    answer = Answer(
        {"schema": DOCUMENT_SCHEMA, "files": [str(path) for path in written]}, [f"wrote {path}" for path in written]
    )
    return emit(arguments, "export", answer)
