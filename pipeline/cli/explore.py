"""`antinode explore`: a local page with sliders for a design, which responds at once."""

from __future__ import annotations

import sys
import webbrowser
from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.case.limits import warn_of_doubts, warn_of_moduli
from pipeline.case.model import load_case
from pipeline.logs import TerminalLog
from pipeline.records import outputs

if TYPE_CHECKING:
    from pipeline.case.model import Case
    from pipeline.explore.answer import Explorer
    from pipeline.logs import Log


def run(arguments: Namespace) -> int:
    """Compute the model of the case's cell, or load it from the cache, and serve its page until interrupted."""
    path = Path(arguments.case)
    case = load_case(path, arguments.set)
    if arguments.export:
        outputs.check_files("--export", [arguments.export])
    log = TerminalLog(arguments.quiet)
    warn_of_doubts(case.design, log)
    if case.solve.moduli_kHz is None:
        warn_of_moduli(case.materials, log)
    explorer = explorer_of(case, case.raw, tuple(arguments.set), log)
    if arguments.export:
        export(explorer, Path(arguments.export), log)
        return 0
    from pipeline.explore.server import Server, serve

    browses = not arguments.no_browser and sys.stdout.isatty()  # interactive use on a desktop
    serve(Server(explorer), arguments.port, lambda address: opened(address, browses, arguments.quiet))
    return 0


def explorer_of(case: Case, raw: dict[str, Any], overrides: tuple[str, ...], log: Log) -> Explorer:
    """Return the page's answerer: the case and the model of its cell. Raises InputError for an unsupported case."""
    case.refuse("explore")
    case.require_plate("explore")
    case.require("pillar", "zone", command="explore")
    from pipeline.explore.answer import Explorer, Scene
    from pipeline.models.parametric import cell_model, laid_about

    scene = Scene(case, raw, overrides)
    scene.check()
    return Explorer(scene, cell_model(case, log, laid_about(case)))


def export(explorer: Explorer, path: Path, log: Log) -> None:
    """Write the page as a single file that runs in the browser alone."""
    from pipeline.explore.offline import page

    with log.step("write the page"):
        html = page(explorer)
        with outputs.delivered(path) as place:
            place.write_text(html, encoding="utf-8")


def opened(address: str, browser: bool, quiet: bool = False) -> None:
    """Print the address on standard output, and open it in a browser if requested."""
    print(address, flush=True)
    if not quiet:
        print("press Ctrl-C to stop; the address works on this machine only", file=sys.stderr)
    if browser:
        webbrowser.open(address)
