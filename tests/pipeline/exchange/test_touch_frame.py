"""A mesh of one's own wherever it lies: measured in the frame of its touch face, or refused in one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geometry.formats.neutral import FACET, VOLUME, local_nodes
from geometry.hex.boxes import Boxes, hex_mesh
from geometry.mesh import Mesh
from pipeline.cli import main
from tests.helpers.mesh_files import facet_nodes

CASE = """name = "own"
material = "aluminium"
[plate]
thickness_mm = 2.0
[zone]
length_mm = 30.0
width_mm = 10.0
nodal_lines = 3
[array]
rows = 0
extension_mm = 4.0
"""
MEASURES = ("frequency_hz", "zone_share", "mac", "strength", "confinement_db")
ROUNDING = 1e-6  # of a measure: eigenvectors of matrices that differ by the order of sums, over the gaps between modes


def turned(degrees: float, *axis: float) -> np.ndarray:
    """The rotation matrix about an axis."""
    return Rotation.from_rotvec(np.radians(degrees) * np.array(axis) / np.linalg.norm(axis)).as_matrix()


PLACES = {
    "shifted": (np.eye(3), (30.0, -2.0, 10.0)),
    "length along y": (turned(90.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),
    "upside down": (turned(180.0, 1.0, 0.0, 0.0), (0.0, 0.0, 2.0)),
    "in a plane y = const": (turned(90.0, 1.0, 0.0, 0.0), (10.0, 0.0, 0.0)),
    "oblique": (turned(74.0, 1.0, 2.0, 3.0), (30.0, -10.0, 20.0)),
}


def plate(low_x: float = -15.0, lump: int = 0) -> Mesh:
    """The plate in place, in mm, one block on a corner: no mirror image of itself, and the zone's borders cut its facets."""
    x, y = np.arange(low_x, 15.1, 5.0), np.linspace(-9.0, 9.0, 5)
    region = np.full((len(x) - 1, 4, 2), -1)
    region[:, :, 0], region[-1, 3, 1] = 0, lump
    return hex_mesh(Boxes(x, y, np.array([0.0, 2.0, 2.5]), region, ("plate",)), 2)


def document(mesh: Mesh, nodes: np.ndarray, folder: Path, *more: str) -> dict[str, Any]:
    """The modes of the mesh with these nodes, its face in a group TOUCH."""
    assert run(mesh, nodes, folder, *more) == 0
    return dict(json.loads((folder / "modes.json").read_text()))


def run(mesh: Mesh, nodes: np.ndarray, folder: Path, *more: str) -> int:
    key = mesh.kind, mesh.order
    facets = [mesh.faces[name][:, facet_nodes(*key)] for name in ("touch", "x-")]
    cells = [(VOLUME[key], mesh.cells[:, local_nodes(*key)]), *((FACET[key], each) for each in facets)]
    numbers = [np.full(len(block), i + 1) for i, (_, block) in enumerate(cells)]
    data = {"gmsh:physical": numbers, "gmsh:geometrical": numbers}
    names = {"PLATE": np.array([1, 3]), "TOUCH": np.array([2, 2]), "CUT": np.array([3, 2])}
    meshio.write(folder / "own.msh", meshio.Mesh(nodes, cells, cell_data=data, field_data=names), file_format="gmsh22")
    (folder / "own.toml").write_text(CASE)
    where = ["--mesh-file", str(folder / "own.msh"), "--unit", "mm", "--band", "5kHz:60kHz", *more]
    return main.main(["modes", str(folder / "own.toml"), *where, "--quiet", "--json", str(folder / "modes.json")])


