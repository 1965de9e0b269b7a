"""What a mesh is checked for: planted faults are refused, and the element, node or volume is named."""

from __future__ import annotations

import numpy as np
import pytest

from geometry.errors import MeshError
from geometry.hex.boxes import Boxes, hex_mesh
from geometry.mesh import Mesh, cell_volumes, check_mesh, is_affine, jacobians


def block(order: int = 1, cuts: int = 2) -> Mesh:
    """A 2 x 1 x 1 mm block."""
    x, y = np.linspace(0.0, 2e-3, cuts + 1), np.linspace(0.0, 1e-3, cuts + 1)
    return hex_mesh(Boxes(x, y, y, np.zeros((cuts,) * 3, dtype=np.int64), ("plate",)), order)


def without_spans(mesh: Mesh, nodes: np.ndarray | None = None, cells: np.ndarray | None = None) -> Mesh:
    """The same mesh as a mesher would hand it over."""
    return Mesh(
        mesh.nodes if nodes is None else nodes,
        mesh.cells if cells is None else cells,
        mesh.kind,
        mesh.order,
        mesh.regions,
        mesh.faces,
    )


def test_a_sound_mesh_passes_and_reports_its_volume() -> None:
    report = check_mesh(block(2), 2e-9, tolerance=1e-12)
    assert (report.cells, report.nodes) == (8, 125)
    assert report.volume_m3 == pytest.approx(2e-9, rel=1e-12)


@pytest.mark.parametrize("order", [1, 2])
def test_an_inverted_element_is_named_with_its_place(order: int) -> None:
    mesh = block(order)
    cells = mesh.cells.copy()
    grid = cells[5].reshape((order + 1,) * 3)
    cells[5] = grid[:, :, ::-1].ravel()
    centre = mesh.nodes[cells[5]].mean(axis=0) * 1e3
    with pytest.raises(MeshError, match=r"element 5 at \(") as fault:
        check_mesh(without_spans(mesh, cells=cells))
    assert ", ".join(f"{c:.3f}" for c in centre) in str(fault.value)
    assert "inverted or flat" in str(fault.value)


def test_an_element_inverted_at_one_corner_only_is_refused() -> None:
    mesh = block(1, cuts=1)
    nodes = mesh.nodes.copy()
    nodes[-1] = nodes.mean(axis=0) * 0.3
    with pytest.raises(MeshError, match="element 0"):
        check_mesh(without_spans(mesh, nodes))


def test_a_flat_tetrahedron_is_refused() -> None:
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 1]])
    with pytest.raises(MeshError, match="element 1 at"):
        check_mesh(Mesh(nodes, np.array([[0, 1, 2, 4], [0, 1, 2, 3]]), "tet", 1))


def test_an_orphan_node_is_named() -> None:
    mesh = block()
    with pytest.raises(MeshError, match=r"1 orphan node\(s\), the first is node 27"):
        check_mesh(without_spans(mesh, np.vstack([mesh.nodes, [0.0, 0.0, 5e-3]])))


def test_a_wrong_volume_is_refused_with_the_difference() -> None:
    with pytest.raises(MeshError, match=r"differs from the solid's by \+1\.00e-02, allowed is 1e-03"):
        check_mesh(block(), 2e-9 / 1.01)


def test_a_missing_element_shows_in_the_volume() -> None:
    mesh = block()
    used, cells = np.unique(mesh.cells[1:], return_inverse=True)
    with pytest.raises(MeshError, match=r"differs from the solid's by -1\.25e-01"):
        check_mesh(Mesh(mesh.nodes[used], cells.reshape(7, 8), "hex", 1), 2e-9)


def test_a_node_that_is_not_a_number_is_refused() -> None:
    mesh = block()
    nodes = mesh.nodes.copy()
    nodes[3, 1] = np.nan
    with pytest.raises(MeshError, match="not a number"):
        check_mesh(without_spans(mesh, nodes))


def test_an_unknown_face_is_refused_with_the_names_there_are() -> None:
    with pytest.raises(MeshError, match=r"no face 'foot'; it has top, touch, x\+, x-, y\+, y-"):
        block().nodes_of("foot")


def test_jacobians_of_a_box_are_its_half_edges() -> None:
    mesh = block(3)
    result = jacobians(mesh, np.arange(8), mesh.element.quadrature.points)
    assert np.allclose(result, np.diag([0.5e-3, 0.25e-3, 0.25e-3]), atol=1e-15)


def test_affine_elements_are_told_from_curved_ones() -> None:
    mesh = without_spans(block(2))
    sheared = mesh.nodes @ np.array([[1.0, 0.2, 0], [0, 1, 0.3], [0, 0, 1]])
    assert is_affine(without_spans(mesh, sheared)).all()
    nodes = mesh.nodes.copy()
    moved = mesh.cells[0, 13]  # the middle node of the first element only
    nodes[moved] += 1e-5
    assert np.array_equal(np.flatnonzero(~is_affine(without_spans(mesh, nodes))), [0])


def test_moving_an_inner_node_keeps_the_whole_volume() -> None:
    mesh = block(2)
    nodes = mesh.nodes.copy()
    inner = np.argmin(np.linalg.norm(nodes - [1e-3, 0.5e-3, 0.5e-3], axis=1))
    nodes[inner] += [5e-5, -4e-5, 3e-5]
    bent = without_spans(mesh, nodes)
    assert cell_volumes(bent).sum() == pytest.approx(2e-9, rel=1e-12)
    assert np.abs(cell_volumes(bent) - 2.5e-10).max() > 1e-12


def test_the_hash_follows_every_input() -> None:
    mesh = block()
    nodes = mesh.nodes.copy()
    nodes[0, 0] -= 1e-18
    hashes = {mesh.sha256, without_spans(mesh, nodes).sha256, Mesh(mesh.nodes, mesh.cells, "hex", 1).sha256}
    assert len(hashes) == 3
    assert block().sha256 == mesh.sha256
