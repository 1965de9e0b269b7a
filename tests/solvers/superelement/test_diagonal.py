"""The mirror x <-> y of a square cell: a class turned over equals the class reduced, and what is not alike is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh, subspace_angles

from geometry.hex.boxes import hex_mesh, panel_boxes
from geometry.hex.scenes import HexSettings
from geometry.layout import Pillar
from geometry.materials import MATERIALS, Stack
from geometry.tiling import Panel
from solvers.fem.assembly import Scale, System, assemble
from solvers.plates.assembled import Reductions
from solvers.superelement import reduction
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.reduction import reduce_cell
from solvers.superelement.symmetry import DiagonalSector, diagonal_mirror

STACK = Stack.of(2e-3, MATERIALS["aluminium"])

ALUMINIUM = MATERIALS["aluminium"]
PILLAR = Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM)
FACE = Interface(3, 2)
SQUARE = Panel((-2e-3, -2e-3), (2e-3, 2e-3), (0.0, 0.0), (0, 1))


def system(panel: Panel = SQUARE, stiffer: bool = False) -> System:
    """A quarter cell, or one with a stiffer element off the diagonal."""
    mesh = hex_mesh(panel_boxes(panel, STACK, PILLAR, HexSettings(2, 2e-3, 1)), 2)
    materials = {"plate": ALUMINIUM, "pillar": ALUMINIUM, "odd": MATERIALS["steel"]}
    if stiffer:
        corner = np.argmax(mesh.nodes[mesh.cells].mean(axis=1) @ [1.0, -1.0, 0.0])
        regions = {name: np.setdiff1d(cells, corner) for name, cells in mesh.regions.items()}
        mesh = replace(mesh, regions=regions | {"odd": np.array([corner])})
    return assemble(mesh, materials, Scale.of(2e-3, ALUMINIUM))


@pytest.mark.slow
def test_a_class_turned_over_is_the_class_reduced(monkeypatch: pytest.MonkeyPatch) -> None:
    turned = reduce_cell(system(), FACE, 300e3, (0, 1))
    monkeypatch.setattr(reduction, "diagonal_mirror", lambda system: None)
    direct = reduce_cell(system(), FACE, 300e3, (0, 1))
    assert np.array_equal(turned.fixed_parity, direct.fixed_parity)
    assert np.allclose(turned.fixed_hz, direct.fixed_hz, rtol=1e-10)
    ours, theirs = (eigh(c.stiffness, c.mass, eigvals_only=True)[6:] for c in (turned, direct))
    assert np.allclose(ours, theirs, rtol=1e-8)
    boundary = slice(0, FACE.count)
    largest = np.abs(direct.stiffness).max()
    assert np.abs(turned.stiffness[boundary, boundary] - direct.stiffness[boundary, boundary]).max() < 1e-10 * largest
    shapes = [c.touch.matrix[:, 0, FACE.count :][:, c.fixed_parity[:, 0] == -1] for c in (turned, direct)]
    assert subspace_angles(*shapes).max() < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("split", [pytest.param("the finer mesh", marks=pytest.mark.slow), "its coarser ones"])
def test_a_mesh_tells_its_error_to_one_that_the_diagonal_splits_otherwise(
    split: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sides that differ in the tenth digit are alike to one mesh and not to the other: their functions are still the same."""
    settings = ReductionSettings(FACE, 150e3, HexSettings(3, 4e-3, 1))
    panel = Reductions(Stack.of(2e-3, ALUMINIUM), PILLAR, settings)
    alike = panel.cell(SQUARE).mesh_error
    nodes = len(panel._mesh(SQUARE, settings.hexahedra).mesh.nodes)

    def seen(body: System) -> np.ndarray | None:
        finer = len(body.mesh.nodes) == nodes
        return diagonal_mirror(body) if finer == (split == "the finer mesh") else None

    monkeypatch.setattr(reduction, "diagonal_mirror", seen)
    otherwise = panel.cell(SQUARE).mesh_error
    assert alike and otherwise
    for one, other in ((alike.order_stiffness, otherwise.order_stiffness), (alike.layer_mass, otherwise.layer_mass)):
        own = slice(0, FACE.count)
        assert np.abs((one - other)[own, own]).max() < 1e-8 * np.abs(one).max()


@pytest.mark.parametrize("sign", [1, -1])
def test_the_halves_are_what_the_mirror_leaves_alone_and_what_it_turns_over(sign: int) -> None:
    body = system()
    image, inside = diagonal_mirror(body), np.ones_like(body.mesh.nodes, dtype=bool)
    inside[body.mesh.nodes_of("x-"), 0] = inside[body.mesh.nodes_of("y-"), 1] = False  # even about both axes
    half = DiagonalSector(body, image, inside, sign)
    fold = half.fold.toarray()
    assert np.allclose(fold.T @ fold, np.eye(half.pencil.dof))
    assert not fold[~inside.ravel()].any()
    fields = fold.reshape(-1, 3, half.pencil.dof)
    assert np.array_equal(fields[image][:, [1, 0, 2]], sign * fields)
    mass = np.kron(body.mass.toarray(), np.eye(3))
    for result, whole in ((half.pencil.stiffness, body.stiffness.toarray()), (half.pencil.mass, mass)):
        truth = fold.T @ whole @ fold
        assert np.abs(result.toarray() - truth).max() < 1e-12 * np.abs(truth).max()
    assert np.allclose(half.restrict(fold), np.eye(half.pencil.dof))


def test_both_halves_together_are_the_whole() -> None:
    body = system()
    inside = np.ones_like(body.mesh.nodes, dtype=bool)
    halves = [DiagonalSector(body, diagonal_mirror(body), inside, sign).fold.toarray() for sign in (1, -1)]
    assert np.allclose(np.hstack(halves).T @ np.hstack(halves), np.eye(inside.size))


def test_unequal_sides_have_no_diagonal_mirror() -> None:
    assert diagonal_mirror(system()) is not None
    assert diagonal_mirror(system(replace(SQUARE, high=(3e-3, 2e-3), low=(-3e-3, -2e-3)))) is None


def test_equal_nodes_with_unequal_materials_have_none() -> None:
    assert diagonal_mirror(system(stiffer=True)) is None
