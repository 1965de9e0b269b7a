"""What a type checker sees of `import antinode` from outside the repository: methods of questions, options, results."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.questions import registered

ROOT = Path(__file__).resolve().parents[2]
GOOD = {
    "predesign": "sizes: float = plate.predesign().zone_hz",
    "modes": 'mode: float | None = plate.modes((30.0, 34.0), "zone", count=3, symmetry="SS")[0].mac',
    "mesh_modes": 'rigid: int = plate.mesh_modes("block.inp", unit="mm", clamp=("FOOT",)).rigid_count',
    "bands": "edges: list[float] = [gap.lower_hz for gap in plate.bands(progress=False).gaps]",
    "attenuation": "decay: float | None = plate.attenuation((30.0, 34.0), kx_per_m=204.0).points[0].db_per_row",
    "broadband": "width: float = plate.broadband(points=3).stopped_width_hz",
    "crosstalk": "levels: list[float] = plate.crosstalk((30.0, 34.0), points=5).zones[0].level_db",
    "hybrid": 'volts: list[float] = plate.hybrid(points=3, alpha=0.1).method("both").volts_per_um',
    "touch": "loads: list[float] = [each.finger_m for each in plate.touch((33.0, 36.0), mapped=False).states]",
    "travel": "crests: float | None = plate.travel((28.0, 36.0), others=0.1).crest_mm_s",
    "played_travel": "ratio: float = plate.played_travel().twr",
}
WRONG = {  # a line, and the code of the error that it must give
    "plate.crosstalk(pionts=5)": "call-arg",
    'plate.crosstalk(points="5")': "arg-type",
    'plate.modes(part="lid")': "arg-type",
    "plate.bands().gaps[0].lower_dB": "attr-defined",
    "plate.predesign(points=3)": "call-arg",
    "plate.band()": "attr-defined",
}


@pytest.mark.slow
def test_a_type_checker_sees_options_and_results(tmp_path: Path) -> None:
    lines = ["import antinode", 'plate = antinode.load("case.toml")', *GOOD.values(), *WRONG]
    (tmp_path / "use.py").write_text("\n".join(lines) + "\n")
    command = [sys.executable, "-m", "mypy", "--strict", "--hide-error-context", "--no-error-summary", "use.py"]
    silent = ["--follow-imports", "silent", "--ignore-missing-imports", "--cache-dir", str(tmp_path / "cache")]
    done = subprocess.run(
        [*command, *silent], cwd=tmp_path, env=os.environ | {"MYPYPATH": str(ROOT)}, capture_output=True, text=True
    )
    said = [line for line in done.stdout.splitlines() if ": error:" in line]
    first = len(lines) - len(WRONG) + 1
    found = {int(line.split(":")[1]): line.rpartition("[")[2].rstrip("]") for line in said}
    assert found == {first + place: code for place, code in enumerate(WRONG.values())}, done.stdout


def test_every_question_is_used_here() -> None:
    assert registered().keys() <= GOOD.keys()
