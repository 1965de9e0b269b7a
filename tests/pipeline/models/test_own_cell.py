"""Unit cells of a user's mesh: paired sides, materials of groups, and bands against an independent finite-element cell."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from geometry.errors import MeshError
from geometry.formats.neutral import VOLUME, local_nodes
from geometry.hex.boxes import Boxes, cell_boxes, hex_mesh
from geometry.hex.scenes import HexSettings
from geometry.lattice import Lattice
from geometry.materials import MATERIALS
from geometry.mesh import Mesh, split_hexahedra
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models import own_cell
from pipeline.questions.bands import BandsResult, MeshBands
from pipeline.questions.modes import MeshModes, Modes
from pipeline.questions.question import Run, ask
from solvers.waves.bloch import periodic_nodes
from tests.helpers.asked import bands_of
from tests.helpers.other_program import other_bands

LOG = TerminalLog(True)
SIDE_M, THICK_M = 4e-3, 1e-3
STILL_HZ = 1.0  # rounding of a rigid translation at G


def case(**own: Any) -> Case:
    array = {"pitch_mm": 1e3 * SIDE_M}
    return case_from_dict(
        {"name": "own", "material": "aluminium", "array": array, "bands": {"points": 1, "count": 6}} | own
    )


def grid(columns: int, rows: int, kind: str, finer: int = 1) -> Mesh:
    """Cells of 4 x 4 x 1 mm side by side: whole, with a square hole, or with two unequal pillars of steel."""
    lines = [SIDE_M * np.linspace(0.0, n, 4 * n * finer + 1) for n in (columns, rows)]
    levels = THICK_M * np.linspace(
        0.0, 3.0 if kind == "two pillars" else 1.0, (3 if kind == "two pillars" else 1) * finer + 1
    )
    x, y, z = np.meshgrid(*((line[:-1] + line[1:]) / 2.0 for line in (*lines, levels)), indexing="ij")
    x, y = 1e3 * x % 4.0, 1e3 * y % 4.0
    region = np.where(z < THICK_M, 0, -1)
    if kind == "hole":
        region[(x > 1.0) & (x < 3.0) & (y > 1.0) & (y < 2.0)] = -1
    if kind == "two pillars":
        region[(z > THICK_M) & (x < 1.0) & (y > 1.0) & (y < 3.0)] = 1
        region[(z > THICK_M) & (z < 2.0 * THICK_M) & (x > 2.0) & (y < 1.0)] = 1
    return hex_mesh(Boxes(*lines, levels, region, ("plate", "steel")), 2)


def written(mesh: Mesh, place: Path) -> str:
    """A Gmsh file of the mesh in m, its regions as physical groups."""
    blocks = [(VOLUME[mesh.kind, mesh.order], mesh.cells[cells][:, local_nodes(mesh.kind, mesh.order)])
              for cells in mesh.regions.values()]  # fmt: skip
    numbers = [np.full(len(block), number) for number, (_, block) in enumerate(blocks, start=1)]
    names = {name.upper(): np.array([number, 3]) for number, name in enumerate(mesh.regions, start=1)}
    data = {"gmsh:physical": numbers, "gmsh:geometrical": numbers}
    meshio.write(place, meshio.Mesh(mesh.nodes, blocks, cell_data=data, field_data=names), file_format="gmsh22")
    return str(place)


def bands(scene: Case, *files: str) -> BandsResult:
    return ask(scene, MeshBands(mesh_file=files), Run(LOG))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["hole", "two pillars"])
def test_own_cells_have_the_bands_of_an_independent_finite_element_cell(kind: str, tmp_path: Path) -> None:
    """Both complete quadratic hexahedra on one mesh: equal up to rounding, at G, X, M and along their sides."""
    mesh = grid(1, 1, kind)
    more = {"materials": {"STEEL": "steel"}} if kind == "two pillars" else {}
    found = bands(case(**more, bands={"points": 2, "count": 6}), written(mesh, tmp_path / "cell.msh"))
    lattice, own = Lattice.of_rows(SIDE_M, SIDE_M), {"plate": MATERIALS["aluminium"], "steel": MATERIALS["steel"]}
    for point in found.points[1:4]:
        k = np.array([point.kx_per_m, point.ky_per_m])
        assert point.frequencies_hz == pytest.approx(other_bands(mesh, lattice, k, 6, own), rel=1e-6)
    assert found.points[1].error == [None] * 6 and found.expected_error is None


@pytest.mark.slow
def test_a_reduced_cell_has_the_bands_of_the_whole_one_and_gives_way_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, scene = written(grid(1, 1, "hole"), tmp_path / "cell.msh"), case(bands={"points": 3, "count": 4, "grid": 2})
    whole = bands(scene, file)
    monkeypatch.setattr(own_cell, "MIN_DOF", 0)
    reduced = bands(scene, file)
    assert "reduced" in reduced.model and "reduced" not in whole.model and reduced.dof < whole.dof
    assert reduced.frequencies_hz == pytest.approx(whole.frequencies_hz, rel=1e-6, abs=STILL_HZ)
    monkeypatch.setattr(own_cell, "TRUNCATED", 0.0)
    again = bands(scene, file)
    assert again.model == whole.model and (again.frequencies_hz == whole.frequencies_hz).all()


@pytest.mark.parametrize("kind", ["hole", "two pillars"])
def test_a_supercell_of_two_has_the_folded_bands_of_its_cell(kind: str, tmp_path: Path) -> None:
    more = {"materials": {"STEEL": "steel"}} if kind == "two pillars" else {}
    double = {"pitch_x_mm": 8.0, "pitch_y_mm": 4.0}
    one = bands(case(**more), written(grid(1, 1, kind), tmp_path / "one.msh"))
    two = bands(
        case(**more, array=double, bands={"points": 1, "count": 12, "path": "GM"}),
        written(grid(2, 1, kind), tmp_path / "two.msh"),
    )
    own = {point.label: point.frequencies_hz for point in one.points}
    folded = [sorted(own["G"] + own["X"]), two.points[0].frequencies_hz]
    count = sum(hz < min(own["G"][-1], own["X"][-1]) for hz in folded[0])
    assert count >= 6
    assert folded[1][:count] == pytest.approx(folded[0][:count], rel=1e-6, abs=STILL_HZ)


@pytest.mark.slow
def test_the_reference_cell_read_back_lies_inside_both_bars(tmp_path: Path) -> None:
    raw: dict[str, Any] = {"plate": {"thickness_mm": 1.0}, "pillar": {"side_mm": 1.6, "height_mm": 3.0}}
    raw |= {"solve": {"accuracy": 0.01}, "array": {"pitch_mm": 4.0, "rows": 1}}
    scene = case(**raw)
    files = []
    for size in (1e-3, 0.5e-3):
        mesh = hex_mesh(cell_boxes(scene.design, HexSettings(2, size, 0)), 2)
        files.append(written(mesh, tmp_path / f"cell{len(files)}.msh"))
    theirs, ours = bands(scene, *files), bands_of(scene, LOG)
    for one, two in zip(theirs.points, ours.points, strict=True):
        for hz, bar, own, own_bar in zip(one.frequencies_hz, one.error, two.frequencies_hz, two.error, strict=True):
            assert bar is not None and own_bar is not None
            assert own < STILL_HZ or abs(hz / own - 1.0) <= bar + own_bar
            assert bar < 0.1
    assert theirs.points[1].computed_hz[0] > theirs.points[1].frequencies_hz[0]


def test_tetrahedra_and_their_own_split_of_the_sides_pair(tmp_path: Path) -> None:
    """Hexahedra cut alike have matching diagonals; a mirrored half of them has not."""
    mesh = split_hexahedra(grid(1, 1, "hole"))
    lattice = Lattice.of_rows(SIDE_M, SIDE_M)
    pairs = periodic_nodes(mesh, lattice)
    image = mesh.nodes[pairs.master] + np.column_stack([pairs.offset @ lattice.vectors_m, np.zeros(len(mesh.nodes))])
    assert np.allclose(image, mesh.nodes, atol=1e-9) and (pairs.offset.max(axis=0) == 1).all()
    nodes = mesh.nodes.copy()
    right = nodes[:, 0] > 0.75 * SIDE_M - 1e-9
    flipped = replace(mesh, nodes=nodes * [1.0, 1.0, 1.0])
    assert len(periodic_nodes(flipped, lattice).master) == len(nodes) and right.any()


def test_sides_that_do_not_pair_are_refused_by_name(tmp_path: Path) -> None:
    mesh = grid(1, 1, "plate")
    nodes = mesh.nodes.copy()
    moved = np.flatnonzero((np.abs(nodes[:, 0] - SIDE_M) < 1e-9) & (np.abs(nodes[:, 1] - SIDE_M / 2.0) < 1e-9))
    nodes[moved, 1] += 2e-5
    lattice = Lattice.of_rows(SIDE_M, SIDE_M)
    words = rf"side x\+: {len(moved)} of its \d+ nodes have no partner one pitch away, the worst 0.02 mm from one"
    with pytest.raises(MeshError, match=words):
        periodic_nodes(replace(mesh, nodes=nodes, spans=None), lattice)
    file = written(mesh, tmp_path / "cell.msh")
    with pytest.raises(InputError, match=r"cell.msh: sides .* side y\+: .*the mesh is 4 x 4 mm, .* \(0, 5\) mm"):
        bands(case(array={"pitch_x_mm": 4.0, "pitch_y_mm": 5.0}), file)
    with pytest.raises(InputError, match=r"side x\+: \d+ of its 27 nodes have no partner"):
        bands(case(), written(grid(2, 1, "plate"), tmp_path / "two.msh"))


def test_a_cell_of_an_oblique_outline_pairs_along_the_lattice(tmp_path: Path) -> None:
    """The parallelogram of a staggered lattice has the bands of the rectangle whose top is shifted by half a pitch."""
    scene = case(array={"pitch_x_mm": 4.0, "pitch_y_mm": 4.0, "stagger": True})
    bricks = grid(1, 1, "plate")
    sheared = replace(bricks, nodes=bricks.nodes + np.outer(bricks.nodes[:, 1], [0.5, 0.0, 0.0]), spans=None)
    one, two = (bands(scene, written(mesh, tmp_path / f"{n}.msh")) for n, mesh in enumerate((bricks, sheared)))
    assert two.frequencies_hz[1:] == pytest.approx(one.frequencies_hz[1:], rel=2e-2, abs=STILL_HZ)


def test_materials_of_groups_are_refused_by_name(tmp_path: Path) -> None:
    file = written(grid(1, 1, "two pillars"), tmp_path / "cell.msh")
    with pytest.raises(InputError, match=r"\[materials\] STEAL: no such group of elements \(did you mean STEEL\?\)"):
        bands(case(materials={"STEAL": "steel"}), file)
    with pytest.raises(InputError, match=r"materials.STEEL = .unobtainium.: must be one of"):
        case(materials={"STEEL": "unobtainium"})
    with pytest.raises(InputError, match=r"\[materials\]: modes cannot honour it"):
        ask(case(materials={"STEEL": "steel"}), Modes(), Run(LOG))
    layers = {"layer": [{"material": name, "thickness_mm": 0.5} for name in ("steel", "aluminium")]}
    with pytest.raises(InputError, match=r"group of all other elements: which of the plate's layers"):
        bands(case(materials={"STEEL": "steel"}, plate=layers), file)


def test_a_group_of_steel_makes_the_modes_of_a_mesh_heavier(tmp_path: Path) -> None:
    file = written(grid(1, 1, "two pillars"), tmp_path / "cell.msh")
    query = MeshModes(mesh_file=file, count=1)
    light, heavy, all_steel = (
        ask(each, query, Run(LOG)).frequency_hz[0]
        for each in (case(), case(materials={"steel": "steel"}), case(material="steel"))
    )
    assert heavy < 0.98 * light and all_steel == pytest.approx(
        ask(case(materials={"STEEL": "steel", "PLATE": "steel"}), query, Run(LOG)).frequency_hz[0], rel=1e-9
    )


@pytest.mark.slow
def test_meshes_that_cannot_be_compared_say_so(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    one, thin = (written(grid(1, 1, "plate", finer), tmp_path / f"{finer}.msh") for finer in (1, 2))
    hole = written(grid(1, 1, "hole"), tmp_path / "hole.msh")
    with pytest.raises(InputError, match=r"volumes differ by .*: must be one cell"):
        bands(case(), one, hole)
    run = Run(LOG)
    ask(case(), MeshBands(mesh_file=(one, one)), run)
    assert any(line.startswith("NO_ERROR_BAR") for line in run.warnings)
    assert bands(case(), thin, one).points[1].error[0] is not None
