"""A user's own mesh: the same numbers as our own mesh gives, whatever the file; every fault one clear line."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import h5py
import meshio
import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from geometry.errors import MeshFileError
from geometry.formats.med import write_med
from geometry.formats.neutral import FACET, VOLUME, RawMesh, local_nodes
from geometry.hex.boxes import hex_mesh, pillar_boxes
from geometry.hex.scenes import HexSettings
from geometry.mesh import Mesh, split_hexahedra
from pipeline.case.model import Case, case_from_dict, load_case
from pipeline.cli import main
from pipeline.exchange import finite_elements
from pipeline.exchange.finite_elements import exchange
from pipeline.logs import TerminalLog
from solvers.fem.eigen import modes_near
from solvers.fem.solid import SolidModel, constrain
from solvers.measures.confinement import measure
from tests.helpers.mesh_files import facet_nodes, load

ENDS = {"vtu": "vtu", "paraview": "vtkhdf"}
SCENE: dict[str, Any] = {
    "name": "small",
    "material": "aluminium",
    "plate": {"thickness_mm": 2.0},
    "zone": {"length_mm": 20.0, "width_mm": 10.0, "nodal_lines": 3},
    "pillar": {"shape": "square", "side_mm": 2.0, "height_mm": 6.0},
    "array": {"pitch_mm": 5.0, "rows": 1, "extension_mm": 4.0},
    "solve": {"accuracy": 0.03, "band_kHz": [5.0, 60.0]},
}
TOML = """name = "own"
material = "aluminium"
[plate]
thickness_mm = 2.0
[zone]
length_mm = 20.0
width_mm = 10.0
nodal_lines = 3
[pillar]
shape = "square"
side_mm = 2.0
height_mm = 6.0
[array]
pitch_mm = 5.0
rows = 1
extension_mm = 4.0
"""
SAME = 1e-9  # two assemblies of one mesh differ by the order of sums only


@pytest.fixture
def case_file(tmp_path: Path) -> str:
    (tmp_path / "own.toml").write_text(TOML)
    return str(tmp_path / "own.toml")


def scene() -> Case:
    return case_from_dict(SCENE)


def bar(order: int = 2, kind: str = "hex") -> Mesh:
    """The lone pillar; split into tetrahedra, of order 1 by leaving the middles out."""
    pillar = scene().design.pillar
    assert pillar
    mesh = hex_mesh(pillar_boxes(pillar, HexSettings(2 if kind == "tet" else order, 1.5e-3, 1, 0.4), quarter=False), 2)
    if kind == "hex":
        return mesh if order == 2 else hex_mesh(pillar_boxes(pillar, HexSettings(1, 1e-3, 0), quarter=False), 1)
    cut = split_hexahedra(mesh)
    if order == 2:
        return cut
    used, cells = np.unique(cut.cells[:, :4], return_inverse=True)
    number = np.full(len(cut.nodes), -1)
    number[used] = np.arange(len(used))
    faces = {name: number[face[:, :3]] for name, face in cut.faces.items()}
    return Mesh(cut.nodes[used], cells.reshape(-1, 4), "tet", 1, cut.regions, faces)


def frequencies(mesh: Mesh, clamped: tuple[str, ...], count: int = 5) -> np.ndarray:
    material = scene().design.material
    model = SolidModel(mesh, dict.fromkeys(mesh.region_of_cells(), material), clamped, False)
    return modes_near(model.pencil(None), 0.0, count).frequency_hz


def modes_document(arguments: list[str], folder: Path) -> dict[str, Any]:
    outputs = ["--json", str(folder / "modes.json"), "--plot", str(folder / "modes.png")]  # drawn bodies included
    assert main.main(["modes", *arguments, "--quiet", *outputs]) == 0 and (folder / "modes.png").exists()
    return dict(json.loads((folder / "modes.json").read_text()))


def as_meshio(mesh: Mesh, scale: float = 1.0) -> meshio.Mesh:
    """The mesh with its clamped face as a physical group, in another unit."""
    key = (mesh.kind, mesh.order)
    cells = [
        (VOLUME[key], mesh.cells[:, local_nodes(*key)]),
        (FACET[key], mesh.faces["touch"][:, facet_nodes(*key)]),
    ]
    numbers = [np.full(len(block), i + 1) for i, (_, block) in enumerate(cells)]
    names = {"PILLAR": np.array([1, 3]), "FIXED": np.array([2, 2])}
    data = {"gmsh:physical": numbers, "gmsh:geometrical": numbers}
    return meshio.Mesh(scale * mesh.nodes, cells, cell_data=data, field_data=names)


@pytest.mark.parametrize(("kind", "order"), [("tet", 1), ("tet", 2), ("hex", 1), ("hex", 2)])
def test_gmsh_files_in_millimetres_give_the_frequencies_of_our_mesh(
    kind: str, order: int, case_file: str, tmp_path: Path
) -> None:
    mesh = bar(order, kind)
    meshio.write(tmp_path / "bar.msh", as_meshio(mesh, 1e3), file_format="gmsh22")
    query = [case_file, "--mesh-file", str(tmp_path / "bar.msh"), "--unit", "mm", "--clamp", "FIXED", "--count", "5"]
    document = modes_document(query, tmp_path)
    assert document["part"] == "mesh" and document["model"] == f"solid {kind}{order}"
    assert document["rigid_count"] == 0
    assert document["count_check"]["expected"] == document["count_check"]["found"]
    computed = [mode["frequency_hz"] for mode in document["modes"]][:5]
    assert computed == pytest.approx(frequencies(mesh, ("touch",))[:5], rel=SAME)


@pytest.mark.parametrize(
    ("scale", "unit", "said"),
    [
        (1e3, "m", "6000 mm long in m, the case's lengths range from 2 to 20 mm: with --unit mm it"),
        (1.0, "mm", "0.006 mm long in mm, the case's lengths range from 2 to 20 mm: with --unit m it"),
        (1.0, "m", None),
    ],
)
def test_a_unit_that_makes_a_body_a_thousand_times_the_case_s_is_doubted(
    scale: float, unit: str, said: str | None, case_file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    meshio.write(tmp_path / "bar.msh", as_meshio(bar(1), scale), file_format="gmsh22")
    modes_document(
        [case_file, "--mesh-file", str(tmp_path / "bar.msh"), "--unit", unit, "--clamp", "FIXED", "--count", "1"],
        tmp_path,
    )
    lines = [line for line in capsys.readouterr().err.splitlines() if "UNIT" in line]
    assert len(lines) == (said is not None) and (said is None or said in lines[0])


def gmsh41(mesh: Mesh) -> str:
    """Quadratic tetrahedra and their clamped face as gmsh 4.1 writes them: physical names belong to entities."""
    tets, count = mesh.cells[:, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]] + 1, len(mesh.nodes)  # gmsh ends with edges 32, 31
    facets = mesh.faces["touch"] + 1
    low, high = (" ".join(str(x) for x in end) for end in (mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)))
    lines = ["$MeshFormat", "4.1 0 8", "$EndMeshFormat", "$PhysicalNames", "2", '2 7 "FIXED"', '3 9 "BAR"']
    lines += ["$EndPhysicalNames", "$Entities", "0 0 1 1", f"1 {low} {high} 1 7 0", f"1 {low} {high} 1 9 1 1"]
    lines += ["$EndEntities", "$Nodes", f"1 {count} 1 {count}", f"3 1 0 {count}", *(str(n + 1) for n in range(count))]
    lines += [" ".join(repr(float(x)) for x in point) for point in mesh.nodes]
    total = len(facets) + len(tets)
    lines += ["$EndNodes", "$Elements", f"2 {total} 1 {total}", f"2 1 9 {len(facets)}"]
    lines += [" ".join(str(x) for x in (i + 1, *row)) for i, row in enumerate(facets)]
    lines += [f"3 1 11 {len(tets)}"]
    lines += [" ".join(str(x) for x in (len(facets) + i + 1, *row)) for i, row in enumerate(tets)]
    return "\n".join([*lines, "$EndElements", ""])


@pytest.mark.slow
def test_a_file_of_gmsh_4_is_read_with_its_physical_groups(case_file: str, tmp_path: Path) -> None:
    mesh = bar(2, "tet")
    (tmp_path / "bar.msh").write_text(gmsh41(mesh))
    query = [case_file, "--mesh-file", str(tmp_path / "bar.msh"), "--clamp", "FIXED", "--count", "4"]
    computed = [mode["frequency_hz"] for mode in modes_document(query, tmp_path)["modes"]][:4]
    assert computed == pytest.approx(frequencies(mesh, ("touch",), 4)[:4], rel=SAME)


@pytest.mark.parametrize("tetrahedra", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_an_exported_med_file_comes_back_with_the_same_modes_and_measures(
    tetrahedra: bool, case_file: str, tmp_path: Path
) -> None:
    case = scene()
    part = exchange(case, "plate", TerminalLog(True), tetrahedra)
    write_med(finite_elements.raw_mesh(part), tmp_path / "plate.med", "PLATE")
    document = modes_document([case_file, "--mesh-file", str(tmp_path / "plate.med"), "--count", "6"], tmp_path)
    model = SolidModel(part.mesh, dict.fromkeys(part.mesh.regions, case.design.material), (), False)
    direct = modes_near(model.pencil(None), 0.0, 6)
    assert document["rigid_count"] == direct.rigid_count == 6
    assert [m["frequency_hz"] for m in document["modes"]] == pytest.approx(direct.frequency_hz, rel=SAME)
    shares = measure(model.touch(None, direct.vectors), case.design, None).zone_share
    assert [m["zone_share"] for m in document["modes"]] == pytest.approx(shares, rel=1e-6)


def test_a_calculix_file_is_read_with_its_node_sets(case_file: str, tmp_path: Path) -> None:
    part = exchange(scene(), "pillar", TerminalLog(True), tetrahedra=True)
    (tmp_path / "part.inp").write_text(finite_elements.input_deck(part, 5))
    query = [case_file, "--mesh-file", str(tmp_path / "part.inp"), "--clamp", "CLAMP", "--count", "4"]
    computed = [mode["frequency_hz"] for mode in modes_document(query, tmp_path)["modes"]][:4]
    assert computed == pytest.approx(frequencies(part.mesh, ("touch",), 4)[:4], rel=1e-7)  # the file keeps 13 digits


def test_wedges_and_pyramids_of_a_file_are_solved_together(case_file: str, tmp_path: Path) -> None:
    """A roof on a cut cube: two wedges and a pyramid, clamped below; the same body from Python has the same frequencies."""
    nodes = "1,0,0,0\n2,4,0,0\n3,0,4,0\n4,0,0,4\n5,4,0,4\n6,0,4,4\n7,4,4,0\n8,4,4,4\n9,9,2,2\n"
    cells = "*ELEMENT, TYPE=C3D6\n1,1,2,3,4,5,6\n2,2,7,3,5,8,6\n*ELEMENT, TYPE=C3D5\n3,2,7,8,5,9\n"
    (tmp_path / "roof.inp").write_text(f"*NODE\n{nodes}{cells}*NSET, NSET=FOOT\n1,2,3,7\n")
    query = [case_file, "--mesh-file", str(tmp_path / "roof.inp"), "--unit", "mm", "--clamp", "FOOT", "--count", "3"]
    document = modes_document(query, tmp_path)
    assert document["model"] == "solid pyramid+wedge1" and document["rigid_count"] == 0
    model = SolidModel(load(str(tmp_path / "roof.inp"), "mm"), {"plate": scene().design.material}, ("FOOT",), False)
    direct = modes_near(model.pencil(None), 0.0, 3).frequency_hz
    assert [mode["frequency_hz"] for mode in document["modes"]] == pytest.approx(direct, rel=SAME)


def test_pillars_and_plate_of_a_file_have_their_own_materials(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text(TOML.replace("side_mm = 2.0", 'side_mm = 2.0\nmaterial = "steel"'))
    part = exchange(scene(), "plate", TerminalLog(True))
    write_med(finite_elements.raw_mesh(part), tmp_path / "plate.med", "PLATE")
    query = [str(tmp_path / "own.toml"), "--mesh-file", str(tmp_path / "plate.med"), "--count", "2"]
    document = modes_document(query, tmp_path)
    steel = case_from_dict(SCENE | {"pillar": SCENE["pillar"] | {"material": "steel"}}).design.pillar
    assert steel
    model = SolidModel(part.mesh, {"plate": scene().design.material, "pillar": steel.material}, (), False)
    direct = modes_near(model.pencil(None), 0.0, 2).frequency_hz
    assert [m["frequency_hz"] for m in document["modes"]] == pytest.approx(direct, rel=SAME)


@pytest.mark.parametrize("kind", ["tet", "hex"])
def test_elements_turned_inside_out_and_middles_in_any_order_are_put_right(kind: str, tmp_path: Path) -> None:
    mesh = bar(2, kind)
    vtk = mesh.cells[:, local_nodes(kind, 2)]
    corners = 4 if kind == "tet" else 8
    mirrored = [0, 2, 1, 3] if kind == "tet" else [0, 3, 2, 1, 4, 7, 6, 5]
    shuffled = np.random.default_rng(3).permutation(np.arange(corners, vtk.shape[1]))
    wrong = vtk[:, [*range(corners), *shuffled]]
    wrong[::2, :corners] = wrong[::2][:, mirrored]
    write_med(RawMesh(mesh.nodes, [(VOLUME[kind, 2], wrong)]), tmp_path / "wrong.med", "M")
    back = load(str(tmp_path / "wrong.med"))
    assert frequencies(back, (), 6) == pytest.approx(frequencies(mesh, (), 6), rel=1e-8)
    assert back.faces == {}


def test_nodes_that_no_volume_uses_are_dropped(tmp_path: Path) -> None:
    mesh = bar(2, "tet")
    points = np.vstack([[[9.0, 9.0, 9.0]], mesh.nodes])
    meshio.write(tmp_path / "loose.msh", meshio.Mesh(points, [("tetra10", mesh.cells + 1)]), file_format="gmsh")
    assert len(load(str(tmp_path / "loose.msh")).nodes) == len(mesh.nodes)


def _hex20(path: Path) -> None:
    write_med_of(path, "H20", 20)


def _polygon(path: Path) -> None:
    write_med_of(path, "PG2", 5)


def write_med_of(path: Path, code: str, count: int) -> None:
    """A MED file with one cell of a type that we do not write."""
    import h5py

    write_med(RawMesh(np.random.default_rng(0).random((count, 3)), [("tetra", np.array([[0, 1, 2, 3]]))]), path, "M")
    with h5py.File(path, "r+") as file:
        cells = file["ENS_MAA/M"][next(iter(file["ENS_MAA/M"]))]["MAI"]
        group = cells.create_group(code)
        group.create_dataset("NOD", data=np.arange(count) + 1).attrs["NBR"] = 1


def _mixed(path: Path) -> None:
    """A cube with a tetrahedron on half of its face."""
    nodes = np.vstack([[(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], [[0.0, 0.0, 2.0]]])
    blocks = [("hexahedron", np.array([[0, 1, 3, 2, 4, 5, 7, 6]])), ("tetra", np.array([[4, 5, 6, 8]]))]
    write_med(RawMesh(nodes, blocks), path, "M")


def _flat_element(path: Path) -> None:
    write_med(RawMesh(np.vstack([np.eye(3), [[1.0, 1.0, -1.0]]]), [("tetra", np.array([[0, 1, 2, 3]]))]), path, "M")


def _bent(path: Path) -> None:
    mesh = bar(2, "tet")
    nodes = mesh.nodes.copy()
    nodes[mesh.cells[5, 4]] += 5e-3
    write_med(RawMesh(nodes, [("tetra10", mesh.cells)]), path, "M")


def _loose_facet(path: Path) -> None:
    mesh = bar(1, "tet")
    blocks = [("tetra", mesh.cells), ("triangle", np.array([[0, 1, len(mesh.nodes) - 1], [0, 2, len(mesh.nodes) - 1]]))]
    write_med(RawMesh(mesh.nodes, blocks, {"SKIN": {1: np.array([0, 1])}}), path, "M")


def _two_meshes(path: Path) -> None:
    import h5py

    write_med(RawMesh(bar(1, "tet").nodes, [("tetra", bar(1, "tet").cells)]), path, "A")
    with h5py.File(path, "r+") as file:
        file.copy("ENS_MAA/A", file["ENS_MAA"], "B")


def _open_stl(path: Path) -> None:
    box = trimesh.creation.box((2.0, 2.0, 6.0))
    trimesh.Trimesh(box.vertices, box.faces[1:]).export(path)


def _triangles(path: Path) -> None:
    meshio.write(path, meshio.Mesh(np.eye(3), [("triangle", [[0, 1, 2]])]), file_format="gmsh22")


def _med(path: Path, cells: np.ndarray | None = None, points: np.ndarray | None = None) -> None:
    """Two tetrahedra that share a face, one node of them changed."""
    nodes = np.vstack([np.zeros(3), np.eye(3), np.ones(3)]) if points is None else points
    block = np.array([[0, 1, 2, 3], [1, 2, 3, 4]]) if cells is None else cells
    write_med(RawMesh(nodes, [("tetra", block)]), path, "M")


def _renumbered(number: int) -> Any:
    """A file whose third node of its second element has this number, counted from 1 as MED does."""
    return lambda path: _med(path, np.array([[0, 1, 2, 3], [1, 2, number - 1, 4]]))


def _no_step(path: Path) -> None:
    import h5py

    _med(path)
    with h5py.File(path, "r+") as file:
        del file["ENS_MAA/M"][next(iter(file["ENS_MAA/M"]))]


def _wrong_count(path: Path) -> None:
    import h5py

    _med(path)
    with h5py.File(path, "r+") as file:
        step = file["ENS_MAA/M"][next(iter(file["ENS_MAA/M"]))]
        del step["MAI/TE4/FAM"]
        step["MAI/TE4"].create_dataset("FAM", data=np.zeros(7, dtype=np.int64))


def _inp(nodes: str) -> str:
    return f"*NODE\n1,0,0,0\n2,1,0,0\n3,0,1,0\n4,0,0,1\n*ELEMENT, TYPE=C3D4\n1,{nodes}\n"


RANGE_FAULTS: list[tuple[str, Any, list[str]]] = [
    ("zero.med", _renumbered(0), ["tetra", "number 0 in line 2 of it is not a node of the file", "from 1 to 5"]),
    ("negative.med", _renumbered(-2), ["number -2 in line 2 of it is not a node of the file"]),
    ("beyond.med", _renumbered(6), ["number 6 in line 2 of it is not a node of the file", "from 1 to 5"]),
    ("twins.med", lambda p: _med(p, np.array([[0, 1, 2, 3], [3, 1, 2, 0]])), ["1 element(s) given twice"]),
    ("nan.med", lambda p: _med(p, points=np.vstack([np.full(3, np.nan), np.eye(3), np.ones(3)])), ["node 1 at (nan"]),
    ("step.med", _no_step, ["has 0 time steps, must have exactly one"]),
    ("count.med", _wrong_count, ["FAM", "7 values"]),
    ("empty.inp", lambda p: p.write_text(""), ["no volume elements"]),
    ("blank.inp", lambda p: p.write_text("*NODE\n"), ["blank.inp"]),
    ("zero.inp", lambda p: p.write_text(_inp("1,2,3,0")), ["zero.inp"]),
    ("beyond.inp", lambda p: p.write_text(_inp("1,2,3,9")), ["beyond.inp"]),
]


@pytest.mark.parametrize(("name", "make", "said"), RANGE_FAULTS, ids=[name for name, _, _ in RANGE_FAULTS])
def test_every_index_of_a_mesh_is_checked_against_its_range(
    name: str, make: Any, said: list[str], tmp_path: Path
) -> None:
    make(tmp_path / name)
    with pytest.raises(MeshFileError) as fault:
        load(str(tmp_path / name))
    (line,) = str(fault.value).splitlines()
    assert all(word in line for word in [name, *said])


FAULTS: list[tuple[str, Any, list[str]]] = [
    ("none.med", None, ["no such mesh file"]),
    ("part.vtk", lambda p: p.write_text("x"), [".med, .msh, .inp"]),
    ("open.stl", _open_stl, ["open surface", "3 edges", "volume elements"]),
    ("box.stl", lambda p: trimesh.creation.box().export(p), ["closed surface", "volume elements"]),
    ("noise.stl", lambda p: p.write_bytes(b"\x01\x02\x03"), ["noise.stl"]),
    ("noise.med", lambda p: p.write_bytes(b"not hdf5"), ["not a readable MED file"]),
    ("noise.msh", lambda p: p.write_text("$Nothing\n"), ["not a readable mesh"]),
    ("noise.inp", lambda p: p.write_text("*NODE\n1, a, b\n"), ["noise.inp"]),
    ("hex20.med", _hex20, ["element 0", "unknown node order"]),
    ("polygon.med", _polygon, ["PG2", "not supported"]),
    ("mixed.med", _mixed, ["triangular face(s) lean against a square one", "a pyramid must stand between"]),
    ("flat.msh", _triangles, ["no volume elements"]),
    ("flat.med", _flat_element, ["flat", "Jacobian"]),
    ("bent.med", _bent, ["element", "unknown node order"]),
    ("loose.med", _loose_facet, ["SKIN", "do not belong to a volume element"]),
    ("two.med", _two_meshes, ["2 MED meshes", "exactly one"]),
]


@pytest.mark.parametrize(("name", "make", "said"), FAULTS, ids=[name for name, _, _ in FAULTS])
def test_a_mesh_that_cannot_serve_is_one_clear_line_and_exit_code_2(
    name: str, make: Any, said: list[str], case_file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if make:
        make(tmp_path / name)
    capsys.readouterr()  # meshio warns while it writes
    assert main.main(["modes", case_file, "--quiet", "--mesh-file", str(tmp_path / name)]) == 2
    text = [line for line in capsys.readouterr().err.splitlines() if line]
    assert len(text) == 1
    assert all(word in text[0] for word in [name, *said])


def test_a_med_file_without_the_expected_group_names_those_it_has(
    case_file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    part = exchange(scene(), "pillar", TerminalLog(True))
    write_med(finite_elements.raw_mesh(part), tmp_path / "part.med", "PILLAR")
    query = ["modes", case_file, "--quiet", "--mesh-file", str(tmp_path / "part.med")]
    assert main.main([*query, "--clamp", "CLAMPS"]) == 2
    text = capsys.readouterr().err
    assert "did you mean CLAMP?" in text and "XMIN" in text and text.count("\n") == 1
    bare = RawMesh(part.mesh.nodes, [("hexahedron27", part.mesh.cells[:, local_nodes("hex", 2)])])
    write_med(bare, tmp_path / "bare.med", "PILLAR")
    assert main.main([*query[:-1], str(tmp_path / "bare.med"), "--clamp", "FOOT"]) == 2
    assert "it has none" in capsys.readouterr().err
    assert main.main([*query, "--symmetry", "SS"]) == 2


def test_a_file_in_millimetres_taken_for_metres_is_said(
    case_file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = bar(1, "tet")
    meshio.write(tmp_path / "big.msh", as_meshio(mesh, 1e3), file_format="gmsh22")
    assert main.main(["modes", case_file, "--quiet", "--mesh-file", str(tmp_path / "big.msh"), "--count", "1"]) == 0
    assert "--unit mm" in capsys.readouterr().err


def test_without_h5py_a_med_file_ends_with_exit_code_5(
    case_file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "x.med").write_bytes(b"")
    monkeypatch.setitem(sys.modules, "h5py", None)
    assert main.main(["modes", case_file, "--quiet", "--mesh-file", str(tmp_path / "x.med")]) == 5
    assert "h5py" in capsys.readouterr().err


def test_a_broken_step_file_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "own.toml").write_text(
        TOML.replace('shape = "square"\nside_mm = 2.0\nheight_mm = 6.0', 'shape = "step"\nfile = "broken.step"')
    )
    (tmp_path / "broken.step").write_text("ISO-10303-21;\nHEADER;\n#1=NOTHING(\n")
    assert main.main(["export", "aster", str(tmp_path / "own.toml"), "--quiet"]) == 2
    text = capsys.readouterr()
    assert "broken.step" in text.err and len([line for line in text.err.splitlines() if line]) == 1


def test_a_group_is_held_along_some_axes_only(case_file: str, tmp_path: Path) -> None:
    """A foot that slides on a plane keeps three rigid-body modes; one held along y as well keeps one."""
    mesh = bar(order=1)
    meshio.write(tmp_path / "bar.msh", as_meshio(mesh), file_format="gmsh22")
    query = [case_file, "--mesh-file", str(tmp_path / "bar.msh"), "--count", "4"]
    for axes, rigid in (("z", 3), ("yz", 1), ("xyz", 0)):
        document = modes_document([*query, "--support", f"FIXED:{axes}"], tmp_path)
        assert document["rigid_count"] == rigid
        free = np.ones((len(mesh.nodes), 3), dtype=bool)
        for axis in axes:
            free[mesh.nodes[:, 2] < 1e-9, "xyz".index(axis)] = False  # the foot, by where it lies
        system = SolidModel(mesh, dict.fromkeys(mesh.region_of_cells(), scene().design.material), (), False).system
        expected = modes_near(constrain(system, free), 0.0, 4).frequency_hz
        assert [mode["frequency_hz"] for mode in document["modes"]] == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("text", ["FIXED", "FIXED:", ":z", "FIXED:q", "FIXED:zz"])
def test_a_support_without_group_or_axes_is_refused(
    text: str, case_file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    meshio.write(tmp_path / "bar.msh", as_meshio(bar(order=1)), file_format="gmsh22")
    capsys.readouterr()
    assert main.main(["modes", case_file, "--mesh-file", str(tmp_path / "bar.msh"), "--support", text, "--quiet"]) == 2
    assert "NAME:AXES" in capsys.readouterr().err


def test_every_shape_of_a_mesh_file_is_written_for_paraview(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The fields of the VTU and the steps of the VTKHDF file are the modes of the file's mesh at the nodes of its surface."""
    import pyvista

    from pipeline.models.modes import Request
    from pipeline.models.user_mesh import UserMesh, solve

    case = tmp_path / "own.toml"
    case.write_text('material = "aluminium"\n[solve]\nnear_kHz = 1.0\ncount = 3\n')
    lines = [np.linspace(0.0, side, count) for side, count in ((0.03, 5), (0.02, 4), (0.002, 2))]
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape(5, 4, 2)
    square = ((0, 0), (1, 0), (1, 1), (0, 1))
    corners = [number[i : i + 4, j : j + 3, k : k + 1].ravel() for k in (0, 1) for i, j in square]
    file = str(tmp_path / "block.inp")
    meshio.write_points_cells(file, points, [("hexahedron", np.stack(corners, axis=1))])
    for form in ("vtu", "paraview"):
        assert main.main(["export", form, str(case), "--mesh-file", file, "-o", str(tmp_path / f"p.{ENDS[form]}")]) == 0
    solved = solve(load_case(case), UserMesh(file), Request("plate"), TerminalLog(True))
    surface = pyvista.read(tmp_path / "p.vtu")
    assert len(surface.point_data) == len(solved.rows) == 3
    place = cKDTree(solved.model.mesh.nodes).query(surface.points)[1]
    for name, row in zip(surface.point_data, solved.rows, strict=True):
        moved = solved.model.field(None, solved.vectors[None][:, [row.column]])[place, :, 0]
        assert name.endswith("kHz") and surface.point_data[name] == pytest.approx(moved, abs=1e-6 * np.abs(moved).max())
    with h5py.File(tmp_path / "p.vtkhdf") as written:
        assert list(written["VTKHDF"]["Steps"]["Values"]) == pytest.approx([row.frequency_hz for row in solved.rows])


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["stl", "--mesh-file", "FILE"], "must be left out of export stl"),
        (["vtu", "--unit", "mm"], "--unit: applies to --mesh-file only"),
        (["vtu", "--mesh-file", "FILE", "--merge", "far"], "--merge far: must be a number of 0 or more"),
    ],
)
def test_options_of_a_mesh_file_apply_where_it_is_solved(
    words: list[str], line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, case = tmp_path / "a.inp", tmp_path / "own.toml"
    file.touch()
    case.write_text('material = "aluminium"\n')
    given = [str(file) if word == "FILE" else word for word in words]
    assert main.main(["export", given[0], str(case), *given[1:]]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1 and line in said[0]
