"""Stiffness and mass: patch test, rigid-body modes, total mass, one path against the other, and scikit-fem as oracle."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse.linalg import norm

from geometry.materials import Material
from geometry.mesh import Mesh, is_affine
from solvers.fem import assembly
from solvers.fem.assembly import Scale, assemble
from solvers.fem.solid import mass_rows, rigid_body_modes
from tests.helpers import small_meshes as small

SI = Scale(1.0, 1.0, 1.0)
BODY = {"body": small.SOFT}
KINDS = sorted(small.ALL)


def engineer_stress(material: Material, gradient: np.ndarray) -> np.ndarray:
    """Hooke's law from E and nu alone: eps = ((1 + nu) sigma - nu tr(sigma) I) / E, solved for sigma (3, 3), Pa."""
    young, poisson = material.as_isotropic.young_pa, material.as_isotropic.poisson
    strain = (gradient + gradient.T) / 2.0
    compliance = (np.eye(6) * (1.0 + poisson)) / young
    compliance[:3, :3] -= poisson / young
    flat = np.linalg.solve(compliance, strain[[0, 1, 2, 1, 0, 0], [0, 1, 2, 2, 2, 1]])
    return flat[np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])]


def tractions(mesh: Mesh, stress: np.ndarray) -> np.ndarray:
    """Nodal forces int N_a sigma n over the box's sides = int grad N_a . sigma over the body, shape (n, 3)."""
    from geometry.mesh import jacobians

    rule = mesh.element.quadrature
    _, slope = mesh.element.shape(rule.points)
    jacobian = jacobians(mesh, np.arange(len(mesh.cells)), rule.points)
    weight = np.linalg.det(jacobian) * rule.weights
    physical = np.einsum("eqkm,qam->eqak", np.linalg.inv(jacobian), slope)
    forces = np.einsum("eq,eqak,kj->eaj", weight, physical, stress)
    total = np.zeros_like(mesh.nodes)
    np.add.at(total, mesh.cells, forces)
    return total


@pytest.mark.parametrize("kind", KINDS)
def test_patch_a_linear_displacement_is_in_equilibrium_and_meets_hookes_tractions(kind: str) -> None:
    mesh = small.ALL[kind]()
    inner = ~small.on_boundary(mesh)
    assert inner.any(), "a patch test needs inner nodes"
    gradient = np.random.default_rng(1).normal(size=(3, 3))
    force = (assemble(mesh, BODY, SI).stiffness @ (mesh.nodes @ gradient.T).ravel()).reshape(-1, 3)
    scale = np.abs(force).max()
    assert np.abs(force[inner]).max() < 1e-11 * scale
    expected = tractions(mesh, engineer_stress(small.SOFT, gradient))
    assert np.abs(force - expected).max() < 1e-11 * scale


@pytest.mark.parametrize("kind", KINDS)
def test_rigid_motions_meet_no_force(kind: str) -> None:
    mesh = small.ALL[kind]()
    stiffness = assemble(mesh, BODY).stiffness
    motions = rigid_body_modes(mesh.nodes).reshape(-1, 6)
    assert np.linalg.norm(stiffness @ motions) <= 1e-12 * norm(stiffness) * np.linalg.norm(motions)


