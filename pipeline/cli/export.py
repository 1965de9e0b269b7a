"""`antinode export`: files for other programs."""

from __future__ import annotations

from argparse import Namespace
from math import inf
from typing import TYPE_CHECKING

from pipeline.case.limits import warn_of_doubts
from pipeline.case.model import load_case
from pipeline.logs import TerminalLog
from pipeline.questions.command import Answer, emit, of_case
from pipeline.records.part import DOCUMENT_SCHEMA

if TYPE_CHECKING:
    from pipeline.models.user_mesh import UserMesh


def _own_mesh(arguments: Namespace) -> UserMesh | None:
    """Return the mesh file of the command; InputError for its options without it."""
    from pipeline.errors import InputError
    from pipeline.models.user_mesh import UserMesh
    from pipeline.questions.modes import check_mesh_files

    given = {name: getattr(arguments, name) for name in ("unit", "clamp", "support", "merge")}
    if not arguments.mesh_file:
        if used := [f"--{name}" for name, value in given.items() if value not in (None, [])]:
            raise InputError(f"{used[0]}: applies to --mesh-file only")
        return None
    check_mesh_files([arguments.mesh_file])
    merge = None if given["merge"] is None else _distance(given["merge"])
    return UserMesh(arguments.mesh_file, given["unit"] or "m", given["clamp"], given["support"], merge)


def _distance(text: str) -> float:
    """Return a distance of 0 or more; InputError for another text."""
    from pipeline.errors import InputError

    try:
        distance = float(text)
    except ValueError:
        distance = -1.0
    if not 0.0 <= distance < inf:
        raise InputError(f"--merge {text}: must be a number of 0 or more, in the unit of the mesh file")
    return distance


def export(arguments: Namespace) -> int:
    """Write files for CAD, printing and other programs."""
    case, log = of_case(arguments, load_case(arguments.case, arguments.set)), TerminalLog(arguments.quiet)
    warn_of_doubts(case.design, log)
    from pipeline.exchange import exports

    own = _own_mesh(arguments)
    written = exports.write(
        case, arguments.format, arguments.output, log, arguments.part, arguments.force, own, folder=arguments.out
    )
    answer = Answer(
        {"schema": DOCUMENT_SCHEMA, "files": [str(path) for path in written]}, [f"wrote {path}" for path in written]
    )
    return emit(arguments, "export", answer)
