"""What a type checker sees of `import antinode` from outside the repository: methods of questions, options, results."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.case import schema as tables
from pipeline.case.schema import MATERIAL_OWNERS, TABLES
from pipeline.questions import registered

ROOT = Path(__file__).resolve().parents[2]
GOOD = {
    "predesign": "sizes: float = plate.predesign().zone_hz",
    "modes": 'mode: float | None = plate.modes((30.0, 34.0), "zone", count=3, symmetry="SS")[0].mac',
    "mesh_modes": 'rigid: int = plate.mesh_modes("block.inp", unit="mm", clamp=("FOOT",)).rigid_count',
    "bands": "edges: list[float] = [gap.lower_hz for gap in plate.bands(progress=False).gaps]",
    "supercell_bands": 'wide: int = len(plate.supercell_bands("3x1").gaps)',
    "mesh_bands": 'shape: tuple[int, ...] = plate.mesh_bands(("cell.msh",), unit="mm").frequencies_hz.shape',
    "attenuation": "decay: float | None = plate.attenuation((30.0, 34.0), kx_per_m=204.0).points[0].db_per_row",
    "broadband": "width: float = plate.broadband(points=3).stopped_width_hz",
    "search": "found: float | None = plate.search(height_mm=(6.0, 6.6), material=('steel', 'brass'), goal='worst').best.mac",
    "response": "tone: float = plate.response((30.0, 34.0), points=5).highest_peak.frequency_hz",
    "measured_response": 'measured: object = plate.measured_response(map="field.csv", points=5).measured',
    "synthetic_response": 'noisy: list[float] = plate.synthetic_response(synthetic_data="made").frequency_hz',
    "tolerance": "worst: float | None = plate.tolerance(samples=3).samples[0].confinement_db",
    "alike_tolerance": "alike: int = plate.alike_tolerance(seed=2).lost",
    "drift": "slope: float | None = plate.drift(10.0, points=3).drift_hz_per_K",
    "crosstalk": "levels: list[float] = plate.crosstalk((30.0, 34.0), points=5).zones[0].level_db",
    "active_mason": "confined: float = plate.active_mason(frequency_kHz=20.0).confinement_db['filtered']",
    "active_pillar": "stopped: float = plate.active_pillar(cell=False).stopped_hz",
    "active_beam": "strength: float = plate.active_beam(gain_N_per_m=(1e7,), delay_s=(4e-6,)).cases[0].strength",
    "active_shaping": "said: str = plate.active_shaping().comparison[0].ours",
    "active_dq": "steps: int = len(plate.active_dq(settling_time_s=2e-3).steps)",
    "hybrid": 'volts: list[float] = plate.hybrid(points=3, alpha=0.1).method("both").volts_per_um',
    "touch": "loads: list[float] = [each.finger_m for each in plate.touch((33.0, 36.0), mapped=False).states]",
    "travel": "crests: float | None = plate.travel((28.0, 36.0), others=0.1).travel_crest_mm_s",
    "played_travel": "ratio: float = plate.played_travel().twr",
}
SWEPT = (
    "table: antinode.SweepTable = antinode.sweep(plate, measure=['modes', antinode.Bands], jobs=1, pitch_mm=[4.0, 5.0])",
    "swept_edges: list[float] = [gap.lower_hz for bands in table.of(antinode.Bands) if bands for gap in bands.gaps]",
)
MADE = (
    "zone = antinode.Zone(length_mm=115.5, width_mm=20.0, nodal_lines=8)",
    "patches = antinode.Patches(size_mm=(12.0, 3.0, 0.3), centres_mm=[(-14.0, 0.0)], sensors=[1])",
    "array = antinode.Array(pitch_mm=4.0, rows=3)",
    "made = antinode.Plate(thickness_mm=2.0, zone=zone, pillar=antinode.Pillar(side_mm=2.0), array=array, patches=patches)",
    "zone_width: float = made.zone.width_mm",
    "files: int = len(made.export('step', 'plate.step'))",
    "other: antinode.Plate = made.with_(pitch_mm=5.0, damping=antinode.Damping(quality=200.0))",
)
WRONG = {  # a line, and how mypy and pyright name the error that it must give
    "plate.crosstalk(pionts=5)": ("call-arg", "reportCallIssue"),
    'plate.crosstalk(points="5")': ("arg-type", "reportArgumentType"),
    'plate.modes(part="lid")': ("arg-type", "reportArgumentType"),
    "plate.bands().gaps[0].lower_dB": ("attr-defined", "reportAttributeAccessIssue"),
    "plate.predesign(points=3)": ("call-arg", "reportCallIssue"),
    "plate.search(height_mm=(6.0, 6.6), evalutions=3)": ("arg-type", "reportArgumentType"),
    "plate.search(goal='loud', height_mm=(6.0, 6.6))": ("arg-type", "reportArgumentType"),
    "plate.search(height_mm=(6.0, 6.6)).evaluations[0].frequency": ("attr-defined", "reportAttributeAccessIssue"),
    "antinode.Zone(lenght_mm=115.5)": ("typeddict-unknown-key", "reportCallIssue"),
    "antinode.Solve(mesh='quad')": ("typeddict-item", "reportArgumentType"),
    "antinode.Plate(zone=antinode.Damping(quality=200.0))": ("arg-type", "reportArgumentType"),
    "plate.band()": ("attr-defined", "reportAttributeAccessIssue"),
    "antinode.sweep(plate, measure=[antinode.Plate], pitch_mm=[4.0])": ("list-item", "reportArgumentType"),
    "antinode.sweep(plate, pitch_mm=4.0)": ("arg-type", "reportArgumentType"),
    "[bands and bands.dB for bands in table.of(antinode.Bands)]": ("attr-defined", "reportAttributeAccessIssue"),
}
LINES = ["import antinode", 'plate = antinode.load("case.toml")', *GOOD.values(), *SWEPT, *MADE, *WRONG]
CONFIG = {"extraPaths": [str(ROOT)], "typeCheckingMode": "strict", "reportUnusedExpression": False}


def said_by(words: list[str], folder: Path) -> str:
    (folder / "use.py").write_text("\n".join(LINES) + "\n")
    whole = [sys.executable, "-m", *words, "use.py"]
    return subprocess.run(
        whole, cwd=folder, env=os.environ | {"MYPYPATH": str(ROOT)}, capture_output=True, text=True
    ).stdout


def expected(checker: int) -> dict[int, str]:
    return {number: WRONG[line][checker] for number, line in enumerate(LINES, start=1) if line in WRONG}


@pytest.mark.slow
def test_mypy_sees_options_and_results(tmp_path: Path) -> None:
    options = ["--config-file", str(ROOT / "pyproject.toml"), "--cache-dir", str(ROOT / ".mypy_cache")]
    said = said_by(["mypy", *options, "--hide-error-context"], tmp_path)
    errors = [line for line in said.splitlines() if ": error:" in line]
    assert {int(line.split(":")[1]): line.rpartition("[")[2].rstrip("]") for line in errors} == expected(0), said


@pytest.mark.slow
def test_pyright_sees_options_and_results(tmp_path: Path) -> None:
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(CONFIG))
    said = said_by(["pyright", "--outputjson", "--pythonpath", sys.executable], tmp_path)
    errors = {each["range"]["start"]["line"] + 1: each["rule"] for each in json.loads(said)["generalDiagnostics"]}
    assert errors == expected(1), said


def test_every_question_is_used_here() -> None:
    assert registered().keys() <= GOOD.keys()


def test_tables_have_the_keys_of_the_case_file() -> None:
    """Those that may have a material of their own have it, too."""
    named = {"bands": tables.BandPath, "tolerance": tables.Scatter, "touch": tables.Finger}
    for name, schema in TABLES.items():
        kind = named.get(name, getattr(tables, name.title(), None))
        if kind:
            own = {"material"} if name in MATERIAL_OWNERS else set()
            assert kind.__annotations__.keys() == schema.model_fields.keys() | own, name
