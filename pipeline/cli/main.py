"""The command `antinode`: arguments in, one command run, faults told in one line each, an exit code out.

Nothing heavy is imported here: each command imports what it needs when it runs.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import Any, NoReturn

from pipeline.case import limits
from pipeline.errors import one_line
from pipeline.process import lend_cache_folders, terminable

# What commands read, by the names of their arguments: never written over.
READ = ("case", "study", "target", "mesh_file", "measured", "map", "table", "sweep", "file")
MAX_DIGITS = 40  # characters
RENAMED = {
    "--parity": "--symmetry SS, SA, AS or AA",
    "--fields": "--save-all-fields",
    "--above": "--min-frequency",
    "--half-wave": "--max-half-wavelength",
    "--feature": "--min-feature",
    "--confirm": "--verify-with",
    "--within": "--settling-time",
    "--synthesise": "--synthetic-data",
}
MODULES = (
    "pipeline.cli.new",
    "pipeline.cli.compare",
    "pipeline.cli.listing",
)  # each adds its commands; light to import
DONE, WRONG_INPUT, NOT_TRUSTED, NOT_HELD, UNAVAILABLE, INTERRUPTED = 0, 2, 3, 4, 5, 130


class _Parser(argparse.ArgumentParser):
    """argparse, with one line for a fault instead of a usage block."""

    def error(self, message: str) -> NoReturn:
        print(one_line(f"{self.prog}: {message} (see {self.prog} --help)"), file=sys.stderr)
        raise SystemExit(WRONG_INPUT)


def _refuse_renamed(words: Sequence[str]) -> None:
    """One line for an option by the name it had once, with the one it has now; exit code 2."""
    lines = [
        f"antinode: {old}: is called {RENAMED[old]} now"
        for old in dict.fromkeys(
            word.partition("=")[0] for word in words[: words.index("--") if "--" in words else None]
        )
        if old in RENAMED
    ]
    if lines:
        print("\n".join(lines), file=sys.stderr)
        raise SystemExit(WRONG_INPUT)


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command line; the exit code is the contract with scripts."""
    words = sys.argv[1:] if argv is None else argv
    _refuse_renamed(words)
    arguments = _parser().parse_args(words)
    try:
        with terminable():
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
        return _report_error(fault)


def _run(arguments: argparse.Namespace) -> int:
    from geometry.files import inputs_kept, read_by_command
    from pipeline.records import outputs
    from pipeline.views import files

    lend_cache_folders()
    module, _, function = arguments.handler.partition(":")
    with inputs_kept():
        read_by_command(*(place for name in READ if isinstance(place := getattr(arguments, name, None), str)))
        files.check(arguments)
        outputs.check_places(arguments)
        return int(getattr(importlib.import_module(module), function)(arguments))


