"""Estimated against measured memory and processor time, each scene in a process of its own.

`python -m studies.benchmarks.resource_estimate [NAME ...]`. Scenes off the calibrated design: other materials,
thickness, sizes, accuracies, models and parts; driven plates; and cells of the kinds that are published: stubs stout,
slender, soft, tipped, of every shape.
"""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass

from pipeline.planning.resources import GIB
from studies.benchmarks import ran

MEASURED = """import sys, time
from solvers import machine
from pipeline.cli.main import main
from pipeline.planning.resources import ResourceEstimate
noted, text = [], ResourceEstimate.text
ResourceEstimate.text = lambda self: noted.append((self.memory_bytes, self.seconds)) or text(self)
code = main(sys.argv[1:])
print(max(each[0] for each in noted), sum(each[1] for each in noted), machine.peak_bytes(), time.process_time())
sys.exit(code)"""  # the process reports its own peak: the value that its parent reads of it may begin with the parent's size
REFERENCE, SMALL = "studies/three-rows.toml", "examples/small.toml"
ROUND = 'pillar={shape="round",diameter_mm=2.0,height_mm=6.3}'
SCENES = {
    "zone": f"modes {REFERENCE} --part zone",
    "zone small": f"modes {SMALL} --part zone",
    "zone thin": f"modes {REFERENCE} --part zone --set plate.thickness_mm=0.5",
    "zone 3e-4": f"modes {REFERENCE} --part zone --set solve.accuracy=3e-4 --count 40",
    "zone 12 lines": f"modes {SMALL} --part zone --set zone.nodal_lines=12",
    "zone steel": f'modes {REFERENCE} --part zone --set plate.thickness_mm=6 --set material="steel" --set solve.accuracy=0.001',
    "pillar slender": f"modes {REFERENCE} --part pillar --set pillar.height_mm=40 --count 6",
    "plate small": f"modes {SMALL}",
    "plate": f"modes {REFERENCE}",
    "plate thin": f"modes {REFERENCE} --set plate.thickness_mm=1",
    "plate pitch 10": f"modes {REFERENCE} --set array.pitch_mm=10",
    "plate steel pillars": f'modes {REFERENCE} --set pillar.material="steel" --set solve.accuracy=0.001',
    "plate on screws": "modes examples/30-screwed-plate.toml --set solve.accuracy=0.05",
    "solid small": f"modes {SMALL} --set solve.model=solid",
    "solid bare": f"modes {REFERENCE} --set solve.model=solid --set array.rows=0",
    "bands small": f"bands {SMALL}",
    "bands 1e-3": f"bands {REFERENCE} --set bands.points=4 --set solve.accuracy=0.001",
    "round pillar": f"modes {SMALL} --part pillar --set {ROUND}",
}
DRIVEN = {
    "response": f"response {REFERENCE}",
    "response whole": f"response {SMALL} --set patches={{size_mm=[6.0,3.0,0.3],centres_mm=[[-9.0,2.0],[4.0,-1.0]]}}",
    "tolerance": "tolerance studies/prototype-plate.toml --set tolerance.height_mm=0.05 --samples 2",
}
LARGE = {  # a display, which no test measures: `... resource_estimate display`
    "display": "modes studies/large-display.toml",
    "display driven": "response studies/large-display.toml --set patches={size_mm=[6.0,3.0,0.3]}",
}
SILICONE = "{young_GPa=1.175e-4,poisson=0.46875,density_kg_m3=1300.0}"


def _cell(pillar: str, *more: str, thickness_mm: float = 1.0, pitch_mm: float = 10.0, count: int = 10) -> str:
    """The command of a cell's bands, few wavevectors of them."""
    settings = (
        f"pillar={{{pillar}}}", f"plate.thickness_mm={thickness_mm}", f"array.pitch_mm={pitch_mm}", f"bands.count={count}",
        "bands.points=2", "bands.grid=2", "solve.accuracy=0.01", *more,
    )  # fmt: skip
    return " ".join(["bands", SMALL, *(f"--set {each}" for each in settings)])


