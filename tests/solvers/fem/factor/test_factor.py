"""Factorisations: every one that is installed solves, counts, foretells its memory and notices a singular matrix."""

from __future__ import annotations

import gc

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.linalg import eigh
from scipy.sparse.linalg import splu

from solvers import machine
from solvers.errors import SingularShift, SolverError, TooLarge
from solvers.fem import factor
from solvers.fem.assembly import assemble
from solvers.fem.eigen import modes_near
from solvers.fem.factor import Factoriser, _alike, _postordered, _quotient
from solvers.fem.solid import Pencil, constrain, free_mask
from solvers.machine import factorisations
from solvers.threads import threads
from tests.helpers import small_meshes as small

BODY = {"body": small.SOFT}
BACKENDS = factorisations()


def pencil(kind: str = "hex2") -> Pencil:
    """A small clamped block."""
    mesh = small.ALL[kind]()
    free = free_mask(mesh, ("touch",)) if mesh.faces else np.ones((len(mesh.nodes), 3), dtype=bool)
    return constrain(assemble(mesh, BODY), free)


def shifted(of: Pencil, share: float = 0.02) -> sp.csc_array:
    """K - sigma M, indefinite, sigma between two eigenvalues."""
    values = eigh(of.stiffness.toarray(), of.mass.toarray(), eigvals_only=True)
    place = int(share * len(values)) + 1
    return sp.csc_array(of.stiffness - 0.5 * (values[place - 1] + values[place]) * of.mass)


@pytest.mark.parametrize("backend", BACKENDS)
def test_one_and_many_right_hand_sides_are_solved(backend: str) -> None:
    matrix = shifted(pencil())
    made = Factoriser(backend)(matrix)
    many = np.random.default_rng(1).normal(size=(matrix.shape[0], 5))
    exact = np.linalg.solve(matrix.toarray(), many)
    kept = many.copy()
    assert np.allclose(made.solve(many), exact, rtol=1e-8, atol=1e-9 * np.abs(exact).max())
    for column in range(5):
        result = made.solve(many[:, column])
        assert result.shape == (matrix.shape[0],)
        assert np.allclose(result, exact[:, column], rtol=1e-8, atol=1e-9 * np.abs(exact).max())
    assert (many == kept).all(), "the right-hand side is the caller's"


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("kind", ["hex2", "tet2 bent", "hex3"])
def test_the_inertia_is_that_of_dense_algebra(backend: str, kind: str) -> None:
    matrix = shifted(pencil(kind), 0.1)
    negative = int((np.linalg.eigvalsh(matrix.toarray()) < 0.0).sum())
    assert negative > 5
    assert Factoriser(backend)(matrix).negative == negative


@pytest.mark.parametrize("backend", BACKENDS)
def test_every_factorisation_gives_the_same_eigenvalues(backend: str) -> None:
    body = pencil("hex3")
    result = modes_near(body, 3e5, 12, backend)
    truth = body.scale.frequency(eigh(body.stiffness.toarray(), body.mass.toarray(), eigvals_only=True))
    nearest = np.sort(truth[np.argsort(np.abs(truth - 3e5))[:12]])
    assert np.abs(result.frequency_hz / nearest - 1.0).max() < 1e-9
    assert result.count.expected == result.count.found == 12


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("fault", ["empty row", "free body", "on an eigenvalue"])
def test_a_singular_matrix_is_noticed(backend: str, fault: str) -> None:
    if fault == "empty row":
        matrix = sp.csc_array(sp.diags_array(np.append(np.arange(1.0, 40.0), 0.0), format="csc"))
        matrix.eliminate_zeros()
    elif fault == "free body":
        ring = sp.diags_array([np.full(39, -1.0), np.full(40, 2.0), np.full(39, -1.0)], offsets=[-1, 0, 1]).toarray()
        ring[0, 0] = ring[-1, -1] = 1.0  # a chain of equal springs that nothing holds
        matrix = sp.csc_array(ring)
    else:
        matrix = sp.csc_array(sp.diags_array(np.arange(-20.0, 21.0), format="csc"))
    with pytest.raises(SingularShift):
        Factoriser(backend)(matrix)


