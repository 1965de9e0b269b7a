"""Wedges and pyramids of a file, alone and between hexahedra and tetrahedra: fields that the elements hold come out exactly."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest
from meshio._mesh import topological_dimension

from geometry.errors import MeshFileError
from geometry.formats.med import write_med
from geometry.formats.neutral import CORNER_COUNT, PLACES, RawMesh
from geometry.materials import Material
from geometry.mesh import AnyMesh, MixedMesh, check_mesh
from solvers.fem.assembly import Scale, System, assemble
from solvers.fem.eigen import modes_near
from solvers.fem.solid import SolidModel
from solvers.fem.surface import face_quadrature, skin_faces
from tests.helpers.mesh_files import load
from tests.helpers.small_meshes import SOFT

EDGE_M = 1e-3
GRID = EDGE_M * np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in range(4)], dtype=float)
MIDDLE = GRID[[1, 2, 5, 6, 9, 10, 13, 14]].mean(axis=0)
VOLUME_M3 = 3 * EDGE_M**3
Cells = dict[str, list[list[int]]]

# A row of three cubes: the first whole, the second cut about its middle (node 16) into two pyramids and eight tetrahedra,
# the third cut into two wedges.
CUBES: Cells = {
    "hexahedron": [[0, 1, 5, 4, 8, 9, 13, 12]],
    "pyramid": [[1, 5, 13, 9, 16], [2, 10, 14, 6, 16]],
    "tetra": [
        [*corners, 16]
        for a, b, c, d in ([1, 2, 6, 5], [9, 13, 14, 10], [1, 9, 10, 2], [5, 6, 14, 13])
        for corners in ([a, b, c], [a, c, d])
    ],
    "wedge": [[2, 3, 7, 10, 11, 15], [2, 7, 6, 10, 15, 14]],
}
WITH_EDGES = {"hexahedron": "hexahedron20", "pyramid": "pyramid13", "tetra": "tetra10", "wedge": "wedge15"}
WITH_FACES = {"hexahedron": "hexahedron27", "pyramid": "pyramid14", "tetra": "tetra10", "wedge": "wedge18"}


def row(types: dict[str, str], bend_m: float = 0.0, cells: Cells = CUBES) -> RawMesh:
    """The row of cubes with elements of these types; inner and outer corners moved at random, middles kept half-way."""
    corners = np.vstack([GRID, MIDDLE]) + bend_m * np.random.default_rng(4).uniform(-1.0, 1.0, (17, 3))
    points, known, blocks = list(corners), {(i,): i for i in range(17)}, []
    for kind, members in cells.items():
        block = []
        for member in members:
            nodes = []
            for place in PLACES[types.get(kind, kind)]:
                key = tuple(sorted(member[corner] for corner in place))
                if key not in known:
                    known[key] = len(points)
                    points.append(corners[list(key)].mean(axis=0))
                nodes.append(known[key])
            block.append(nodes)
        blocks.append((types.get(kind, kind), np.array(block)))
    return RawMesh(np.array(points), blocks)


def written(raw: RawMesh, place: Path) -> str:
    if place.suffix == ".med":
        write_med(raw, place, "BODY")
    else:
        topological_dimension.update(wedge15=3, pyramid13=3)  # which meshio 5.3 leaves out
        meshio.write(place, meshio.Mesh(raw.points, raw.blocks), file_format="gmsh22")
    return str(place)


def system_of(mesh: AnyMesh) -> System:
    return assemble(mesh, dict.fromkeys(mesh.region_of_cells(), SOFT))


KINDS = [({}, 1, ".msh"), ({}, 1, ".med"), (WITH_EDGES, 2, ".msh"), (WITH_EDGES, 2, ".med"), (WITH_FACES, 2, ".msh")]
KINDS += [(WITH_FACES | {"pyramid": "pyramid13"}, 2, ".med")]  # the base has the middle that its neighbours name


@pytest.mark.parametrize(("types", "order", "suffix"), KINDS)
def test_a_row_of_all_four_kinds_is_one_body(types: dict[str, str], order: int, suffix: str, tmp_path: Path) -> None:
    mesh = load(written(row(types), tmp_path / f"row{suffix}"))
    assert isinstance(mesh, MixedMesh) and (mesh.kind, mesh.order) == ("hex+pyramid+tet+wedge", order)
    assert len(mesh.nodes) == len(row(WITH_FACES if order == 2 else {}).points)
    assert check_mesh(mesh).volume_m3 == pytest.approx(VOLUME_M3, rel=1e-12)
    system = system_of(mesh)
    assert system.mass.sum() * system.scale.mass_kg == pytest.approx(SOFT.density_kg_m3 * VOLUME_M3, rel=1e-12)
    facets = skin_faces(mesh)
    assert (
        len(facets) == 5 + 8 + 3 + 4 and (facets[:, 2] == facets[:, 3]).sum() == 8 + 4
    )  # twice of 8: beside the pyramids
    solved = modes_near(SolidModel(mesh, {"plate": SOFT}, (), False).pencil(None), 0.0, 2)
    assert solved.rigid_count == 6 and solved.count.expected == solved.count.found


@pytest.mark.parametrize(("types", "order", "suffix"), KINDS)
def test_a_uniform_strain_is_held_by_distorted_elements_of_every_kind(
    types: dict[str, str], order: int, suffix: str, tmp_path: Path
) -> None:
    """The patch test: a linear displacement has no forces inside, and stores the energy of its uniform stress."""
    mesh = load(written(row(types, 1.2e-4), tmp_path / f"row{suffix}"))
    assert isinstance(mesh, MixedMesh)
    system = system_of(mesh)
    strain = np.random.default_rng(2).normal(size=(3, 3))
    moved = (mesh.nodes / system.scale.length_m) @ strain.T
    forces = (system.stiffness @ moved.ravel()).reshape(-1, 3)
    pyramids = next(block for block in mesh.blocks if block.kind == "pyramid")
    inside = pyramids.cells[:, [4, *range(9, 13)][: 1 if order == 1 else 5]]  # the tip, and the middles of edges to it
    assert np.abs(forces[inside]).max() < 1e-12 * np.abs(forces).max()
    stress = np.einsum("ikjl,jl->ik", SOFT.tensor_pa / system.scale.young_pa, strain)
    volume = check_mesh(mesh).volume_m3 / system.scale.length_m**3
    assert moved.ravel() @ forces.ravel() == pytest.approx(volume * np.sum(stress * strain), rel=1e-11)


def test_straight_quadratic_elements_of_every_kind_hold_a_quadratic_field(tmp_path: Path) -> None:
    """Pure bending u = (-x z, 0, x^2/2) of a material without lateral strain: no forces inside, its energy exactly."""
    mesh = load(written(row(WITH_EDGES), tmp_path / "row.msh"))
    assert isinstance(mesh, MixedMesh)
    bending = Material.isotropic("cork", SOFT.as_isotropic.young_pa, SOFT.density_kg_m3, 0.0)
    system = assemble(mesh, {"plate": bending}, Scale.of(EDGE_M, bending))
    x, _, z = mesh.nodes.T / EDGE_M
    moved = np.column_stack([-x * z, np.zeros_like(x), x**2 / 2.0])
    forces = (system.stiffness @ moved.ravel()).reshape(-1, 3)
    tip = next(block for block in mesh.blocks if block.kind == "pyramid").cells[0, 4]
    assert np.abs(forces[tip]).max() < 1e-13
    assert moved.ravel() @ forces.ravel() == pytest.approx(3.0 * 1.0 / 3.0, rel=1e-12)  # int z^2 over the row


def test_a_face_of_triangles_and_squares_is_integrated_whole(tmp_path: Path) -> None:
    """The face z = 0 of the row: a square, two triangles and two triangles; its group names facets of both shapes."""
    raw = row(WITH_EDGES)
    facets = [("triangle", [[1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6]]), ("quad", [[0, 1, 5, 4]])]
    blocks = [*raw.blocks, *((kind, np.array(cells)) for kind, cells in facets)]
    place = tmp_path / "row.med"
    write_med(RawMesh(raw.points, blocks, {"TOUCH": {4: np.arange(4), 5: np.arange(1)}}), place, "BODY")
    mesh = load(str(place))
    rule = face_quadrature(mesh, "TOUCH")
    x = rule.interpolation @ mesh.nodes[:, 0]
    assert rule.weights.sum() == pytest.approx(3.0 * EDGE_M**2, rel=1e-12)
    assert rule.weights @ x**2 == pytest.approx(9.0 * EDGE_M**4, rel=1e-12)
    assert rule.points[:, 0] == pytest.approx(x, abs=1e-15) and np.abs(rule.points[:, 2]).max() < 1e-15
    assert len(mesh.nodes_of("TOUCH")) == 8 + 12 + 1  # corners, edges, the square's middle


INP = """*NODE
1,0,0,0
2,1,0,0
3,0,1,0
4,0,0,1
5,1,0,1
6,0,1,1
7,1,1,0
8,1,1,1
9,2,.5,.5
*ELEMENT, TYPE=C3D6
1,1,2,3,4,5,6
*ELEMENT, TYPE=C3D6, ELSET=PILLAR
2,2,7,3,5,8,6
*ELEMENT, TYPE=C3D5, ELSET=PILLAR
3,2,7,8,5,9
"""


def test_an_abaqus_file_names_its_elements_block_by_block(tmp_path: Path) -> None:
    (tmp_path / "body.inp").write_text(INP)
    mesh = load(str(tmp_path / "body.inp"), "mm")
    assert isinstance(mesh, MixedMesh) and mesh.kind == "pyramid+wedge"
    assert check_mesh(mesh).volume_m3 == pytest.approx((1.0 + 1.0 / 3.0) * 1e-9, rel=1e-12)
    assert mesh.regions["pillar"].tolist() == [0, 2] and mesh.regions["plate"].tolist() == [1]
    (tmp_path / "twice.inp").write_text(INP + "*ELSET, ELSET=PILLAR\n1\n")  # added to what *ELEMENT put there
    assert load(str(tmp_path / "twice.inp"), "mm").regions["pillar"].tolist() == [0, 1, 2]


def test_two_regions_of_a_mixed_mesh_have_their_own_density(tmp_path: Path) -> None:
    (tmp_path / "body.inp").write_text(INP)
    mesh = load(str(tmp_path / "body.inp"), "mm")
    heavy = Material.isotropic("heavy", SOFT.as_isotropic.young_pa, 3.0 * SOFT.density_kg_m3, SOFT.as_isotropic.poisson)
    system = assemble(mesh, {"plate": SOFT, "pillar": heavy})
    pillar = system.region_mass("pillar")
    assert pillar is not None
    kg = system.scale.mass_kg
    assert pillar.sum() * kg == pytest.approx(heavy.density_kg_m3 * (0.5 + 1.0 / 3.0) * 1e-9, rel=1e-12)
    assert system.mass.sum() * kg == pytest.approx(pillar.sum() * kg + SOFT.density_kg_m3 * 0.5e-9, rel=1e-12)


BAD: list[tuple[str, dict[str, str], Cells, str]] = [
    (
        "leaning",
        {},
        CUBES | {"pyramid": CUBES["pyramid"][:1], "tetra": [*CUBES["tetra"], [2, 10, 14, 16], [2, 14, 6, 16]]},
        "2 triangular face.* lean against a square one.*pyramid must stand between",
    ),
    ("orders", {"wedge": "wedge15"}, CUBES, "with and without middle nodes cannot be combined"),
    ("flat", {}, {"pyramid": [[1, 5, 13, 9, 13]]}, "inverted or flat"),
]


@pytest.mark.parametrize(("name", "types", "cells", "said"), BAD, ids=[name for name, *_ in BAD])
def test_what_does_not_fit_together_is_refused(
    name: str, types: dict[str, str], cells: Cells, said: str, tmp_path: Path
) -> None:
    with pytest.raises(MeshFileError, match=said):
        load(written(row(types, cells=cells), tmp_path / f"{name}.msh"))


@pytest.mark.parametrize("kind", list(CUBES))
def test_elements_given_inside_out_are_turned(kind: str, tmp_path: Path) -> None:
    """MED counts the corners of a volume in the mirror: the same body whichever way a file goes round."""
    mirrored = {"tetra": [0, 2, 1, 3], "hexahedron": [0, 3, 2, 1, 4, 7, 6, 5], "wedge": [0, 2, 1, 3, 5, 4]}
    order = (mirrored | {"pyramid": [0, 3, 2, 1, 4]})[kind]
    assert len(order) == CORNER_COUNT[kind]
    turned = CUBES | {kind: [[cell[i] for i in order] for cell in CUBES[kind]]}
    mesh = load(written(row(WITH_EDGES, cells=turned), tmp_path / "row.msh"))
    assert check_mesh(mesh).volume_m3 == pytest.approx(VOLUME_M3, rel=1e-12)
