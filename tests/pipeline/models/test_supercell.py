"""Supercells: folded bands, a missing pillar against an independent finite-element cell, and what [[defect]] may say."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from geometry.hex.boxes import Boxes, hex_mesh
from geometry.lattice import Lattice
from geometry.materials import MATERIALS
from geometry.mesh import Mesh
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models.supercell import in_one_cell, supercell
from pipeline.models.unit_cell import lattice_model
from pipeline.planning.model_choice import cell_model_choice
from pipeline.questions.attenuation import Attenuation
from pipeline.questions.bands import Bands, BandsResult, MeshBands, SupercellBands
from pipeline.questions.question import Run, ask
from tests.helpers.asked import bands_of
from tests.helpers.other_program import other_bands

LOG = TerminalLog(True)
RAW: dict[str, Any] = {
    "name": "super",
    "material": "aluminium",
    "plate": {"thickness_mm": 1.0},
    "pillar": {"side_mm": 2.0, "height_mm": 4.0},
    "array": {"pitch_mm": 4.0, "rows": 1},
    "bands": {"points": 2, "count": 8},
    "solve": {"accuracy": 0.02},
}
SAME = 1e-6  # of a frequency: what the waves beyond those that the discarded modes couple change
STILL_HZ = 1.0


def case(**own: Any) -> Case:
    return case_from_dict(RAW | own)


def bands(scene: Case, size: str) -> BandsResult:
    return ask(scene, SupercellBands(supercell=size), Run(LOG))


def by_place(result: BandsResult) -> dict[tuple[int, int], Any]:
    return {tuple(np.rint([point.kx_per_m, point.ky_per_m]).astype(int)): point for point in result.points}


@pytest.mark.slow
@pytest.mark.parametrize("size", ["2x1", "1x2", "2x2"])
def test_bands_of_a_supercell_are_those_of_its_cell_folded(size: str) -> None:
    cells = np.array([int(each) for each in size.split("x")])
    own, turn = bands_of(case(bands={"points": 2, "count": 8, "path": "GXMYG"}), LOG), 2.0 * np.pi / 4e-3
    folded, found = by_place(own), by_place(bands(case(), size))
    zone = np.array([(i, j) for i in range(cells[0]) for j in range(cells[1])]) * turn / cells
    compared = 0
    for point in found.values():
        k = np.array([point.kx_per_m, point.ky_per_m])
        images = [np.abs((k + step + turn / 2.0) % turn - turn / 2.0) for step in zone]
        parts = [folded.get(tuple(np.rint(each).astype(int))) for each in images]
        if None not in parts:
            expected = sorted(hz for part in parts for hz in part.frequencies_hz)
            known = sum(hz < min(part.frequencies_hz[-1] for part in parts) for hz in expected)
            known = min(known, len(point.frequencies_hz))
            assert point.frequencies_hz[:known] == pytest.approx(expected[:known], rel=SAME, abs=STILL_HZ)
            compared += known
    assert compared >= (16 if size == "2x2" else 32)  # at ky or kx of the supercell's border, too


LATTICES: dict[str, dict[str, Any]] = {
    "triangular": {"pitch_mm": 5.0, "lattice": "triangular", "rows": 1},
    "oblique": {"a1_mm": [5.0, 0.0], "a2_mm": [1.2, 4.0], "rows": 1},
}
QUICK: dict[str, Any] = {"bands": {"points": 1, "count": 6}, "solve": {"accuracy": 0.05}}


@pytest.mark.parametrize("kind", LATTICES)
def test_the_cell_that_is_repeated_is_one_of_the_lattice(kind: str) -> None:
    design, own = (each.design for each in (case(array=LATTICES[kind]), in_one_cell(case(array=LATTICES[kind]))))
    assert own.oblique_m == (design.lattice.a1_m, design.lattice.a2_m) and not own.stagger
    assert in_one_cell(case()).design == case().design  # rows in line have a rectangle


@pytest.mark.slow
@pytest.mark.parametrize("size", [(2, 1), (1, 2)])
@pytest.mark.parametrize("kind", LATTICES)
def test_a_supercell_of_any_lattice_has_the_folded_bands(kind: str, size: tuple[int, int]) -> None:
    """At general wavevectors, with a spring-mass resonator next to each pillar; more waves are solved than compared."""
    hung = {"attached": [{"at_mm": [1.7, 0.3], "mass_g": 0.02, "stiffness_N_per_m": 2e6}]}
    scene = in_one_cell(case(array=LATTICES[kind], cell=hung, **QUICK))
    choice = cell_model_choice(scene)
    one = lattice_model(scene, choice, scene.path(1).corners, LOG, []).lattice
    joined, half = supercell(scene, choice, size, LOG), scene.design.lattice.reciprocal_per_m[size.index(2)] / 2.0
    for k in (np.array([130.0, 310.0]), np.array([-420.0, 95.0])):
        folded = np.sort(np.concatenate([one.frequencies(each, 12) for each in (k, k + half)]))[:8]
        assert joined.frequencies(k, 24)[:8] == pytest.approx(folded, rel=SAME)


@pytest.mark.slow
def test_shifted_rows_are_one_lattice_to_supercell_and_bands() -> None:
    """Two panels half a pitch wide against one parallelogram, at K, where rows in line have other waves."""
    scene = case(array=LATTICES["triangular"], **QUICK | {"bands": {"points": 1, "count": 4, "path": "MK"}})
    panels, cell = bands_of(scene, LOG), bands(scene, "1x1")
    assert cell.labels == panels.labels == ("M", "K") and cell.dof < 0.6 * panels.dof
    for one, two in zip(cell.points, panels.points, strict=True):
        for hz, bar, other, its in zip(one.frequencies_hz, one.error, two.frequencies_hz, two.error, strict=True):
            assert bar is not None and its is not None and bar < 0.05 and abs(hz / other - 1.0) <= bar + its


def three(finer: int) -> Mesh:
    """Three cells in a row with pillars on the outer two."""
    x, y = (4e-3 * np.linspace(0.0, n, 4 * n * finer + 1) for n in (3, 1))
    z = 1e-3 * np.linspace(0.0, 5.0, 5 * finer + 1)
    mx, my, mz = np.meshgrid(*((line[:-1] + line[1:]) / 2.0 for line in (x, y, z)), indexing="ij")
    foot = (np.abs(mx % 4e-3 - 2e-3) < 1e-3) & (np.abs(my - 2e-3) < 1e-3) & (np.abs(mx - 6e-3) > 2e-3)
    return hex_mesh(Boxes(x, y, z, np.where((mz < 1e-3) | foot, 0, -1), ("plate",)), 2)


@pytest.mark.slow
def test_a_missing_pillar_against_an_independent_finite_element_cell() -> None:
    """Both of its meshes lie above the exact frequencies, by at most their difference; general wavevectors."""
    scene = case(defect=[{"at": [1, 0], "remove": True}], bands={"points": 2, "count": 8, "path": "GM"})
    found, lattice = bands(scene, "3x1"), Lattice((12e-3, 0.0), (0.0, 4e-3))
    for point in found.points[1:]:
        k = np.array([point.kx_per_m, point.ky_per_m])
        coarse, fine = (other_bands(three(finer), lattice, k, 8, {"plate": MATERIALS["aluminium"]}) for finer in (1, 2))
        for hz, bar, one, two in zip(point.frequencies_hz, point.error, coarse, fine, strict=True):
            assert bar is not None and two - (one - two) - bar * hz <= hz <= two + bar * hz


@pytest.mark.slow
def test_a_missing_pillar_moves_the_folded_bands() -> None:
    scene = case(bands={"points": 1, "count": 6, "path": "GM"})
    whole, lacking = bands(scene, "2x1"), bands(scene.but({"defect": [{"at": [1, 0], "remove": True}]}), "2x1")
    again = bands(scene.but({"defect": [{"at": [0, 0], "remove": True}]}), "2x1")
    same = bands(scene.but({"defect": [{"at": [0, 0], "height_mm": 4.0}]}), "2x1")
    assert np.abs(lacking.frequencies_hz[1] / whole.frequencies_hz[1] - 1.0).max() > 0.01
    assert again.frequencies_hz[1] == pytest.approx(lacking.frequencies_hz[1], rel=1e-9)
    assert same.frequencies_hz[1] == pytest.approx(whole.frequencies_hz[1], rel=1e-9)


@pytest.mark.parametrize(
    ("defect", "words"),
    [
        (
            [{"at": [3, 0], "remove": True}],
            r"defect.0.at = \[3, 0\]: must be a cell of the supercell 3x1, from \[0, 0\] to",
        ),
        ([{"at": [1, 0]}], "defect.0: missing, must have remove = true or keys of"),
        ([{"at": [1, 0], "remove": True, "height_mm": 3.0}], "must have remove = true alone"),
        ([{"remove": True}], "defect.0.at: missing"),
        (
            [{"at": [1, 0], "hieght_mm": 3.0}],
            r"defect.0.hieght_mm = 3: unknown key \(did you mean defect.0.height_mm\?\)",
        ),
        ([{"at": [1, 0], "side_mm": 5.0}], "pillars overlap"),
        ([{"at": [1, 0], "height_mm": 1e9}], "defect.0.height_mm = 1000000000: must be"),
        ([{"at": [1, 0], "remove": True}] * 2, "defect.1.at = .*: is the cell of defect.0, too"),
        ({"at": [1, 0]}, "must be one to 100 tables"),
    ],
)
def test_faults_of_a_defect_are_named(defect: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        bands(case(defect=defect), "3x1")


def test_other_commands_refuse_what_they_cannot_honour() -> None:
    scene = case(defect=[{"at": [1, 0], "remove": True}])
    for question in (Bands(), Attenuation(), MeshBands(mesh_file=("cell.msh",))):
        with pytest.raises(InputError, match=r"\[\[defect\]\]: .* cannot honour it: it is for cells of a supercell"):
            ask(scene, question, Run(LOG))
    for size in ("3", "0x1", "3x", "x"):
        with pytest.raises(InputError, match="must be two numbers of cells from 1 to 99, such as 3x1"):
            bands(case(), size)
