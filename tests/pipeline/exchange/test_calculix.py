"""CalculiX input files: read back by meshio, and solved by ccx itself."""

from __future__ import annotations

import shutil
import subprocess
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from geometry.elements import FloatArray
from geometry.materials import Material
from pipeline import quantity
from pipeline.case.model import case_from_dict
from pipeline.cli import main
from pipeline.exchange import finite_elements
from pipeline.exchange.finite_elements import Exchange, clamped_faces, exchange
from pipeline.logs import TerminalLog
from solvers.fem.eigen import Modes, modes_in_band
from solvers.fem.solid import SolidModel
from studies.independent import free_block_hz
from tests.helpers.recording_log import RecordingLog
from tests.helpers.scenes import STEEL_PILLARS

AGREEMENT = 1e-3
SPARE = 8  # modes asked for beyond those of the band
# C3D10's faces as CalculiX numbers them (its manual, *DLOAD), corners from 1
CCX_FACES = {"S1": (1, 2, 3), "S2": (1, 4, 2), "S3": (2, 4, 3), "S4": (3, 4, 1)}
CCX = shutil.which("ccx")
needs_ccx = pytest.mark.skipif(CCX is None, reason="CalculiX is not installed: apt-get install calculix-ccx")


def part(name: str, band_khz: list[float], accuracy: float, **pillar: Any) -> Exchange:
    raw = STEEL_PILLARS | {
        "solve": {"band_kHz": band_khz, "accuracy": accuracy},
        "pillar": pillar or STEEL_PILLARS["pillar"],
    }
    return exchange(case_from_dict(raw), name, TerminalLog(True), tetrahedra=True)


@cache
def plate() -> Exchange:
    return part("plate", [5.0, 40.0], 0.1)


def ours(result: Exchange) -> Modes:
    materials = {region: result.materials[region.upper()] for region in result.mesh.region_of_cells()}
    model = SolidModel(result.mesh, materials, clamped_faces(result.part, result.mesh), False)
    assert result.search.band_hz
    return modes_in_band(model.pencil(None), *result.search.band_hz)


def theirs(result: Exchange, count: int, folder: Path) -> FloatArray:
    """Frequencies that ccx prints, Hz."""
    assert CCX
    (folder / "part.inp").write_text(finite_elements.input_deck(result, count))
    subprocess.run([CCX, "part"], cwd=folder, check=True, capture_output=True, timeout=600)
    table = (folder / "part.dat").read_text().split("P A R T I C I P A T I O N")[0]
    rows = [line.split() for line in table.splitlines()]
    return np.array([float(row[3]) for row in rows if len(row) == 5 and row[0].isdigit()])


@pytest.mark.slow
def test_an_independent_reader_finds_nodes_elements_and_sets(tmp_path: Path) -> None:
    result = plate()
    (tmp_path / "part.inp").write_text(finite_elements.input_deck(result, 10))
    read = meshio.read(tmp_path / "part.inp")
    assert np.allclose(read.points, result.mesh.nodes, rtol=1e-12, atol=1e-15)
    assert {block.type for block in read.cells} == {"tetra10"}
    written = np.vstack([result.mesh.cells[cells] for cells in result.volumes.values()])
    assert np.array_equal(np.vstack([block.data for block in read.cells]), written)
    assert [len(block.data) for block in read.cells] == [len(cells) for cells in result.volumes.values()]
    for name in result.faces:
        assert np.array_equal(np.sort(read.point_sets[name]), result.nodes_of(name))


@pytest.mark.slow
def test_surfaces_name_the_faces_that_calculix_means() -> None:
    result = plate()
    text = finite_elements.input_deck(result, 10)
    lines = text.split("*SURFACE, NAME=S_BACK, TYPE=ELEMENT\n")[1].split("*")[0].splitlines()
    assert len(lines) == len(result.faces["BACK"])
    for line in lines:
        element, face = (word.strip() for word in line.split(","))
        corners = result.mesh.cells[int(element) - 1, np.array(CCX_FACES[face]) - 1]
        assert np.allclose(result.mesh.nodes[corners, 2], 2e-3)


@pytest.mark.slow
def test_each_volume_has_its_density_and_only_clamped_parts_a_boundary() -> None:
    whole = finite_elements.input_deck(plate(), 10)
    assert whole.count("*SOLID SECTION") == whole.count("*DENSITY") == whole.count("*ELASTIC") == 2
    assert "*DENSITY\n7850\n*SOLID SECTION, ELSET=PILLAR" in whole and "*BOUNDARY" not in whole
    pillar = finite_elements.input_deck(part("pillar", [5.0, 40.0], 0.03), 10)
    assert "*BOUNDARY\nCLAMP, 1, 3\n" in pillar
    assert "*FREQUENCY\n10, 5000, 40000\n" in pillar
    longest = max(len(word.strip()) for line in pillar.splitlines() for word in line.split(",") if line[0].isdigit())
    assert longest <= 20  # CalculiX cuts a number after 20 characters


