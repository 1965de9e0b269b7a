"""Code_Aster studies: the MED file read back by h5py alone and by medcoupling, commands against the catalogue."""

from __future__ import annotations

import ast
import tomllib
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from geometry.formats.med import read_med, write_med
from geometry.formats.neutral import RawMesh, local_nodes, outer_facets
from geometry.hex.boxes import Boxes, hex_mesh
from geometry.mesh import Mesh, cell_volumes, check_mesh, split_hexahedra
from pipeline.case.model import Case, case_from_dict
from pipeline.cli import main
from pipeline.errors import InputError
from pipeline.exchange import finite_elements
from pipeline.exchange.finite_elements import MAX_DOFS, Exchange, exchange, modes_below
from pipeline.logs import TerminalLog
from solvers.fem.eigen import modes_in_band
from solvers.fem.solid import SolidModel
from tests.helpers.scenes import STEEL_PILLARS

CATALOGUE = tomllib.loads((Path(__file__).parent / "aster_catalogue.toml").read_text())
GEOMETRY = {"T10": 310, "H27": 327, "TR6": 206, "QU9": 209}  # numbers of MED's geometry types (med.h)
# corners of MED's volumes whose middle a node is: read off medcoupling's sub-cells, typed in here on purpose
MED_T10 = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
MED_H27 = (
    *((0, 1), (1, 2), (2, 3), (0, 3), (4, 5), (5, 6), (6, 7), (4, 7), (0, 4), (1, 5), (2, 6), (3, 7)),
    *((0, 1, 2, 3), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0), (4, 7, 6, 5), tuple(range(8))),
)
SCENE = STEEL_PILLARS | {"solve": {"band_kHz": [5.0, 60.0], "accuracy": 0.03}}


def scene(**solve: Any) -> Case:
    return case_from_dict(SCENE | {"solve": SCENE["solve"] | solve})


@pytest.fixture(scope="module", params=["hex", pytest.param("tet", marks=pytest.mark.slow)])
def plate(request: pytest.FixtureRequest) -> Exchange:
    return exchange(scene(), "plate", TerminalLog(True), tetrahedra=request.param == "tet")


@pytest.fixture
def med(plate: Exchange, tmp_path: Path) -> Path:
    write_med(finite_elements.raw_mesh(plate), tmp_path / "plate.med", "PLATE")
    return tmp_path / "plate.med"


def _connectivity(group: Any) -> np.ndarray:
    return np.asarray(group["NOD"][...]).reshape(-1, int(group["NOD"].attrs["NBR"])).T - 1


def test_every_block_names_its_geometry_and_lies_in_meds_node_order(plate: Exchange, med: Path) -> None:
    with h5py.File(med) as file:
        step = next(iter(file["ENS_MAA/PLATE"].values()))
        points = np.asarray(step["NOE/COO"][...]).reshape(3, -1).T
        blocks = {code: (int(group.attrs["GEO"]), _connectivity(group)) for code, group in step["MAI"].items()}
    assert {code: number for code, (number, _) in blocks.items()} == {code: GEOMETRY[code] for code in blocks}
    assert np.array_equal(points, plate.mesh.nodes)
    code, middles, fourth = ("T10", MED_T10, 3) if plate.mesh.kind == "tet" else ("H27", MED_H27, 4)
    cells = blocks[code][1]
    assert len(cells) == len(plate.mesh.cells)
    # element by element: every middle node in the middle of the corners that MED gives it
    for place, corners in enumerate(middles, start=4 if code == "T10" else 8):
        assert np.allclose(points[cells[:, place]], points[cells[:, list(corners)]].mean(axis=1), rtol=0, atol=1e-12)
    # and MED's first face, seen from the rest of the element, turns anticlockwise: VTK's order is its mirror image
    a, b, c, d = (points[cells[:, i]] for i in (0, 1, 2, fourth))
    triple = np.einsum("ei,ei->e", np.cross(b - a, c - a), d - a)
    assert (triple < 0.0).all()
    if code == "T10":
        assert -triple.sum() / 6.0 == pytest.approx(cell_volumes(plate.mesh).sum(), rel=1e-12)