STUB, SQUAT = 'shape="round",diameter_mm=7.0,height_mm=10.0', 'shape="round",diameter_mm=7.0,height_mm=5.0'
SOFT = f"{SQUAT},material={SILICONE}"
NECK = f'side_mm=6.0,section=[{{height_mm=5.0,material={SILICONE}}},{{height_mm=5.0,material="steel"}}]'
CELLS = {
    "stub": _cell(STUB, thickness_mm=5.0, count=16),
    "stub fine": _cell(STUB, "solve.accuracy=0.003", thickness_mm=5.0, count=16),
    "stub PMMA": _cell(STUB, 'material="pmma"', thickness_mm=5.0),
    "thick": _cell(STUB, thickness_mm=10.0, count=20),
    "triangular": _cell('shape="round",diameter_mm=4.0,height_mm=5.0', "array.pitch_y_mm=8.66", "array.stagger=true",
                        "solve.accuracy=0.03", count=12),
    "soft": _cell(SOFT, count=8),
    "soft many": _cell(SOFT, count=16),
    "soft both": _cell(f'{SOFT},faces="both"', "solve.accuracy=0.03", count=8),
    "neck and cap": _cell(NECK, count=8),
    "rods 40": _cell('shape="round",diameter_mm=6.35,height_mm=40.0', thickness_mm=6.0, pitch_mm=20.0),
    "rods 140": _cell('shape="round",diameter_mm=6.35,height_mm=140.0', thickness_mm=6.0, pitch_mm=20.0, count=20),
    "square rods": _cell('shape="square",side_mm=3.0,height_mm=60.0', thickness_mm=3.0, count=20),
    "tiny": _cell('shape="square",side_mm=0.25,height_mm=0.6', thickness_mm=2.0, pitch_mm=8.0),
    "steel on PMMA": _cell('shape="square",side_mm=2.0,height_mm=5.0,material="steel"', 'material="pmma"', pitch_mm=6.0),
    "both faces": _cell('shape="square",side_mm=1.2,height_mm=1.5,material="steel",faces="both"', 'material="glass"',
                        "solve.accuracy=0.03", thickness_mm=0.5, pitch_mm=4.0),
    "hexagonal": _cell('shape="hexagonal",side_mm=4.0,height_mm=6.0', thickness_mm=2.0),
    "tapered": _cell('shape="tapered",base_mm=4.0,tip_mm=2.5,height_mm=6.0', thickness_mm=2.0),
    "cross": _cell('shape="cross",side_mm=5.0,arm_mm=2.0,height_mm=6.0', thickness_mm=2.0),
    "filleted": _cell('shape="square",side_mm=4.0,height_mm=5.0,fillet_mm=0.5', "solve.accuracy=0.03", thickness_mm=2.0),
    "whole": _cell('shape="square",side_mm=3.0,height_mm=3.0', "solve.model=solid", "bands.path=GX", "bands.grid=0",
                   "solve.accuracy=0.1", thickness_mm=2.0, pitch_mm=4.0, count=6),
}  # fmt: skip


@dataclass(frozen=True)
class Taken:
    """Memory in B and processor time in s, estimated (with announced finer meshes) and measured, of a command.

    wall_s: time until it ended.
    """

    foreseen_bytes: float
    foreseen_s: float
    peak_bytes: float
    processor_s: float
    wall_s: float


def taken(name: str) -> Taken:
    """Run a scene's command with empty caches. RuntimeError where it fails."""
    command = (SCENES | DRIVEN | LARGE | CELLS)[name].split()
    ended = ran("-c", MEASURED, *command, "--quiet", "--json", os.devnull)
    foreseen_bytes, foreseen_s, peak_bytes, processor_s = map(float, ended.printed.split()[-4:])
    return Taken(foreseen_bytes, foreseen_s, peak_bytes, processor_s, ended.wall)


def main(names: list[str]) -> None:
    """Print one line per scene."""
    for name in names or SCENES | DRIVEN | LARGE | CELLS:
        one = taken(name)
        ratio, slower = one.peak_bytes / one.foreseen_bytes, one.processor_s / one.foreseen_s
        line = f"estimated {one.foreseen_bytes / GIB:6.2f} GiB, peak {one.peak_bytes / GIB:6.2f} GiB, ratio {ratio:.2f}"
        times = (
            f"{one.foreseen_s:4.0f} s, {one.processor_s:4.0f} s, ratio {slower:.2f}; {one.wall_s:4.0f} s until its end"
        )
        print(f"{name:20} {line}; {times}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
