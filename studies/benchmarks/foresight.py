"""Foreseen against measured memory, each scene in a process of its own: `python -m studies.benchmarks.foresight [NAME ...]`.

Scenes off the calibrated design: other materials, thickness, sizes, accuracies, models and parts.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile

from pipeline.case.model import load_case
from pipeline.case.quantities import parse_band, parse_frequency
from pipeline.paths import ROOT
from pipeline.planning import plan
from pipeline.planning.request import Request
from pipeline.planning.resources import GIB, Demand

MEASURED = """import sys
from pipeline.batch import peak_memory
from pipeline.cli.main import main
code = main(sys.argv[1:])
print(peak_memory.peak_bytes())
sys.exit(code)"""  # the process tells its own peak: what its parent reads of it may begin with the parent's size
REFERENCE, SMALL = "studies/three-rows.toml", "examples/small.toml"
ROUND = 'pillar={shape="round",diameter_mm=2.0,height_mm=6.3}'
SCENES: dict[str, tuple[str, ...]] = {
    "zone": ("modes", REFERENCE, "--part", "zone"),
    "zone small": ("modes", SMALL, "--part", "zone"),
    "zone thin": ("modes", REFERENCE, "--part", "zone", "--set", "plate.thickness_mm=0.5"),
    "zone 3e-4": ("modes", REFERENCE, "--part", "zone", "--set", "solve.accuracy=3e-4", "--count", "40"),
    "zone 12 lines": ("modes", SMALL, "--part", "zone", "--set", "zone.nodal_lines=12"),
    "zone steel": (
        *("modes", REFERENCE, "--part", "zone", "--set", "plate.thickness_mm=6", "--set", 'material="steel"'),
        *("--set", "solve.accuracy=0.001"),
    ),
    "pillar slender": ("modes", REFERENCE, "--part", "pillar", "--set", "pillar.height_mm=40", "--count", "6"),
    "plate small": ("modes", SMALL),
    "plate": ("modes", REFERENCE),
    "plate thin": ("modes", REFERENCE, "--set", "plate.thickness_mm=1"),
    "plate pitch 10": ("modes", REFERENCE, "--set", "array.pitch_mm=10"),
    "plate steel pillars": (
        *("modes", REFERENCE, "--set", 'pillar.material="steel"', "--set", "solve.accuracy=0.001"),
    ),
    "solid small": ("modes", SMALL, "--set", "solve.model=solid"),
    "solid bare": ("modes", REFERENCE, "--set", "solve.model=solid", "--set", "array.rows=0"),
    "bands small": ("bands", SMALL),
    "bands 1e-3": ("bands", REFERENCE, "--set", "bands.points=4", "--set", "solve.accuracy=0.001"),
    "round pillar": ("modes", SMALL, "--part", "pillar", "--set", ROUND),
}  # fmt: skip


def foreseen(name: str) -> Demand:
    """What the plan of a scene foresees."""
    command, path, *words = SCENES[name]
    given = {word: value for word, value in zip(words[::2], words[1::2], strict=True) if word != "--set"}
    case = load_case(
        ROOT / path, [value for word, value in zip(words[::2], words[1::2], strict=True) if word == "--set"]
    )
    if command == "bands":
        planned = plan.of_bands(case)
    else:
        near, band, count = given.get("--near"), given.get("--band"), given.get("--count")
        request = Request(
            given.get("--part", "plate"),
            parse_band(band, "--band") if band else None,
            parse_frequency(near, "--near") if near else None,
            int(count) if count else None,
        )
        planned = plan.of_modes(case, request)
    (demand,) = planned.demands.values()
    return demand


def peak_bytes(name: str) -> int:
    """The largest resident size of the scene's command, its caches empty, B. RuntimeError where it fails."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "ANTINODE_RESULTS": folder, "PYTHONPATH": str(ROOT)}
        command = [sys.executable, "-c", MEASURED, *SCENES[name], "--quiet", "--json", f"{folder}/found.json"]
        ended = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    if ended.returncode:
        raise RuntimeError(f"{name}: exit code {ended.returncode}")
    return int(ended.stdout.split()[-1])


def main(names: list[str]) -> None:
    """One line a scene."""
    for name in names or SCENES:
        demand, peak = foreseen(name), peak_bytes(name)
        ratio = peak / demand.memory_bytes
        line = f"foreseen {demand.memory_bytes / GIB:6.2f} GiB, peak {peak / GIB:6.2f} GiB, ratio {ratio:.2f}"
        print(f"{name:20} {line}, most while {demand.cost.peak.name}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
