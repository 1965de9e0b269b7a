"""What this machine has and lacks; or what a mode table holds."""

from __future__ import annotations

import importlib.util
import os
import platform
import shutil
import sys
from argparse import Namespace
from importlib import metadata
from pathlib import Path
from typing import Any

from pipeline.errors import InputError, reason
from pipeline.questions.answer import Answer, emit
from pipeline.units import GIB

NEEDED = (
    *("numpy", "scipy", "cadquery", "pytetwild", "pyvista", "meshio"),
    *("trimesh", "pydantic", "rich", "matplotlib", "jinja2"),
)
OPTIONAL = {
    "rslab": "a faster factorisation: pip install 'antinode[fast]'",
    "ziglang": "a compiler for the firmware: pip install 'antinode[firmware]'",
    "unicorn": "the emulated board: pip install 'antinode[firmware]'",
    "distributed": "studies on a cluster: pip install 'antinode[cluster]'",
}
TOOLS = {
    "arm-none-eabi-gcc": "optional: ziglang builds the firmware without it",
    "cc": "needed by host tests of the firmware",
    "ccx": "optional: CalculiX, an independent solver",
    "run_aster": "optional: Code_Aster, an independent solver",
}


def doctor(arguments: Namespace) -> int:
    """`antinode doctor` and `antinode doctor table FILE`."""
    if arguments.what == "table":
        return _table(arguments)
    findings = examine()
    lines = []
    for group, entries in findings.items():
        lines += [group, *(f"   {name:14} {text}" for name, text in entries.items())]
    return emit(arguments, "doctor", Answer(findings, lines))


def examine() -> dict[str, dict[str, str]]:
    """Findings by group: machine, packages, optional, tools."""
    return {
        "machine": _machine(),
        "packages": {name: _version(name) or "MISSING: run `make setup`" for name in NEEDED},
        "optional": {name: _version(name) or f"absent; gives {what}" for name, what in OPTIONAL.items()},
        "tools": {name: shutil.which(name) or f"absent ({why})" for name, why in TOOLS.items()},
    }


def _machine() -> dict[str, str]:
    from solvers.fem.factor.choice import available

    entries = {
        "python": sys.version.split()[0],
        "system": f"{platform.system()} {platform.machine()}",
        "cores": str(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()),
        "factorisation": ", ".join(available()),
    }
    if importlib.util.find_spec("psutil"):
        import psutil

        memory = psutil.virtual_memory()
        entries["memory"] = f"{memory.available / GIB:.1f} of {memory.total / GIB:.1f} GiB free"
    return entries


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _table(arguments: Namespace) -> int:
    from firmware.table_format import MAX_BYTES
    from pipeline.board.table_file import TableError, describe, from_bytes

    if not arguments.file:
        raise InputError("doctor table: FILE: missing, must be a mode table such as mode_table.bin")
    try:
        with Path(arguments.file).open("rb") as file:
            table = from_bytes(file.read(MAX_BYTES + 1))
    except (OSError, TableError) as error:
        raise InputError(f"{arguments.file}: {reason(error)}") from error
    document: dict[str, Any] = {"version": table.version, "modes": len(table.modes), "wanted": table.wanted}
    document["frequencies_hz"] = [mode.frequency_hz for mode in table.modes]
    return emit(arguments, "table", Answer(document, [describe(table)]))