@pytest.fixture(scope="module")
def in_place(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    mesh = plate()
    return document(mesh, mesh.nodes, tmp_path_factory.mktemp("place"))


@pytest.mark.parametrize("place", PLACES)
def test_a_plate_that_lies_elsewhere_has_the_figures_of_the_plate_in_place(
    place: str, in_place: dict[str, Any], tmp_path: Path
) -> None:
    axes, shift = PLACES[place]
    mesh = plate()
    there = document(mesh, mesh.nodes @ axes.T + shift, tmp_path)
    assert len(there["modes"]) == len(in_place["modes"]) > 6
    assert max(mode["mac"] for mode in in_place["modes"]) > 0.5
    for ours, theirs in zip(there["modes"], in_place["modes"], strict=True):
        for name in MEASURES:
            assert ours[name] == pytest.approx(theirs[name], rel=ROUNDING, abs=ROUNDING), name
    assert there["target"]["index"] == in_place["target"]["index"]
    assert there["target"]["status"] == in_place["target"]["status"]


@pytest.mark.slow
def test_a_mesh_loses_energy_to_its_material_and_to_the_air_as_the_plate_does(tmp_path: Path) -> None:
    """Six by four quadratic elements; the plate's own mesh is finer."""
    mesh = plate(lump=-1)
    lossy = ["--set", 'damping.quality="materials"', "--set", "air={}"]
    own = document(mesh, mesh.nodes, tmp_path, *lossy)["modes"]
    where = ["--band", "5kHz:60kHz", *lossy, "--quiet", "--json", str(tmp_path / "plate.json")]
    assert main.main(["modes", str(tmp_path / "own.toml"), *where]) == 0
    known = json.loads((tmp_path / "plate.json").read_text())["modes"]
    assert len(own) >= len(known) > 4
    for ours, theirs in zip(own, known, strict=False):
        assert ours["frequency_hz"] == pytest.approx(theirs["frequency_hz"], rel=0.03)
        assert ours["quality_factor"] == pytest.approx(theirs["quality_factor"], rel=0.1)
        assert ours["air_quality_factor"] == pytest.approx(theirs["air_quality_factor"], rel=0.1)


@pytest.mark.parametrize(
    ("more", "said"),
    [(("--support", "CUT:yz"), "--support CUT:yz: [air] takes whole plates"), ((), "needs a face group named touch")],
)
def test_air_takes_whole_plates_with_a_known_face(
    more: tuple[str, ...],
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if not more:
        monkeypatch.setattr("pipeline.models.user_mesh._with_touch", lambda mesh: mesh)
    mesh = plate(lump=-1)
    assert run(mesh, mesh.nodes, tmp_path, "--set", "air={}", *more) == 2
    assert said in capsys.readouterr().err


def bent(nodes: np.ndarray) -> np.ndarray:
    return nodes + np.column_stack([0.0 * nodes[:, 0], 0.0 * nodes[:, 0], 1e-3 * nodes[:, 0] ** 2])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda nodes: nodes * [1.02, 1.0, 1.0], "is 30.6 x 18 mm: must be a plane face of 30 mm (length_mm"),
        (lambda nodes: nodes * [1.0, 0.5, 1.0], "is 30 x 9 mm: must be a plane face of 30 mm (length_mm"),
        (bent, "is not flat: its nodes lie up to"),
    ],
    ids=["long", "narrow", "bent"],
)
def test_a_touch_face_that_does_not_hold_the_zone_is_refused(
    change: Any, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = plate()
    assert run(mesh, change(mesh.nodes), tmp_path) == 2
    (line,) = [text for text in capsys.readouterr().err.splitlines() if text]
    assert "own.msh: group TOUCH " in line and said in line and "rename the group" in line


def test_a_face_within_a_percent_of_the_length_serves(tmp_path: Path) -> None:
    mesh = plate()
    assert run(mesh, mesh.nodes * [1.009, 1.0, 1.0], tmp_path) == 0


def test_a_half_between_mirror_planes_is_measured_where_it_lies(tmp_path: Path) -> None:
    """Three lines, one of them at x = 0: the target mode is antisymmetric there, u_y and u_z at rest on the cut."""
    whole, half = plate(lump=-1), plate(0.0, lump=-1)
    modes = document(whole, whole.nodes, tmp_path)["modes"]
    halved = document(half, half.nodes, tmp_path, "--support", "CUT:yz")["modes"]
    assert len(halved) > 3 and max(mode["mac"] for mode in halved) > 0.5
    for ours in halved:
        theirs = min(modes, key=lambda mode: abs(mode["frequency_hz"] - ours["frequency_hz"]))
        assert ours["frequency_hz"] == pytest.approx(theirs["frequency_hz"], rel=ROUNDING)
        for name in ("zone_share", "mac", "confinement_db"):
            assert ours[name] == pytest.approx(theirs[name], rel=ROUNDING, abs=ROUNDING), name
