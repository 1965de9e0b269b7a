"""Antinode in a process of its own: `python -m studies.benchmarks.peers.ours TASK` prints what it found as JSON."""

from __future__ import annotations

import json
import sys
from typing import Any

from pipeline.analysis.bands import solve_bands
from pipeline.analysis.modes import Request, solve_modes
from pipeline.case.model import load_case
from pipeline.logs import TerminalLog
from pipeline.paths import STUDIES
from studies.benchmarks.peers.scene import KEPT, PARTS, seconds

PLATE = ("array.rows=1", "array.extension_mm=5")
WINDOW_HZ = (34e3, 35.2e3)
QUIET = TerminalLog(True)


def run(task: dict[str, Any]) -> dict[str, Any]:
    """A part at an accuracy, as a case file asks for it."""
    part, start = task["part"], seconds()
    own = PLATE if part == "plate" else ()
    case = load_case(STUDIES / "three-rows.toml", [f"solve.accuracy={task['settings']['accuracy']}", *own])
    if part == "cell":
        bands = solve_bands(case, QUIET, every_gap=False)
        at = [bands.path.labels.index(label) for label in "GXM"]
        return {"frequencies_hz": bands.frequencies_hz[at].tolist(), "dofs": bands.dof, "seconds": seconds() - start}
    given = PARTS[part]
    if part == "plate":
        request = Request(part, band_hz=WINDOW_HZ, symmetry="SS")
    else:
        symmetry = given.classes[0] if len(given.classes) == 1 else None
        request = Request(part, near_hz=0.0, count=KEPT[part], symmetry=symmetry, search=False)
    modes = solve_modes(case, request, QUIET)
    row = modes.wanted.row if modes.wanted else None
    found = [row.frequency_hz] if part == "plate" and row else [each.frequency_hz for each in modes.rows]
    return {"frequencies_hz": [sorted(found)], "dofs": modes.dof, "seconds": seconds() - start}


if __name__ == "__main__":
    print(json.dumps(run(json.loads(sys.argv[1]))))