def test_facets_lie_on_their_planes_cover_them_and_look_outward(plate: Exchange, med: Path) -> None:
    raw = read_med(med)
    kind = {name: index for index, (name, _) in enumerate(raw.blocks)}
    facets = next(block for name, block in raw.blocks if name.startswith(("tri", "quad")))
    index = next(i for name, i in kind.items() if name.startswith(("tri", "quad")))
    length, span = 20e-3, 22e-3
    feet = 8 * (2e-3) ** 2
    expected = {
        "TOUCH": ((0, 0, -1), 2, 0.0, length * span),
        "BACK": ((0, 0, 1), 2, 2e-3, length * span - feet),
        "TOP": ((0, 0, 1), 2, 8e-3, feet),
        "XMIN": ((-1, 0, 0), 0, -length / 2, span * 2e-3),
        "YMAX": ((0, 1, 0), 1, span / 2, length * 2e-3),
    }
    for name, (normal, axis, position, area) in expected.items():
        nodes = facets[raw.cell_groups[name][index]]
        corners = raw.points[nodes[:, : 3 if plate.mesh.kind == "tet" else 4]]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        across /= 2.0 if plate.mesh.kind == "tet" else 1.0
        assert np.allclose(raw.points[nodes][:, :, axis], position, atol=1e-15)
        assert np.allclose(across.sum(axis=0), area * np.array(normal), rtol=0, atol=1e-10 * area)
        assert np.array_equal(np.unique(nodes), np.sort(raw.node_groups["N_" + name]))


def test_medcoupling_reads_the_same_groups_volumes_and_middle_nodes(plate: Exchange, med: Path) -> None:
    mc = pytest.importorskip("medcoupling", reason="medcoupling has wheels for x86-64 only: pip install medcoupling")
    file = mc.MEDFileUMesh(str(med))
    volumes = file.getMeshAtLevel(0)
    counts = {name: file.getGroupArr(0, name).getNumberOfTuples() for name in plate.volumes}
    counts |= {name: file.getGroupArr(-1, name).getNumberOfTuples() for name in plate.faces}
    assert counts == {name: len(part) for name, part in {**plate.volumes, **plate.faces}.items()}
    assert set(file.getGroupsOnSpecifiedLev(1)) == {"N_" + name for name in plate.faces}
    straight = volumes.deepCopy()
    straight.convertQuadraticCellsToLinear()
    measured = np.array(straight.getMeasureField(False).getArray().getValues())
    order = np.array(volumes.getCoords().getValues()).reshape(-1, 3)
    assert (measured > 0.0).all()  # medcoupling's sign says that the order is MED's
    assert np.allclose(measured, cell_volumes(plate.mesh), rtol=1e-10)
    subs, *_ = volumes.buildDescendingConnectivity()
    for face in range(subs.getNumberOfCells()):  # their middles are where medcoupling's own model of the cell puts them
        at = order[subs.getNodeIdsOfCell(face)]
        corners = 3 if len(at) == 6 else 4
        ring = (at[:corners] + np.roll(at[:corners], -1, axis=0)) / 2.0
        assert np.allclose(at[corners : 2 * corners], ring, rtol=0, atol=1e-12)
        assert corners == 3 or np.allclose(at[8], at[:4].mean(axis=0), rtol=0, atol=1e-12)


def test_what_is_written_comes_back_to_the_last_bit(plate: Exchange, med: Path) -> None:
    raw, back = finite_elements.raw_mesh(plate), read_med(med)
    written = dict(raw.blocks)
    assert all(np.array_equal(written[name], block) for name, block in back.blocks)
    assert back.node_groups.keys() == raw.node_groups.keys()
    assert back.cell_groups.keys() == raw.cell_groups.keys()


def test_families_hold_every_combination_once(tmp_path: Path) -> None:
    cells = np.array([[0, 1, 2, 3], [1, 2, 3, 4], [2, 3, 4, 5]])
    points = np.random.default_rng(1).random((6, 3))
    groups = {"A": {0: np.array([0, 1])}, "B": {0: np.array([1, 2])}}
    write_med(RawMesh(points, [("tetra", cells)], groups), tmp_path / "x.med", "M")
    with h5py.File(tmp_path / "x.med") as file:
        numbers = file["ENS_MAA/M"][next(iter(file["ENS_MAA/M"]))]["MAI/TE4/FAM"][...]
        assert (numbers < 0).all() and len(set(numbers)) == 3
        assert len(file["FAS/M/ELEME"]) == 3 and "NOEUD" not in file["FAS/M"]
    back = read_med(tmp_path / "x.med").cell_groups
    assert {name: part[0].tolist() for name, part in back.items()} == {"A": [0, 1], "B": [1, 2]}