@pytest.mark.parametrize("kind", KINDS)
def test_total_mass_is_density_times_volume(kind: str) -> None:
    mass = assemble(small.ALL[kind](), BODY, SI).mass
    assert mass.sum() == pytest.approx(small.SOFT.density_kg_m3 * np.prod(small.EDGES_M), rel=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_matrices_are_symmetric_and_the_mass_positive(kind: str) -> None:
    system = assemble(small.ALL[kind](), BODY)
    for matrix in (system.stiffness, system.mass):
        assert norm(matrix - matrix.T) <= 1e-14 * norm(matrix)
    assert np.linalg.eigvalsh(system.mass.toarray()).min() > 0.0


@pytest.mark.parametrize("kind", ["hex2", "hex3", "tet2"])
def test_the_affine_path_equals_the_quadrature_path(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = small.ALL[kind]()
    fast = assemble(mesh, BODY)
    monkeypatch.setattr("solvers.fem.assembly.is_affine", lambda m: np.zeros(len(m.cells), dtype=bool))
    slow = assemble(small.plain(mesh), BODY)
    for a, b in ((fast.stiffness, slow.stiffness), (fast.mass, slow.mass)):
        assert norm(a - b) <= 1e-13 * norm(a)


def test_boxes_equal_the_same_elements_given_as_plain_nodes_and_when_turned() -> None:
    mesh = small.hexes(2)
    turn, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    scale = Scale(1e-3, 1e9, 1e3)
    straight = assemble(mesh, BODY, scale)
    turned = assemble(small.plain(mesh, mesh.nodes @ turn.T), BODY, scale)
    assert is_affine(turned.mesh).all()
    block = np.kron(np.eye(len(mesh.nodes)), turn)
    assert np.abs(block @ straight.stiffness.toarray() @ block.T - turned.stiffness.toarray()).max() < 1e-12 * norm(
        straight.stiffness
    )


def test_many_curved_elements_are_the_sum_of_their_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = small.distorted(2)
    whole = assemble(mesh, BODY)
    monkeypatch.setattr("solvers.fem.assembly.CHUNK_VALUES", 90 * 27**2)  # three elements a time
    cut = assemble(mesh, BODY)
    assert norm(whole.stiffness - cut.stiffness) <= 1e-14 * norm(whole.stiffness)
    assert norm(whole.mass - cut.mass) <= 1e-14 * norm(whole.mass)


def test_regions_carry_their_own_material_and_region_masses_add_up() -> None:
    mesh = small.hexes(2)
    halves = {"plate": np.arange(4), "pillar": np.arange(4, 8)}
    split = Mesh(mesh.nodes, mesh.cells, "hex", 2, halves, mesh.faces, mesh.spans)
    heavy = Material.isotropic("heavy", 3.0 * small.SOFT.as_isotropic.young_pa, 5.0 * small.SOFT.density_kg_m3, 0.2)
    system = assemble(split, {"plate": small.SOFT, "pillar": heavy}, SI)
    plate, pillar = system.region_mass("plate"), system.region_mass("pillar")
    assert plate is not None and pillar is not None and system.region_mass("foot") is None
    assert norm(plate + pillar - system.mass) < 1e-14 * norm(system.mass)
    volumes = mesh.spans.prod(axis=1)  # type: ignore[union-attr]
    assert pillar.sum() == pytest.approx(heavy.density_kg_m3 * volumes[4:].sum(), rel=1e-12)
    with pytest.raises(KeyError):
        assemble(split, {"plate": small.SOFT})
    linear = np.random.default_rng(4).normal(size=(3, 3))
    field = (mesh.nodes @ linear.T).ravel()
    energy = sum(
        np.sum(engineer_stress(m, linear) * linear) * volumes[halves[n]].sum()
        for n, m in (("plate", small.SOFT), ("pillar", heavy))
    )
    assert field @ (system.stiffness @ field) == pytest.approx(energy, rel=1e-11)


def test_the_elasticity_tensor_is_hookes_law() -> None:
    gradient = np.random.default_rng(6).normal(size=(3, 3))
    result = np.einsum("ikjl,jl->ik", small.SOFT.tensor_pa, gradient)
    assert np.allclose(result, engineer_stress(small.SOFT, gradient), rtol=1e-13)


def test_the_scale_changes_no_frequency() -> None:
    mesh, result = small.tets(2, (1, 1, 1)), []
    for scale in (None, SI, Scale(3e-4, 7e7, 4e3)):
        system = assemble(mesh, BODY, scale)
        mass = np.kron(system.mass.toarray(), np.eye(3))
        result.append(system.scale.frequency(eigh(system.stiffness.toarray(), mass, eigvals_only=True)[6:]))
    assert np.allclose(result[1], result[0], rtol=1e-9) and np.allclose(result[2], result[0], rtol=1e-9)
    assert SI.eigenvalue(float(SI.frequency(np.array([7.0]))[0])) == pytest.approx(7.0, rel=1e-14)


@pytest.mark.parametrize("kind", ["tet1", "tet2"])
def test_eigenvalues_agree_with_scikit_fem(kind: str) -> None:
    skfem = pytest.importorskip("skfem", reason="scikit-fem, the oracle of this test, is not installed (extra: dev)")
    from skfem.helpers import ddot, dot, eye, sym_grad, trace

    order = int(kind[-1])
    ours = small.tets(order)
    corners = small.tets(1)
    mesh = skfem.MeshTet(corners.nodes.T / 1e-3, corners.cells.T)
    shape = skfem.ElementTetP1() if order == 1 else skfem.ElementTetP2()
    basis = skfem.Basis(mesh, skfem.ElementVector(shape), intorder=4)
    young, nu = 1.0, small.SOFT.as_isotropic.poisson
    mu, lame = young / (2.0 * (1.0 + nu)), young * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))

    @skfem.BilinearForm
    def stiffness(u, v, w):  # type: ignore[no-untyped-def]
        strain = sym_grad(u)
        return ddot(2.0 * mu * strain + lame * eye(trace(strain), 3), sym_grad(v))

    @skfem.BilinearForm
    def mass(u, v, w):  # type: ignore[no-untyped-def]
        return dot(u, v)

    oracle = eigh(stiffness.assemble(basis).toarray(), mass.assemble(basis).toarray(), eigvals_only=True)
    system = assemble(ours, BODY, Scale.of(1e-3, small.SOFT))
    result = eigh(system.stiffness.toarray(), np.kron(system.mass.toarray(), np.eye(3)), eigvals_only=True)
    assert len(result) == len(oracle)
    assert np.abs(result[6:] / oracle[6:] - 1.0).max() < 1e-9


def test_rows_of_the_mass_of_three_components_are_those_of_the_kronecker_product() -> None:
    system = assemble(small.ALL[KINDS[0]](), BODY)
    rows = np.random.default_rng(0).permutation(3 * len(system.mesh.nodes))[:7]
    truth = np.kron(system.mass.toarray(), np.eye(3))[rows]
    assert np.array_equal(mass_rows(system, rows).toarray(), truth)


@pytest.mark.parametrize("kind", KINDS)
def test_chunks_change_no_digit(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Entries are sorted and summed in the same order, however few at a time."""
    mesh = small.ALL[kind]()
    whole = assemble(mesh, BODY, SI)
    monkeypatch.setattr(assembly, "SORTED_VALUES", 300)
    parts = assemble(mesh, BODY, SI)
    for one, other in ((whole.stiffness, parts.stiffness), (whole.mass, parts.mass)):
        for name in ("indptr", "indices", "data"):
            assert np.array_equal(getattr(one, name), getattr(other, name))
