"""VTU files read back by VTK (through pyvista) and by meshio."""

import meshio
import numpy as np
import pytest
import pyvista
from vtkmodules.vtkCommonCore import mutable

from geometry.formats.vtk import write_vtu
from geometry.hex.boxes import cell_boxes, hex_mesh
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS
from geometry.mesh import Mesh, cell_volumes

ALUMINIUM = MATERIALS["aluminium"]
DESIGN = Design(
    115.5e-3,
    20e-3,
    2e-3,
    8,
    ALUMINIUM,
    Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM),
    4e-3,
    4e-3,
    3,
    25e-3,
)


def tetrahedra(order: int) -> Mesh:
    """Five tetrahedra in a unit cube."""
    corners = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
    cells = np.array([[0, 1, 2, 4], [1, 3, 2, 7], [1, 4, 7, 5], [2, 4, 6, 7], [1, 2, 4, 7]])
    straight = Mesh(corners, cells, "tet", 1)
    cells = np.where((cell_volumes(straight) < 0)[:, None], cells[:, [1, 0, 2, 3]], cells)
    if order == 1:
        return Mesh(corners, cells, "tet", 1, {"left": np.array([0, 1]), "right": np.array([2, 3, 4])})
    edges = np.sort(cells[:, [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]]].reshape(-1, 2), axis=1)
    unique, number = np.unique(edges, axis=0, return_inverse=True)
    nodes = np.vstack([corners, corners[unique].mean(axis=1)])
    return Mesh(nodes, np.hstack([cells, 8 + number.reshape(-1, 6)]), "tet", 2)


def hexahedra(order: int) -> Mesh:
    return hex_mesh(cell_boxes(DESIGN, HexSettings(order=order, size_m=2e-3, layers=1)), order)


MESHES = {f"tet{order}": tetrahedra(order) for order in (1, 2)} | {
    f"hex{order}": hexahedra(order) for order in (1, 2, 3, 4)
}


@pytest.mark.parametrize("name", MESHES)
def test_vtk_reads_the_volume_of_every_cell(tmp_path, name):
    mesh = MESHES[name]
    write_vtu(mesh, tmp_path / "a.vtu")
    grid = pyvista.read(tmp_path / "a.vtu")
    volumes = grid.compute_cell_sizes()["Volume"]
    assert volumes == pytest.approx(cell_volumes(mesh), rel=1e-9)
    assert volumes.min() > 0.0


@pytest.mark.parametrize("name", MESHES)
def test_vtk_interpolates_a_polynomial_of_the_cells_order_exactly(tmp_path, name):
    """Kills a wrong node order and Gauss-Lobatto nodes passed off as equally spaced ones."""
    mesh = MESHES[name]
    scale = np.abs(mesh.nodes).max()

    def exact(points):
        x, y, z = points.T / scale
        return x**mesh.order + 2.0 * y ** (mesh.order - 1) * z - 3.0 * z

    write_vtu(mesh, tmp_path / "a.vtu", {"f": exact(mesh.nodes)})
    grid = pyvista.read(tmp_path / "a.vtu")
    rng = np.random.default_rng(1)
    for number in rng.integers(0, grid.n_cells, 20):
        cell = grid.GetCell(int(number))
        inside, weights, place = rng.dirichlet(np.ones(4))[:3], [0.0] * cell.GetNumberOfPoints(), [0.0] * 3
        cell.EvaluateLocation(mutable(0), inside, place, weights)
        values = grid["f"][[cell.GetPointId(i) for i in range(cell.GetNumberOfPoints())]]
        assert np.dot(weights, values) == pytest.approx(float(exact(np.array([place]))[0]), abs=1e-12)


def test_fields_regions_and_complex_parts_survive(tmp_path):
    mesh = hexahedra(2)
    wave = np.exp(1j * mesh.nodes / 1e-3)
    write_vtu(mesh, tmp_path / "a.vtu", {"u": wave, "number": np.arange(len(mesh.nodes))})
    back = meshio.read(tmp_path / "a.vtu")
    assert back.point_data["u_re"] + 1j * back.point_data["u_im"] == pytest.approx(wave)
    assert back.point_data["number"] == pytest.approx(np.arange(len(mesh.nodes)))
    (region,) = back.cell_data["region"]
    for index, cells in enumerate(mesh.regions.values()):
        assert (region[cells] == index).all()
    assert back.points == pytest.approx(mesh.nodes)


def test_a_field_of_the_wrong_length_is_refused_and_writes_nothing(tmp_path):
    with pytest.raises(ValueError, match="field 'u' has 3 rows"):
        write_vtu(hexahedra(1), tmp_path / "a.vtu", {"u": np.zeros(3)})
    assert list(tmp_path.iterdir()) == []
