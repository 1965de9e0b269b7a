"""Antinode in a process of its own: `python -m studies.benchmarks.peers.ours TASK` prints its result as JSON."""

from __future__ import annotations

import json
import sys
from typing import Any

from geometry.hex.boxes import hex_mesh
from geometry.hex.scenes import HexSettings
from pipeline.case.model import load_case
from pipeline.logs import TerminalLog
from pipeline.models.modes import Request, solve_modes
from pipeline.paths import STUDIES
from pipeline.questions.bands import Bands
from pipeline.questions.question import Run, ask
from solvers.fem.eigen import modes_near
from solvers.fem.solid import SolidModel
from studies.benchmarks.peers.scene import KEPT, PARTS, boxes, seconds
from studies.ladder import materials

PLATE = ("array.rows=1", "array.extension_mm=5")
WINDOW_HZ = (34e3, 35.2e3)
LOWEST_HZ = 1e3  # below all modes: those nearest to it are the lowest
QUIET = TerminalLog(True)


def run(task: dict[str, Any]) -> dict[str, Any]:
    """Solve a part at an accuracy, as a case file would."""
    part, start = task["part"], seconds()
    if "accuracy" not in task["settings"]:
        return _meshed(part, task["settings"], start)
    own = PLATE if part == "plate" else ()
    case = load_case(STUDIES / "three-rows.toml", [f"solve.accuracy={task['settings']['accuracy']}", *own])
    if part == "cell":
        bands = ask(case, Bands(), Run(QUIET, detailed=False))
        at = [bands.labels.index(label) for label in "GXM"]
        return {"frequencies_hz": bands.frequencies_hz[at].tolist(), "dofs": bands.dof, "seconds": seconds() - start}
    given = PARTS[part]
    if part == "plate":
        request = Request(part, band_hz=WINDOW_HZ, symmetry="SS")
    else:
        symmetry = given.classes[0] if len(given.classes) == 1 else None
        request = Request(part, near_hz=LOWEST_HZ, count=KEPT[part], symmetry=symmetry, search=False)
    modes = solve_modes(case, request, QUIET)
    row = modes.target.row if modes.target else None
    frequencies_hz = [row.frequency_hz] if part == "plate" and row else [each.frequency_hz for each in modes.rows]
    return {"frequencies_hz": [sorted(frequencies_hz)], "dofs": modes.dof, "seconds": seconds() - start}


def _meshed(part: str, settings: dict[str, Any], start: float) -> dict[str, Any]:
    """A lone part on one mesh of order 4, without reduction or extrapolation."""
    sizes = 1e-3 * settings["size_mm"], 1e-3 * settings["along_mm"]
    mesh = hex_mesh(boxes(part, HexSettings(4, sizes[0], settings["layers"], 0.15, sizes[1])), 4)
    given = PARTS[part]
    model = SolidModel(mesh, materials(), given.clamped, True)
    pencils = [model.pencil(symmetry) for symmetry in given.classes]
    frequencies_hz = [modes_near(pencil, 0.0, given.count).frequency_hz.tolist() for pencil in pencils]
    return {"frequencies_hz": frequencies_hz, "dofs": sum(each.dof for each in pencils), "seconds": seconds() - start}


if __name__ == "__main__":
    print(json.dumps(run(json.loads(sys.argv[1]))))
