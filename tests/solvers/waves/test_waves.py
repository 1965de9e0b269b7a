"""Paths, gaps and the folding of opposite faces."""

from __future__ import annotations

import numpy as np
import pytest

from geometry.errors import MeshError
from geometry.hex.boxes import Boxes, hex_mesh
from geometry.lattice import Lattice, PathSegment
from geometry.materials import MATERIALS
from geometry.mesh import Mesh
from solvers.fem.assembly import assemble
from solvers.waves import bloch
from solvers.waves.bloch import BlochCell, periodic_nodes
from solvers.waves.gaps import Gap, complete_gaps

ALUMINIUM = MATERIALS["aluminium"]
PITCH = (3e-3, 4e-3)


def cell(order: int = 2) -> Mesh:
    """A bare 3 x 4 x 2 mm cell."""
    lines = [np.linspace(0.0, edge, 3) for edge in (*PITCH, 2e-3)]
    return hex_mesh(Boxes(*lines, np.zeros((2, 2, 2), dtype=np.int64), ("plate",)), order)


def test_a_path_passes_its_corners_with_labels_and_its_length() -> None:
    path = Lattice.of_rows(*PITCH).path("GXMG", 4)
    edge = np.pi / np.array(PITCH)
    assert path.wavevectors.shape == (13, 2)
    assert [path.labels[i] for i in (0, 4, 8, 12)] == ["G", "X", "M", "G"]
    assert sum(label is not None for label in path.labels) == 4
    assert np.allclose(path.wavevectors[[0, 4, 8, 12]], [[0, 0], [edge[0], 0], edge, [0, 0]])
    assert path.arc[-1] == pytest.approx(edge.sum() + np.hypot(*edge))
    assert np.allclose(Lattice.of_rows(*PITCH).path("GY", 2).wavevectors[-1], [0.0, edge[1]])


@pytest.mark.parametrize("corners", ["GK", "G", ""])
def test_a_path_with_an_unknown_corner_or_too_few_is_refused(corners: str) -> None:
    with pytest.raises(ValueError, match="at least two of the corners G, X, M, Y"):
        Lattice.of_rows(*PITCH).path(corners, 3)


def test_a_finer_path_keeps_the_wavevectors_and_the_legs() -> None:
    path = Lattice.of_rows(*PITCH).path("GXMYG", 3)
    fine = path.finer(4)
    assert (fine.wavevectors[::4] == path.wavevectors).all() and fine.labels[::4] == path.labels
    assert np.allclose(np.diff(fine.arc)[:12], path.arc[3] / 12.0)
    assert path.segments == [
        PathSegment("G", "X", 0, 3),
        PathSegment("X", "M", 3, 6),
        PathSegment("M", "Y", 6, 9),
        PathSegment("Y", "G", 9, 12),
    ]
    assert [(segment.first, segment.last) for segment in fine.segments] == [(0, 12), (12, 24), (24, 36), (36, 48)]
    assert (path.finer(1).wavevectors == path.wavevectors).all()


def test_gaps_are_complete_only_when_no_wavevector_fills_them() -> None:
    bands = np.array([[1.0, 4.0, 9.0], [2.0, 5.0, 7.0]])
    assert complete_gaps(bands) == [Gap(1, 2, 2.0, 4.0), Gap(2, 3, 5.0, 7.0)]
    assert complete_gaps(np.vstack([bands, [4.5, 6.0, 8.0]])) == [Gap(2, 3, 6.0, 7.0)]
    assert complete_gaps(np.array([[1.0, 1.0005]])) == []


def test_every_node_beyond_the_cell_follows_its_partner_one_pitch_back() -> None:
    mesh = cell()
    pairs = periodic_nodes(mesh, Lattice.of_rows(*PITCH))
    step = np.column_stack([pairs.offset * np.array(PITCH), np.zeros(len(mesh.nodes))])
    assert np.allclose(mesh.nodes[pairs.master] + step, mesh.nodes, atol=1e-12)
    assert (pairs.offset[mesh.nodes_of("x+"), 0] == 1).all() and (pairs.offset[mesh.nodes_of("y+"), 1] == 1).all()
    assert len(np.unique(pairs.master)) == 4 * 4 * 5


def test_small_and_large_meshes_are_paired_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    directly = periodic_nodes(cell(), Lattice.of_rows(*PITCH))
    monkeypatch.setattr(bloch, "PAIRS", 0)
    by_tree = periodic_nodes(cell(), Lattice.of_rows(*PITCH))
    assert (directly.master == by_tree.master).all()


def test_faces_that_do_not_match_are_refused_with_the_place() -> None:
    mesh = cell()
    nodes = mesh.nodes.copy()
    moved = mesh.nodes_of("x+")[12]
    nodes[moved, 1] += 1e-5
    with pytest.raises(MeshError, match="no partner one pitch away"):
        periodic_nodes(Mesh(nodes, mesh.cells, "hex", 2, mesh.regions, mesh.faces), Lattice.of_rows(*PITCH))


def test_the_pencil_is_hermitian_and_carries_the_phase_of_each_side() -> None:
    mesh = cell()
    system = assemble(mesh, {"plate": ALUMINIUM})
    waves = BlochCell(system, Lattice.of_rows(*PITCH))
    k = np.array([230.0, -470.0])
    pencil, multiplicity = waves.pencil(k)
    assert multiplicity == 2
    pairs = periodic_nodes(mesh, Lattice.of_rows(*PITCH))
    masters, compact = np.unique(pairs.master, return_inverse=True)
    phase = np.exp(1j * (pairs.offset * np.array(PITCH)) @ k)
    fold = np.zeros((len(mesh.nodes), len(masters)), dtype=complex)
    fold[np.arange(len(mesh.nodes)), compact] = phase
    fold = np.kron(fold, np.eye(3))
    truth = fold.conj().T @ (system.stiffness @ fold)
    size = len(truth)
    result = pencil.stiffness.toarray()
    assert np.abs(result[:size, :size] + 1j * result[size:, :size] - truth).max() < 1e-12 * np.abs(truth).max()
    assert np.abs(result - result.T).max() < 1e-12 * np.abs(truth).max()


def test_phases_that_are_real_halve_the_problem_and_gamma_has_three_still_waves() -> None:
    waves = BlochCell(assemble(cell(), {"plate": ALUMINIUM}), Lattice.of_rows(*PITCH))
    for share in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)):
        pencil, multiplicity = waves.pencil(np.array(share) * np.pi / np.array(PITCH))
        assert (pencil.dof, multiplicity) == (waves.dof, 1)
    result = waves.frequencies(np.zeros(2), 5)
    assert (result[:3] < 1e-4 * result[3]).all() and result[3] > 1e5