def _report_error(fault: Exception) -> int:
    """One line per reason, and the code that a fault stands for."""
    from geometry.errors import GeometryError, MeshError
    from pipeline.errors import CommandError
    from solvers.errors import SolverError

    if isinstance(fault, CommandError):
        lines, code = fault.lines, fault.exit_code
    elif isinstance(fault, MemoryError):
        from solvers.fem.factor.memory import memory_text

        lines, code = [memory_text(fault)], NOT_TRUSTED
    elif isinstance(fault, MeshError | SolverError):
        lines, code = [" ".join(str(fault).split())], NOT_TRUSTED
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
        print(f"antinode: {one_line(line)}", file=sys.stderr)
    return code


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="antinode",
        description="Touch plates that hold their vibration: from one case file to modes, band gaps, prints and firmware.",
        epilog="example: antinode modes studies/three-rows.toml --part zone --near 40kHz --count 3",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(debug=False)
    parser.add_argument("--version", action="version", version=f"antinode {version('antinode')}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for add in (_add_case_commands, _add_search, _add_active, _add_study_commands, _add_export, _add_checks):
        add(commands)
    for module in MODULES:
        importlib.import_module(module).add(commands, _command)
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
    _computes(_solver(commands, "predesign", "analytic sizing of zone and pillar", f"predesign {case}"))
    example = f"modes {case} --part zone --count 14"
    modes = _computes(_solver(commands, "modes", "modes of plate, zone or pillar", example))
    modes.add_argument("--part", choices=("plate", "zone", "pillar"), default="plate", help="default: the plate")
    modes.add_argument("--near", metavar="F", help="modes nearest to a frequency, such as 32kHz")
    modes.add_argument(
        "--count", type=_up_to(limits.MAX_MODES), metavar="N", help="how many (with --near, or the lowest)"
    )
    modes.add_argument("--band", metavar="F:F", help="every mode between two frequencies, such as 30kHz:34kHz")
    modes.add_argument(
        "--symmetry",
        choices=("SS", "SA", "AS", "AA"),
        help="one symmetry class: u_z symmetric (S) or antisymmetric (A), in x then in y",
    )
    modes.add_argument("--mesh-file", metavar="FILE", help="solve this mesh instead of a part: .med, .msh or .inp")
    modes.add_argument("--unit", choices=("m", "mm"), help="length unit of the mesh file (default: m)")
    clamp = "hold this group of faces or nodes of the mesh file (repeatable)"
    modes.add_argument("--clamp", action="append", default=[], metavar="NAME", help=clamp)
    every = "write the field of every mode into --out DIR (fields.npz)"
    modes.add_argument("--save-all-fields", action="store_true", help=every)
    _explains(modes)
    _explains(_computes(_solver(commands, "bands", "Bloch bands and gaps of the unit cell", f"bands {case}")))
    waves = _computes(_solver(commands, "attenuation", "decay per row across the zone's border", f"attenuation {case}"))
    _over_frequency(waves, "25kHz:45kHz", 201)
    waves.add_argument(
        "--kx", type=_wavenumber, metavar="K", help="wavenumber along the zone in rad/m (default: the wanted mode's)"
    )
    _explains(waves)
    example = f"response {case} --band 28kHz:38kHz"
    response = _computes(_solver(commands, "response", "forced response to the patches", example))
    _over_frequency(response, "28kHz:38kHz", 401)
    _explains(response)
    _add_measured(response)
    _add_tolerance(commands)


def _add_tolerance(commands: Any) -> None:
    text = "how far peak and confinement move when no two pillars are alike ([tolerance] in the case)"
    example = "tolerance studies/three-rows.toml --set tolerance.height_mm=0.05 --samples 20 --out spread"
    spread = _computes(_command(commands, "tolerance", text, example, "pipeline.cli.tolerance:tolerance"))
    spread.add_argument("--band", metavar="F:F", help="frequencies, such as 28kHz:38kHz")
    spread.add_argument(
        "--samples", type=_up_to(limits.MAX_SAMPLES), metavar="N", help="how many plates (default: the case's, 20)"
    )
    spread.add_argument(
        "--seed", type=_up_to(limits.MAX_SEED), metavar="N", help="of the draw (default: the case's, 1)"
    )
    _explains(spread)


def _over_frequency(sub: argparse.ArgumentParser, example: str, points: int) -> None:
    sub.add_argument("--band", metavar="F:F", help=f"frequencies, such as {example}")
    count = _up_to(limits.MAX_FREQUENCIES)
    words = f"how many frequencies (default: {points})"
    sub.add_argument("--points", type=count, metavar="N", default=points, help=words)


def _computes(sub: argparse.ArgumentParser) -> argparse.ArgumentParser:
    _takes_case(sub)
    sub.add_argument("--plot", metavar="FILE", help="draw the result into a .png, .pdf or .svg file")
    sub.add_argument("--csv", metavar="FILE", help="write the result's rows as CSV, units in the head line")
    return sub


def _explains(sub: argparse.ArgumentParser) -> None:
    text = "tell what would be computed, what is left out, and why; compute nothing"
    sub.add_argument("--explain", action="store_true", help=text)


def _add_measured(response: argparse.ArgumentParser) -> None:
    columns = "CSV with frequency_Hz (or kHz) and real, imag or amplitude, phase_deg"
    response.add_argument("--measured", metavar="FILE", help=f"a measured sweep to compare with: {columns}")
    columns = "CSV with x_mm, y_mm and real, imag or amplitude, phase_deg"
    response.add_argument("--map", metavar="FILE", help=f"a vibrometer's map of the touch face: {columns}")
    response.add_argument(
        "--at", metavar="X,Y", help="where the sweep's laser stood, mm (default: where the zone moves most)"
    )
    response.add_argument(
        "--synthetic-data", metavar="DIR", help="write sweep.csv and field.csv as if measured, marked SYNTHETIC"
    )
    response.add_argument(
        "--seed",
        type=_up_to(limits.MAX_SEED),
        default=1,
        metavar="N",
        help="of the noise of --synthetic-data (default: 1)",
    )
    response.add_argument("--noise", type=_share, metavar="R", help="rms of that noise over the peak (default: 0.01)")


def _solver(commands: Any, name: str, text: str, example: str) -> argparse.ArgumentParser:
    return _command(commands, name, text, example, f"pipeline.cli.case_commands:{name.replace('-', '_')}")


def _up_to(most: int) -> Callable[[str], int]:
    """The type of an option that counts something, from 1 to `most`, as the same key of a case file does."""

    def number(text: str) -> int:
        value = int(text) if len(text) < MAX_DIGITS else 0
        if not 1 <= value <= most:
            raise argparse.ArgumentTypeError(f"{text[:MAX_DIGITS]}: must be 1 or more, at most {most}")
        return value

    return number


def _wavenumber(text: str) -> float:
    value = float(text)
    if not abs(value) <= limits.MAX_WAVENUMBER:
        raise argparse.ArgumentTypeError(f"{text}: must be a number of at most {limits.MAX_WAVENUMBER:g} rad/m")
    return value


def _add_search(commands: Any) -> None:
    text = "the design that holds the wanted mode best"
    example = "search studies/three-rows.toml --vary pillar.height_mm=5:8 --vary array.pitch_mm=4:8 --out found"
    search = _command(commands, "search", text, example, "pipeline.cli.search:search")
    _takes_case(search)
    varied = "a key of plate, zone, pillar or array between two ends (repeatable)"
    search.add_argument("--vary", action="append", default=[], metavar="KEY=LOW:HIGH", help=varied)
    goal = (
        "what to raise: dB on the zone over the passive face, or over the plate beyond the rows (default: confinement)"
    )
    search.add_argument("--goal", choices=("confinement", "extension"), default="confinement", help=goal)
    budget = "assembled plates to spend, three columns of cells to each (default: 16)"
    search.add_argument("--evaluations", type=_up_to(limits.MAX_EVALUATIONS), metavar="N", default=16, help=budget)
    search.add_argument(
        "--min-frequency", metavar="F", default="25kHz", help="lowest frequency allowed (default: 25kHz)"
    )
    half = "largest half-wavelength along the zone (default: 20)"
    search.add_argument("--max-half-wavelength", type=float, metavar="MM", default=20.0, help=half)
    search.add_argument(
        "--min-feature", type=float, metavar="MM", default=0.4, help="smallest printable size (default: 0.4)"
    )
    mac = "least modal assurance to the wanted shape (default: 0.8)"
    search.add_argument("--mac", type=float, metavar="SHARE", default=0.8, help=mac)
    proof = "solve the design as it was and the best one by this model, too (solid: minutes each)"
    search.add_argument("--verify-with", choices=("plate", "solid"), default="plate", help=proof)


def _share(text: str) -> float:
    value = float(text)
    if not 0.0 <= value < 1.0:
        raise argparse.ArgumentTypeError(f"{text}: must be 0 or more and below 1")
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
    active.add_argument("--settling-time", metavar="T", help="dq: 95 %% response asked for, such as 2ms")
    active.add_argument("--band", metavar="F:F", help="mason, pillar: frequencies, such as 25kHz:45kHz")
    active.add_argument(
        "--cell", action="store_true", help="pillar: compare with the computed plate cell (takes seconds)"
    )
    active.add_argument("--table", metavar="FILE", help="dq: mode table with the mode and its neighbours")
    active.add_argument("--sweep", metavar="FILE", help="dq: measured sweep (CSV: frequency_hz, re, im) to identify")


def _add_study_commands(commands: Any) -> None:
    run = _command(
        commands, "run", "a batch study", "run studies/rows.toml --jobs 2", "pipeline.cli.study_commands:run"
    )
    run.add_argument("study", metavar="STUDY", help="study file, or the name of one in studies/")
    run.add_argument(
        "--jobs", type=_up_to(limits.MAX_JOBS), metavar="N", help="cases at a time (default: one per core)"
    )
    run.add_argument(
        "--scheduler", metavar="ADDRESS", help="hand the cases to a Dask scheduler, such as tcp://host:8786"
    )
    run.add_argument("--force", action="store_true", help="compute again what stands")
    run.add_argument("--fail-fast", action="store_true", help="stop at the first failure")
    run.add_argument("--keep-going", action="store_true", help="finish the other cases after a failure (the default)")
    run.add_argument("--dry-run", action="store_true", help="list what would run, and why, and each case's plan")
    run.add_argument(
        "--save-all-fields", action="store_true", help="keep the field of every mode, too (fields.npz in each case)"
    )
    text = "rebuild pages and pictures from records"
    report = _command(commands, "report", text, "report rows", "pipeline.cli.study_commands:report")
    report.add_argument("study", metavar="STUDY|accuracy|extremes", help="study file or name")
    text = "a window on a plate and its modes"
    view = _command(commands, "view", text, "view rows --case pitch_mm=4,rows=3", "pipeline.cli.view:view")
    view.add_argument(
        "target", metavar="CASE|FILE.vtu|STUDY", help="case file, mesh file, or study with stored results"
    )
    view.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="CASE: override a key, such as array.rows=2"
    )
    view.add_argument("--solve", action="store_true", help="CASE: compute its wanted mode, too (takes seconds)")
    view.add_argument("--case", dest="case_id", metavar="ID", help="STUDY: which case (default: the one confined best)")


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
    export.add_argument(
        "--force", action="store_true", help="a mode table even where no mode is the wanted one: of the most similar"
    )
    export.add_argument("--part", choices=("plate", "zone", "pillar"), default="plate", help=part)


def _add_checks(commands: Any) -> None:
    example = "check-gap --set pillar.height_mm=6.426"
    _takes_case(_solver(commands, "check-gap", "band-gap edges against the committed ones", example), optional=True)
    doctor = _command(
        commands, "doctor", "what this machine has and lacks", "doctor table plate.bin", "pipeline.cli.doctor:doctor"
    )
    doctor.add_argument("what", nargs="?", choices=("table",), help="examine a mode table instead")
    doctor.add_argument("file", nargs="?", metavar="FILE", help="the table")
    doctor.add_argument("--json", metavar="FILE|-", help="write the findings as JSON")


if __name__ == "__main__":
    raise SystemExit(main())
