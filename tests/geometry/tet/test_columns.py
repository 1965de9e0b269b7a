"""A plate's quarter from half a column of pillars: the same body as the CAD says, every inner face shared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from geometry.cad import solids
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS
from geometry.mesh import Mesh, cell_volumes, check_mesh
from geometry.tet.scenes import Columns, tet_plate

ALUMINIUM, BRASS = MATERIALS["aluminium"], MATERIALS["brass"]


def design(length_m: float, shape: str = "square", material: object = ALUMINIUM, rows: int = 1) -> Design:
    pillar = Pillar(shape, 2e-3, 2e-3, 5e-3, material)  # type: ignore[arg-type]
    return Design(length_m, 4e-3, 2e-3, 1, ALUMINIUM, pillar, 4e-3, 4e-3, rows, 1e-3)


def skin(mesh: Mesh) -> trimesh.Trimesh:
    """The sides that only one tetrahedron has."""
    sides = mesh.cells[:, mesh.element.facets[0][:, :3]].reshape(-1, 3)
    _, first, count = np.unique(np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True)
    assert count.max() == 2
    surface = trimesh.Trimesh(1e3 * mesh.nodes, sides[first[count == 1]], process=False)
    surface.remove_unreferenced_vertices()
    return surface


@pytest.mark.slow
@pytest.mark.parametrize(
    ("length_m", "columns"),
    [
        (3.6e-3, 1),
        (8e-3, 2),
        (7.6e-3, 2),
        (11.4e-3, 3),
    ],
    ids=["one", "even", "cut", "odd"],
)
def test_columns_make_the_quarter_that_the_cad_says(length_m: float, columns: int) -> None:
    own = design(length_m)
    assert len(own.column_centres()) == columns and Columns.of(own)
    mesh, body = tet_plate(own, 2e-3, True), solids.plate_solid(own, "xy")
    assert check_mesh(mesh).volume_m3 == pytest.approx(body.volume_m3, rel=1e-9)
    surface, cad = skin(mesh), body.shape
    assert surface.is_watertight and surface.body_count == 1
    assert surface.area == pytest.approx(cad.Area(), rel=1e-9)
    assert surface.center_mass == pytest.approx(cad.Center().toTuple(), abs=1e-6)
    ends = {"x-": 0.0, "x+": length_m / 2.0}
    for name, at in ends.items():
        assert np.abs(mesh.nodes[mesh.nodes_of(name), 0] - at).max() < 1e-12
    for name, axis, sign in (("x-", 0, -1), ("x+", 0, 1), ("touch", 2, -1), ("top", 2, 1)):
        a, b, c = (mesh.nodes[mesh.faces[name][:, i]] for i in range(3))
        assert (sign * np.cross(b - a, c - a)[:, axis] > 0.0).all(), name
    touch = mesh.nodes[mesh.faces["touch"][:, :3]]
    area = np.linalg.norm(np.cross(touch[:, 1] - touch[:, 0], touch[:, 2] - touch[:, 0]), axis=1).sum() / 2.0
    assert area == pytest.approx(length_m / 2.0 * own.half_span_m, rel=1e-9)


@pytest.mark.slow
def test_straight_edges_stay_straight_in_the_stretched_end() -> None:
    mesh = tet_plate(design(11.2e-3), 2e-3, True)
    ends = mesh.nodes[mesh.cells[:, [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]]]].mean(axis=2)
    assert np.abs(mesh.nodes[mesh.cells[:, 4:]] - ends).max() < 1e-12


@pytest.mark.slow
def test_bonded_round_pillars_keep_their_region_and_their_curves() -> None:
    own = design(11.6e-3, "round", BRASS)
    mesh = tet_plate(own, 1.5e-3, True)
    volumes = cell_volumes(mesh)
    exact = np.pi / 4.0 * 2e-3**2 * 5e-3 * 1.5  # of the quarter's three pillars one is cut in half
    assert volumes[mesh.regions["pillar"]].sum() == pytest.approx(exact, rel=2e-3)
    assert volumes.sum() == pytest.approx(solids.plate_solid(own, "xy").volume_m3, rel=1e-3)


def test_plates_without_alike_columns_are_meshed_as_they_are() -> None:
    own = design(12e-3)
    others = {
        "no rows": replace(own, rows=0),
        "staggered": replace(own, rows=2, stagger=True),
        "pillars at the end": design(10e-3),
        "a wide end": design(13.9e-3),
    }
    assert {name: Columns.of(other) for name, other in others.items()} == dict.fromkeys(others)
