"""Hexahedra of 20 nodes read as hexahedra of 27: the same body, and the numbers of the 27-node mesh that it came from."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest

from geometry.formats.med import write_med
from geometry.formats.neutral import PLACES, RawMesh, local_nodes
from geometry.mesh import Mesh
from solvers.fem.eigen import modes_near
from solvers.fem.solid import SolidModel
from tests.helpers.mesh_files import load
from tests.helpers.small_meshes import SOFT, hexes, plain

CORNERS = 2.0 * np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]) - 1.0


def twenty(mesh: Mesh) -> RawMesh:
    """A mesh of 27-node hexahedra without the middles of faces and cells, and its nodes numbered anew."""
    cells = mesh.cells[:, local_nodes("hex", 2)][:, :20]
    used, place = np.unique(cells, return_inverse=True)
    return RawMesh(mesh.nodes[used], [("hexahedron20", place.reshape(cells.shape))])


def written(raw: RawMesh, place: Path) -> str:
    if place.suffix == ".med":
        write_med(raw, place, "BODY")
    else:
        meshio.write(
            place, meshio.Mesh(raw.points, raw.blocks), file_format="gmsh" if place.suffix == ".msh" else "abaqus"
        )
    return str(place)


@pytest.mark.parametrize("suffix", [".inp", ".msh", ".med"])
def test_a_box_of_twenty_nodes_is_the_box_of_twenty_seven(suffix: str, tmp_path: Path) -> None:
    mesh = hexes(2)
    read = load(written(twenty(mesh), tmp_path / f"box{suffix}"))
    assert (read.kind, read.order, len(read.nodes)) == ("hex", 2, len(mesh.nodes))
    assert np.sort(read.nodes, axis=0) == pytest.approx(np.sort(mesh.nodes, axis=0), abs=1e-12)
    tones = []
    for each in (read, plain(mesh)):
        model = SolidModel(each, dict.fromkeys(each.regions, SOFT), (), False)
        tones.append(modes_near(model.pencil(None), 0.0, 5).frequency_hz)
    assert tones[0] == pytest.approx(tones[1], rel=1e-9)


def by_twenty(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The 20-node map in closed form: nodes (20, 3) in VTK's order, at (q, 3) in -1..1."""
    places = np.array([CORNERS[list(place)].mean(axis=0) for place in PLACES["hexahedron20"]])
    out = np.zeros_like(at)
    for place, node in zip(places, nodes, strict=True):
        line = 1.0 + at * place
        middle = np.flatnonzero(place == 0.0)
        if len(middle):
            value = 0.25 * (1.0 - at[:, middle[0]] ** 2) * np.delete(line, middle[0], axis=1).prod(axis=1)
        else:
            value = 0.125 * line.prod(axis=1) * ((at * place).sum(axis=1) - 2.0)
        out += value[:, None] * node
    return out


def test_a_curved_element_stays_as_it_is(tmp_path: Path) -> None:
    raw = twenty(hexes(2, (1, 1, 1)))
    bent = raw.points + 4e-5 * np.random.default_rng(5).uniform(-1.0, 1.0, raw.points.shape)
    read = load(written(RawMesh(bent, raw.blocks), tmp_path / "bent.msh"))
    at = np.random.default_rng(6).uniform(-1.0, 1.0, (40, 3))
    value, _ = read.element.shape(at)
    assert value @ read.nodes[read.cells[0]] == pytest.approx(by_twenty(bent[raw.blocks[0][1][0]], at), abs=1e-12)