def test_two_patterns_and_a_singular_matrix_between_are_analysed_once_each(analysed: list[int]) -> None:
    full, factorise = shifted(pencil()), Factoriser("rslab")
    diagonal = sp.csc_array(sp.diags_array(np.arange(1.0, 42.0), format="csc"))
    singular = sp.csc_array((np.arange(-20.0, 21.0), diagonal.indices, diagonal.indptr), shape=diagonal.shape)
    for matrix in (full, diagonal):
        factorise(matrix)
    with pytest.raises(SingularShift):
        factorise(singular)
    for matrix in (diagonal, full):
        factorise(matrix)
    assert analysed == [full.nnz, diagonal.nnz]


@pytest.mark.parametrize("backend", BACKENDS)
def test_what_does_not_fit_is_refused_before_it_is_factorised(backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    matrix = shifted(pencil("hex3"))
    needed = Factoriser(backend)(matrix).foreseen_bytes
    monkeypatch.setattr(machine, "room_bytes", lambda: 0.99 * needed)
    started: list[str] = []
    monkeypatch.setattr(factor, "splu", lambda *a, **k: started.append("splu"))
    with pytest.raises(
        TooLarge, match=rf"factorising {matrix.shape[0]} degrees of freedom needs about .* GiB are free"
    ):
        Factoriser(backend)(matrix)
    assert not started
    monkeypatch.undo()
    monkeypatch.setattr(machine, "room_bytes", lambda: 1.01 * needed)
    assert Factoriser(backend)(matrix).negative > 0


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_factor_tells_its_memory_and_gives_it_back(backend: str) -> None:
    matrix = shifted(pencil("hex3"))
    made = Factoriser(backend)(matrix)
    filled = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}).L.nnz
    assert 6 * filled < made.memory_bytes < 200 * filled, "eight bytes an entry, give or take another ordering"
    made.free()
    with pytest.raises(AttributeError):
        made.solve(np.ones(matrix.shape[0]))
    again = Factoriser(backend)(matrix)
    del again
    gc.collect()  # a factor that nobody freed is freed with its last name


@pytest.mark.parametrize("backend", BACKENDS)
def test_two_factors_of_one_pattern_live_side_by_side(backend: str) -> None:
    body = pencil()
    factorise = Factoriser(backend)
    right = np.cos(np.arange(body.dof))
    first, second = shifted(body, 0.02), shifted(body, 0.3)
    factors = [factorise(first), factorise(second)]
    for matrix, made in zip((first, second), factors, strict=True):
        assert np.linalg.norm(matrix @ made.solve(right) - right) < 1e-8 * np.linalg.norm(right)


def test_a_wrong_solve_is_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(factor.SuperLU, "solve", lambda self, right: 1.001 * self._lu.solve(right))
    with pytest.raises(SingularShift, match="backward error"):
        Factoriser("superlu")(shifted(pencil()))