def test_hexahedra_are_cut_into_tetrahedra_that_fit_together() -> None:
    lines = np.array([0.0, 1.0, 3.0])
    region = np.zeros((2, 2, 2), dtype=np.int64)
    region[0, 0, 1], region[1, 1, 1] = -1, 1
    cube = hex_mesh(Boxes(lines, lines, lines, region, ("plate", "pillar")), 2)
    cut = split_hexahedra(cube)
    check_mesh(cut, float(cell_volumes(cube).sum()), 1e-12)
    facets = outer_facets(cut).nodes
    hexahedral = outer_facets(cube).nodes
    assert len(facets) == 2 * len(hexahedral)  # a face not cut alike on both sides would stay open
    assert np.array_equal(np.unique(facets), np.unique(hexahedral))
    volumes = cell_volumes(cut)
    assert volumes[cut.regions["pillar"]].sum() == pytest.approx(cell_volumes(cube)[cube.regions["pillar"]].sum())
    for name, face in cut.faces.items():
        assert np.array_equal(np.unique(face), np.unique(cube.faces[name]))
    flat = Mesh(cube.nodes, cube.cells[:, local_nodes("hex", 2)], "hex", 2)
    with pytest.raises(ValueError, match="order 2"):
        split_hexahedra(Mesh(flat.nodes, flat.cells, "hex", 3))


def _calls(text: str) -> list[tuple[str, ast.Call]]:
    tree = ast.parse(text)
    values = [node.value for node in tree.body if isinstance(node, ast.Assign | ast.Expr)]
    assert len(values) == len(tree.body)
    return [(node.func.id, node) for node in values if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)]


def _check(call: ast.Call, allowed: dict[str, Any], where: str) -> None:
    for keyword in call.keywords:
        assert keyword.arg in allowed, f"{where}: no keyword {keyword.arg}"
        known = allowed[keyword.arg]
        values = keyword.value.elts if isinstance(keyword.value, ast.Tuple) else [keyword.value]
        for value in values:
            if isinstance(known, dict):
                assert isinstance(value, ast.Call) and isinstance(value.func, ast.Name) and value.func.id == "_F"
                _check(value, known, f"{where}.{keyword.arg}")
            elif known:
                assert isinstance(value, ast.Constant) and value.value in known, f"{where}.{keyword.arg}"


STUDIES = [("plate", {}), ("zone", {}), ("pillar", {}), ("pillar", {"band_kHz": None, "near_kHz": 40.0, "count": 3})]


@pytest.mark.parametrize(("part", "solve"), STUDIES, ids=["plate", "zone", "pillar", "near"])
def test_commands_are_python_and_every_keyword_is_in_the_catalogue(part: str, solve: dict[str, Any]) -> None:
    query = {key: value for key, value in (SCENE["solve"] | solve).items() if value is not None}
    result = exchange(case_from_dict(SCENE | {"solve": query}), part, TerminalLog(True))
    text = finite_elements.commands(result, (5e3, 30e3, 60e3) if result.search.band_hz else ())
    calls = _calls(text)
    names = [name for name, _ in calls]
    for name, call in calls:
        _check(call, CATALOGUE[name], name)
    assert names[0] == "DEBUT" and names[-1] == "FIN"
    order = ["LIRE_MAILLAGE", "AFFE_MODELE", "DEFI_MATERIAU", "AFFE_MATERIAU", "ASSEMBLAGE", "CALC_MODES", "IMPR_RESU"]
    assert all(names.index(a) < names.index(b) for a, b in pairwise(order))
    assert ("AFFE_CHAR_MECA" in names) == ("CHARGE=CLAMPED" in text) == (part != "plate")
    assert ("INFO_MODE" in names) == bool(result.search.band_hz)
    groups = {node.value for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Constant)}
    assert set(result.volumes) <= groups
    assert "STURM" in text


FIBRES = {
    "density_kg_m3": 1900.0,
    "orthotropic": {
        "E1_GPa": 40.0, "E2_GPa": 9.0, "E3_GPa": 8.0, "nu12": 0.27, "nu13": 0.29, "nu23": 0.4,
        "G12_GPa": 4.0, "G13_GPa": 4.5, "G23_GPa": 2.5,
    },
}  # fmt: skip


def test_an_orthotropic_material_has_its_nine_constants_and_axes_along_the_mesh() -> None:
    result = exchange(case_from_dict(SCENE | {"material": FIBRES}), "plate", TerminalLog(True))
    calls = _calls(finite_elements.commands(result, (5e3, 60e3)))
    for name, call in calls:
        _check(call, CATALOGUE[name], name)
    (law,) = [
        keyword.value
        for name, call in calls
        for keyword in call.keywords
        if name == "DEFI_MATERIAU" and keyword.arg == "ELAS_ORTH"
    ]
    assert isinstance(law, ast.Call)
    stated = {keyword.arg: ast.literal_eval(keyword.value) for keyword in law.keywords}
    given = {key: 1e9 * value if key.endswith("_GPa") else value for key, value in FIBRES["orthotropic"].items()}  # type: ignore[attr-defined]
    letters = str.maketrans("123", "LTN")
    for key, value in given.items():
        name = key.removesuffix("_GPa")
        assert stated[f"{name.rstrip('123').upper()}_{name.lstrip('EnuG').translate(letters)}"] == pytest.approx(value)
    assert any(name == "AFFE_CARA_ELEM" for name, _ in calls)


