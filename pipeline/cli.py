"""The command `antinode`: arguments in, one command run, faults told in one line each, an exit code out.

Nothing heavy is imported here: each command imports what it needs when it runs.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

DONE, WRONG_INPUT, NOT_TRUSTED, NOT_HELD, UNAVAILABLE, INTERRUPTED = 0, 2, 3, 4, 5, 130


class _Parser(argparse.ArgumentParser):
    """argparse, with one line for a fault instead of a usage block."""

    def error(self, message: str) -> NoReturn:
        print(f"{self.prog}: {message} (see {self.prog} --help)", file=sys.stderr)
        raise SystemExit(WRONG_INPUT)


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line; the exit code is the contract with scripts."""
    arguments = _parser().parse_args(argv)
    try:
        return _run(arguments)
    except KeyboardInterrupt:
        print("antinode: interrupted; what was finished is kept", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except Exception as fault:
        if arguments.debug:
            raise
        return _told(fault)


def _run(arguments: argparse.Namespace) -> int:
    module, _, function = arguments.handler.partition(":")
    return int(getattr(importlib.import_module(module), function)(arguments))


def _told(fault: Exception) -> int:
    """One line per reason, and the code that a fault stands for."""
    from geometry.errors import GeometryError, MeshError
    from pipeline.errors import CommandError
    from solvers.errors import SolverError

    if isinstance(fault, CommandError):
        lines, code = fault.lines, fault.exit_code
    elif isinstance(fault, MeshError | SolverError | MemoryError):
        lines, code = [" ".join(str(fault).split()) or "out of memory"], NOT_TRUSTED
    elif isinstance(fault, GeometryError | OSError):
        lines, code = [" ".join(str(fault).split())], WRONG_INPUT
    elif isinstance(fault, ModuleNotFoundError):
        lines, code = [f"{fault.name} is not installed: run `make setup`"], UNAVAILABLE
    else:
        lines, code = (
            [f"unexpected {type(fault).__name__}: {fault}; --debug shows where. Please report it"],
            NOT_TRUSTED,
        )
    for line in lines:
        print(f"antinode: {line}", file=sys.stderr)
    return code


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="antinode",
        description="Touch plates that hold their vibration: from one case file to modes, band gaps, prints and firmware.",
        epilog="example: antinode modes studies/three-rows.toml --part zone --near 40kHz --count 3",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(debug=False)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for add in (_add_case_commands, _add_active, _add_study_commands, _add_export, _add_checks):
        add(commands)
    return parser


def _command(commands: Any, name: str, text: str, example: str, handler: str) -> argparse.ArgumentParser:
    sub: argparse.ArgumentParser = commands.add_parser(
        name,
        help=text,
        description=text,
        epilog=f"example: antinode {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    sub.set_defaults(handler=handler)
    sub.add_argument("--quiet", action="store_true", help="no progress and no log on standard error")
    sub.add_argument("--debug", action="store_true", help="show where a fault came from")
    return sub


def _takes_case(sub: argparse.ArgumentParser, optional: bool = False) -> argparse.ArgumentParser:
    sub.add_argument("case", metavar="CASE", nargs="?" if optional else None, help="case file (TOML)")
    sub.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="override a key, such as pillar.height_mm=6.5"
    )
    sub.add_argument("--json", metavar="FILE|-", help="write the result as JSON; - for standard output, alone")
    sub.add_argument("--out", metavar="DIR", help="write JSON, tables and pictures into this folder")
    return sub


def _add_case_commands(commands: Any) -> None:
    case = "studies/three-rows.toml"
    _takes_case(_solver(commands, "predesign", "analytic sizing of zone and pillar", f"predesign {case}"))
    example = f"modes {case} --part zone --count 14"
    modes = _takes_case(_solver(commands, "modes", "modes of plate, zone or pillar", example))
    modes.add_argument("--part", choices=("plate", "zone", "pillar"), default="plate", help="default: the plate")
    modes.add_argument("--near", metavar="F", help="modes nearest to a frequency, such as 32kHz")
    modes.add_argument("--count", type=_positive, metavar="N", help="how many (with --near, or the lowest)")
    modes.add_argument("--band", metavar="F:F", help="every mode between two frequencies, such as 30kHz:34kHz")
    modes.add_argument(
        "--parity", choices=("++", "+-", "-+", "--"), help="one mirror class: u_z even (+) or odd (-) in x, y"
    )
    modes.add_argument("--mesh-file", metavar="FILE", help="solve this mesh instead of a part: .med, .msh or .inp")
    modes.add_argument("--unit", choices=("m", "mm"), default="m", help="length unit of the mesh file (default: m)")
    clamp = "hold this group of faces or nodes of the mesh file (repeatable)"
    modes.add_argument("--clamp", action="append", default=[], metavar="NAME", help=clamp)
    _takes_case(_solver(commands, "bands", "Bloch bands and gaps of the unit cell", f"bands {case}"))
    waves = _takes_case(
        _solver(commands, "attenuation", "decay per row across the zone's border", f"attenuation {case}")
    )
    waves.add_argument("--band", metavar="F:F", help="frequencies, such as 25kHz:45kHz")
    waves.add_argument(
        "--kx", type=float, metavar="K", help="wavenumber along the zone in rad/m (default: the wanted mode's)"
    )
    waves.add_argument("--points", type=_positive, metavar="N", default=201, help="how many frequencies (default: 201)")
    example = f"response {case} --band 28kHz:35kHz"
    response = _takes_case(_solver(commands, "response", "forced response to the patches", example))
    response.add_argument("--band", metavar="F:F", help="frequencies, such as 28kHz:35kHz")
    response.add_argument(
        "--points", type=_positive, metavar="N", default=401, help="how many frequencies (default: 401)"
    )


def _solver(commands: Any, name: str, text: str, example: str) -> argparse.ArgumentParser:
    return _command(commands, name, text, example, f"pipeline.commands:{name.replace('-', '_')}")


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text}: must be 1 or more")
    return value