def test_an_anisotropic_material_has_21_constants_in_calculixs_order() -> None:
    """1111, 1122, 2222, 1133, 2233, 3333, 1112, 2212, 3312, 1212, 1113, 2213, 3313, 1213, 1313, 1123, ... 2323."""
    c = np.diag([10.0, 20.0, 30.0, 40.0, 50.0, 60.0])
    place = {"11": 0, "22": 1, "33": 2, "23": 3, "13": 4, "12": 5}
    for number, (i, j) in enumerate(combinations(range(6), 2), start=1):
        c[i, j] = c[j, i] = 0.1 * number
    law = Material.anisotropic("any", 1e9 * c, 1000.0, "")
    pairs = ["11", "22", "33", "12", "13", "23"]
    expected = [1e9 * c[place[a], place[b]] for n, b in enumerate(pairs) for a in pairs[: n + 1]]
    lines = finite_elements._constants(law)
    assert [len(line.split(", ")) for line in lines] == [8, 8, 5]
    assert [float(word) for line in lines for word in line.split(", ")] == pytest.approx(expected, rel=1e-11)


def test_the_command_writes_one_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = tmp_path / "bar.toml"
    case.write_text(
        'name = "bar"\nmaterial = "aluminium"\n[plate]\nthickness_mm = 2.0\n[pillar]\nshape = "square"\n'
        "side_mm = 2.0\nheight_mm = 6.0\n[solve]\nband_kHz = [10.0, 100.0]\naccuracy = 0.03\n"
    )
    assert main.main(["export", "calculix", str(case), "--part", "pillar", "-o", str(tmp_path / "bar")]) == 0
    assert "tetrahedra of 10 nodes" in capsys.readouterr().err
    assert (tmp_path / "bar.inp").read_text().startswith("*HEADING")


@pytest.mark.slow
def test_the_stated_error_holds_the_frequencies_of_the_mesh_written() -> None:
    """Of a free block, whose exact frequencies Legendre-Ritz has; the file and the terminal name it."""
    raw = {
        "name": "block",
        "material": "aluminium",
        "plate": {"thickness_mm": 10.0},
        "zone": {"length_mm": 12.0, "width_mm": 11.0, "nodal_lines": 1},
        "solve": {"accuracy": 0.01, "near_kHz": 150.0},
    }
    case, log = case_from_dict(raw), RecordingLog()
    written = exchange(case, "plate", log, tetrahedra=True)
    design = case.design
    size_m = (design.length_m, design.width_m, design.thickness_m)
    exact = np.sort(np.concatenate(list(free_block_hz(design.material, size_m, 250e3, (9, 9, 9)).values())))
    model = SolidModel(written.mesh, {"plate": design.material, "body": design.material}, (), False)
    found = modes_in_band(model.pencil(None), 1e3, 175e3).frequency_hz
    high = found / exact[: len(found)] - 1.0
    assert written.error and high.min() > 0.0 and high.max() < written.error < 10.0 * high.max()
    low, high_hz = written.estimated_hz
    assert 0.0 < low < high_hz and quantity.interval(low, high_hz) in written.error_text
    assert f"up to {quantity.percent(written.error)} too high" in finite_elements.input_deck(written, 1)
    assert ("MESH" in log.warnings) == (written.error > case.solve.accuracy)


@needs_ccx
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "band_khz", "accuracy"),
    [("pillar", [10.0, 220.0], 0.003), ("zone", [20.0, 110.0], 0.01), ("plate", [5.0, 60.0], 0.01)],
)
def test_ccx_finds_our_frequencies_on_the_same_mesh(
    name: str, band_khz: list[float], accuracy: float, tmp_path: Path
) -> None:
    """CalculiX integrates the mass of C3D10 with four points, exact only to degree 2: its difference falls with the mesh."""
    result = part(name, band_khz, accuracy)
    mine = ours(result)
    assert len(mine.frequency_hz) >= 3
    below = len(mine.frequency_hz) + mine.rigid_count + SPARE
    other = theirs(result, below, tmp_path)
    assert other[: len(mine.frequency_hz)] == pytest.approx(mine.frequency_hz, rel=AGREEMENT)
    assert len(other) == len(mine.frequency_hz)


@needs_ccx
@pytest.mark.slow
def test_ccx_reads_a_pillar_meshed_through_cad(tmp_path: Path) -> None:
    result = part("pillar", [10.0, 200.0], 0.01, shape="round", diameter_mm=2.0, height_mm=6.0)
    mine = ours(result)
    other = theirs(result, len(mine.frequency_hz) + SPARE, tmp_path)
    assert other == pytest.approx(mine.frequency_hz, rel=AGREEMENT)