def test_the_variable_names_the_factorisation(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ANTINODE_FACTOR", "superlu")
    assert Factoriser().backend == "superlu"
    monkeypatch.setenv("ANTINODE_FACTOR", "abacus")
    with pytest.raises(SolverError, match=r"'abacus' is not installed; use .*superlu"):
        Factoriser()


@pytest.mark.parametrize(("installed", "first"), [(("rslab",), "rslab"), ((), "superlu")])
def test_rslab_is_taken_where_it_is_and_superlu_is_always_there(
    installed: tuple[str, ...], first: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine.importlib.util, "find_spec", lambda name: name if name in installed else None)
    monkeypatch.delenv("ANTINODE_FACTOR", raising=False)
    machine.factorisations.cache_clear()
    try:
        assert machine.factorisations() == (*installed, "superlu")
        assert Factoriser().backend == first
    finally:
        machine.factorisations.cache_clear()


def test_threads_are_those_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ANTINODE_THREADS", "3")
    assert threads() == 3
    monkeypatch.delenv("ANTINODE_THREADS")
    assert threads() >= 1


def filled_entries(pattern: np.ndarray, place: np.ndarray, size: np.ndarray) -> int:
    """Entries of L by elimination itself, each vertex standing for `size` alike degrees of freedom."""
    order = np.argsort(place)
    lower, weight = np.tril(pattern[order][:, order]), size[order]
    for k in range(len(size)):
        below = np.flatnonzero(lower[k + 1 :, k]) + k + 1
        lower[np.ix_(below, below)] |= np.tril(np.ones((len(below), len(below)), dtype=bool))
    full = sum(weight[k] * weight[np.flatnonzero(lower[:, k])].sum() for k in range(len(size)))
    return int(full - (weight * (weight - 1) // 2).sum())


@pytest.mark.parametrize("count", [1, 2, 7, 30, 90])
@pytest.mark.parametrize("density", [0.0, 0.02, 0.1, 0.4])
def test_the_size_of_the_factor_is_counted_exactly(count: int, density: float) -> None:
    draw = np.random.default_rng(count)
    for _ in range(4):
        pattern = draw.random((count, count)) < density
        pattern = pattern | pattern.T | np.eye(count, dtype=bool)
        place, size = draw.permutation(count), draw.integers(1, 5, count)
        after, entries = _postordered(sp.csc_array(pattern), place, size)
        assert entries == filled_entries(pattern, place, size)
        assert sorted(after) == list(range(count))
        assert filled_entries(pattern, after, size) == entries, "the postorder fills as little"


@pytest.mark.parametrize("kind", ["hex3", "tet2 bent"])
def test_superlus_fill_is_the_one_foretold(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(factor, "DENSE", 10)
    matrix = shifted(pencil(kind))
    plan = factor._analyse(matrix)
    made = factor.SuperLU(matrix, plan)
    assert plan.order is not None
    assert made._lu.L.nnz <= plan.entries < 1.001 * made._lu.L.nnz  # equal but for entries that cancel
    right = np.cos(np.arange(matrix.shape[0]))
    assert np.linalg.norm(matrix @ made.solve(right) - right) < 1e-8 * np.linalg.norm(right)
    assert made.negative == int((np.linalg.eigvalsh(matrix.toarray()) < 0.0).sum())


@pytest.mark.parametrize("name", factorisations())
def test_another_pattern_is_analysed_anew(name: str) -> None:
    block = shifted(pencil("hex3"))
    order = np.random.default_rng(1).permutation(block.shape[0])
    as_large = sp.csc_array(block[order][:, order])
    factorise = Factoriser(name)
    for matrix in (block, as_large, shifted(pencil("tet2 bent")), block):
        factor, right = factorise(matrix), np.cos(np.arange(matrix.shape[0]))
        assert np.linalg.norm(matrix @ factor.solve(right) - right) < 1e-8 * np.linalg.norm(right)
        assert factor.negative == int((np.linalg.eigvalsh(matrix.toarray()) < 0.0).sum())
        assert factor.foreseen_bytes == Factoriser(name)(matrix).foreseen_bytes


def test_degrees_of_freedom_with_the_same_couplings_are_alike() -> None:
    block = np.kron(np.array([[1, 1, 0], [1, 1, 1], [0, 1, 1]]), np.ones((3, 3)))
    label, size = _alike(sp.csc_array(block))
    assert label.tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2] and size.tolist() == [3, 3, 3]
    assert _quotient(sp.csc_array(block), label, 3).toarray().tolist() == [[1, 1, 0], [1, 1, 1], [0, 1, 1]]


@pytest.mark.parametrize("what", ["stored", "filled"])
def test_more_entries_than_superlu_can_count_are_refused(what: str) -> None:
    matrix = sp.csc_array(sp.eye_array(4, format="csc"))
    plan = factor.Ordering(None, 2**31 if what == "filled" else 5, factor._pattern_of(matrix))
    if what == "stored":
        pattern = {"indptr": matrix.indptr, "indices": matrix.indices}
        matrix = type("Huge", (), {"shape": (4, 4), "nnz": 80_000_000, **pattern})()
    with pytest.raises(TooLarge, match=r"more than SuperLU can count: install rslab"):
        factor.SuperLU(matrix, plan)