def _add_active(commands: Any) -> None:
    active = _solver(commands, "active", "analogy and control models", "active beam --gain 1e7 --gain 1e8 --out beam")
    active.add_argument("model", choices=("mason", "pillar", "beam", "shaping", "dq"), help="which model")
    _takes_case(active, optional=True)
    again: dict[str, Any] = {"action": "append", "default": []}
    active.add_argument("--frequency", metavar="F", help="mason, beam, shaping, dq: such as 3kHz (repeatable)", **again)
    active.add_argument("--gain", metavar="K", help="beam: K' in N/m (repeatable)", **again)
    active.add_argument("--quality", metavar="Q", help="mason, pillar, beam, dq: quality factor, inf for no losses")
    active.add_argument("--delay", metavar="T", help="beam (repeatable), dq: dead time, such as 4us", **again)
    active.add_argument("--within", metavar="T", help="dq: 95 %% response asked for, such as 2ms")
    active.add_argument("--band", metavar="F:F", help="mason, pillar: frequencies, such as 25kHz:45kHz")
    active.add_argument(
        "--cell", action="store_true", help="pillar: compare with the computed plate cell (takes seconds)"
    )
    active.add_argument("--table", metavar="FILE", help="dq: mode table with the mode and its neighbours")
    active.add_argument("--sweep", metavar="FILE", help="dq: measured sweep (CSV: frequency_hz, re, im) to identify")


def _add_study_commands(commands: Any) -> None:
    run = _command(commands, "run", "a batch study", "run studies/rows.toml --jobs 2", "pipeline.study_commands:run")
    run.add_argument("study", metavar="STUDY", help="study file, or the name of one in studies/")
    run.add_argument("--jobs", type=_positive, metavar="N", help="cases at a time (default: one per core)")
    run.add_argument(
        "--scheduler", metavar="ADDRESS", help="hand the cases to a Dask scheduler, such as tcp://host:8786"
    )
    run.add_argument("--force", action="store_true", help="compute again what stands")
    run.add_argument("--fail-fast", action="store_true", help="stop at the first failure")
    run.add_argument("--keep-going", action="store_true", help="finish the other cases after a failure (the default)")
    run.add_argument("--dry-run", action="store_true", help="list what would run, and why")
    text = "rebuild pages and pictures from records"
    report = _command(commands, "report", text, "report rows", "pipeline.study_commands:report")
    report.add_argument("study", metavar="STUDY|accuracy|extremes", help="study file or name")


def _add_export(commands: Any) -> None:
    export = _solver(commands, "export", "files for others", "export stl studies/three-rows.toml -o plate.stl")
    export.add_argument(
        "format", choices=("stl", "step", "3mf", "aster", "calculix", "vtu", "table"), help="what to write"
    )
    _takes_case(export)
    export.add_argument(
        "-o", "--output", metavar="FILE", help="where to write (default: the case's name in this folder)"
    )
    part = "aster, calculix: which part (default: the plate)"
    export.add_argument("--part", choices=("plate", "zone", "pillar"), default="plate", help=part)


def _add_checks(commands: Any) -> None:
    example = "check-gap --set pillar.height_mm=6.426"
    _takes_case(_solver(commands, "check-gap", "band-gap edges against the committed ones", example), optional=True)
    doctor = _command(
        commands, "doctor", "what this machine has and lacks", "doctor table plate.bin", "pipeline.doctor:doctor"
    )
    doctor.add_argument("what", nargs="?", choices=("table",), help="examine a mode table instead")
    doctor.add_argument("file", nargs="?", metavar="FILE", help="the table")
    doctor.add_argument("--json", metavar="FILE|-", help="write the findings as JSON")


if __name__ == "__main__":
    raise SystemExit(main())