def test_axes_that_elas_orth_cannot_hold_are_refused_in_one_line(tmp_path: Path) -> None:
    turned = case_from_dict(SCENE | {"material": FIBRES | {"axes_deg": [30.0, 0.0, 0.0]}})
    with pytest.raises(
        InputError, match="ELAS_ORTH takes axes along x, y and z: leave out axes_deg, or export calculix"
    ):
        finite_elements.aster(turned, "plate", tmp_path / "plate", TerminalLog(True))
    assert not list(tmp_path.iterdir())


def test_the_catalogue_check_refuses_a_wrong_keyword_and_a_wrong_word() -> None:
    for wrong in ('DEBUT(LANGUE="EN")', 'CALC_MODES(VERI_MODE=_F(STURM="YES"))'):
        ((name, call),) = _calls(wrong)
        with pytest.raises(AssertionError):
            _check(call, CATALOGUE[name], name)


def test_each_volume_has_its_own_material() -> None:
    result = exchange(scene(), "plate", TerminalLog(True))
    text = finite_elements.commands(result, (5e3, 60e3))
    assert text.count("DEFI_MATERIAU") == 2
    assert "RHO=7850.0" in text.split("MAT_PILLAR = ")[1].split("\n")[0]
    assert "RHO=2700.0" in text.split("MAT_PLATE = ")[1].split("\n")[0]


def test_every_line_of_the_export_file_is_one_that_run_aster_reads(tmp_path: Path) -> None:
    text = finite_elements.rendered("aster.export.j2", name="small")
    units = {}
    for line in text.splitlines():
        kind, *fields = line.split()
        assert (kind == "P" and len(fields) == 2) or (kind == "F" and len(fields) == 4 and fields[2] in "DRC")
        if kind == "F":
            units[int(fields[3])] = (fields[0], fields[1], fields[2])
            assert not Path(fields[1]).is_absolute() and ":" not in fields[1]
    assert units[20] == ("mmed", "small.med", "D") and units[80] == ("rmed", "small.rmed", "R")
    assert {1, 6, 8} <= set(units) and 15 not in units


def test_modes_counted_for_the_sub_bands_are_those_of_the_mesh_written() -> None:
    case = scene()
    result = exchange(case, "pillar", TerminalLog(True))
    model = SolidModel(result.mesh, {"pillar": case.design.pillar.material}, ("touch",), False)  # type: ignore[union-attr]
    whole = modes_in_band(model.pencil(None), 0.0, 150e3)
    assert modes_below(case, "pillar", (1e3, 150e3), TerminalLog(True)) == [0, len(whole.frequency_hz)]


def test_the_command_writes_four_files_that_go_together(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    case = tmp_path / "case.toml"
    case.write_text(
        'name = "one"\nmaterial = "aluminium"\n[plate]\nthickness_mm = 2.0\n[pillar]\nshape = "square"\n'
        "side_mm = 2.0\nheight_mm = 6.0\n[solve]\nband_kHz = [10.0, 200.0]\naccuracy = 0.03\n"
    )
    target = tmp_path / "out" / "one.med"
    target.parent.mkdir()
    assert main.main(["export", "aster", str(case), "--part", "pillar", "-o", str(target)]) == 0
    said = capsys.readouterr().err
    assert "hexahedra of 27 nodes" in said and "degrees of freedom" in said
    names = {path.name for path in target.parent.iterdir()}
    assert names == {"one.med", "one.comm", "one.export", "one_README.txt"}
    assert "one.med" in (target.parent / "one.export").read_text()
    commands = (target.parent / "one.comm").read_text()
    with h5py.File(target) as file:
        assert f'NOM_MED="{next(iter(file["ENS_MAA"]))}"' in commands
    assert main.main(["export", "stl", str(case), "--part", "pillar"]) == 2
    assert main.main(["export", "calculix", str(case), "--part", "pillar", "--out", str(tmp_path / "made")]) == 0
    assert {path.name for path in (tmp_path / "made").iterdir()} == {"one.inp", "export.json"}  # and none elsewhere
    assert {path.name for path in tmp_path.iterdir()} == {"case.toml", "out", "made"}


@pytest.mark.slow
def test_the_default_plate_stays_below_the_limit_of_degrees_of_freedom() -> None:
    from pipeline.case.model import load_case

    root = Path(__file__).resolve().parents[3]
    result = exchange(load_case(root / "studies" / "three-rows.toml"), "plate", TerminalLog(True))
    assert MAX_DOFS / 4 < result.mesh.dof <= MAX_DOFS
