"""scipy's factorisation alone: what elimination down the diagonal loses is won back, and a count is right or refused."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.linalg import eigh

from solvers.errors import SingularShift
from solvers.fem import factor
from solvers.fem.assembly import Scale, assemble
from solvers.fem.eigen import PlainPencil, Shared, factor_near, modes_near
from solvers.fem.factor import Factor, Factoriser, SuperLU
from solvers.fem.solid import Pencil, constrain, free_mask
from solvers.machine import factorisations
from tests.helpers import small_meshes as small

EPSILON = float(np.finfo(float).eps)
CHAIN = 40


def small_pivots(pivot: float) -> sp.csc_array:
    """A regular matrix, half of its eigenvalues negative, in which every order of elimination begins with `pivot`."""
    ones = np.ones(CHAIN - 1)
    return sp.csc_array(sp.diags_array([ones, np.full(CHAIN, pivot), ones], offsets=[-1, 0, 1]))


def backward_error(matrix: sp.csc_array, solution: np.ndarray, right: np.ndarray) -> float:
    """Normwise, in the maximum norm, of the worst column."""
    norm = float(abs(matrix).sum(axis=0).max())
    defect = np.abs(matrix @ solution - right).max(axis=0)
    return float((defect / (norm * np.abs(solution).max(axis=0) + np.abs(right).max(axis=0))).max())


def clamped_block() -> Pencil:
    """A small clamped body."""
    mesh = small.hexes(2, (2, 2, 2), small.EDGES_M)
    return constrain(assemble(mesh, {"body": small.SOFT}), free_mask(mesh, ("touch",)))


@pytest.mark.parametrize("pivot", [1e-3, 1e-6, 1e-9, 1e-12])
def test_digits_lost_to_a_small_pivot_are_won_back(pivot: float) -> None:
    matrix = small_pivots(pivot)
    right = np.random.default_rng(2).standard_normal((CHAIN, 4))
    made = SuperLU(matrix)
    assert backward_error(matrix, made._substituted(right), right) > 0.01 * EPSILON / pivot, "there is something to win"
    assert backward_error(matrix, made.solve(right), right) < 2.0 * EPSILON
    assert made.negative == CHAIN // 2


def test_without_refinement_such_a_solve_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(factor, "SWEEPS", 0)
    with pytest.raises(SingularShift, match="refinement ends at a backward error"):
        SuperLU(small_pivots(1e-9)).solve(np.ones(CHAIN))


def test_a_refinement_that_does_not_converge_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    matrix = small_pivots(1e-9)
    made = SuperLU(matrix)
    real = made._substituted
    monkeypatch.setattr(made, "_substituted", lambda right: 2.5 * real(right))
    with pytest.raises(SingularShift, match="refinement ends at a backward error"):
        made.solve(np.ones(CHAIN))


def test_a_pivot_of_rounding_size_is_refused_and_the_shift_moved() -> None:
    matrix = small_pivots(0.0)
    matrix.setdiag(EPSILON)
    with pytest.raises(SingularShift):
        SuperLU(matrix)
    stiffness = matrix + 1.0 * sp.eye_array(CHAIN)
    pencil = PlainPencil(sp.csc_array(stiffness), sp.eye_array(CHAIN, format="csc"), Scale(1.0, 1.0, 1.0))
    factor, shift = factor_near(pencil, 1.0, Factoriser("superlu"))
    assert 0.0 < abs(shift - 1.0) < 2e-4
    assert factor.negative == CHAIN // 2


def test_a_well_conditioned_solve_costs_one_substitution(monkeypatch: pytest.MonkeyPatch) -> None:
    made = SuperLU(sp.csc_array(clamped_block().stiffness))
    calls, real = [], made._substituted

    def counted(right: np.ndarray) -> np.ndarray:
        calls.append(right.shape)
        return real(right)

    monkeypatch.setattr(made, "_substituted", counted)
    made.solve(np.ones((made._matrix.shape[0], 3)))
    assert len(calls) == 1


def counted_or_refused(matrix: sp.csc_array) -> int | None:
    """Negative eigenvalues as the factors tell them, None where they are refused."""
    try:
        return SuperLU(matrix).negative
    except SingularShift:
        return None


def test_the_count_beside_an_eigenvalue_is_right_or_refused() -> None:
    """At distances down to rounding on both sides: dense algebra knows the eigenvalues to 1e-12 of each other."""
    body = clamped_block()
    values = eigh(body.stiffness.toarray(), body.mass.toarray(), eigvals_only=True)
    right = []
    for index in (0, 3, 11, 25):
        for distance in (1e-3, 1e-6, 1e-9):
            for side in (-1.0, 1.0):
                shift = values[index] * (1.0 + side * distance)
                text = counted_or_refused(sp.csc_array(body.stiffness - shift * body.mass))
                expected = int((values < shift).sum())
                assert text in (expected, None), (index, distance, side)
                right.append(text == expected)
    assert all(right), "none of these is so near that it must be refused"


@pytest.mark.parametrize("kind", ["hex1", "hex2", "tet1", "tet2 bent"])
def test_a_free_body_is_not_factorised_at_rest(kind: str) -> None:
    """Six eigenvalues are zero but for rounding, whose signs would be counted."""
    body = small.ALL[kind]()
    free = constrain(assemble(body, {"body": small.SOFT}), free_mask(body))
    with pytest.raises(SingularShift):
        SuperLU(free.stiffness)


@pytest.mark.parametrize("seed", range(6))
def test_the_count_outlives_bad_scaling(seed: int) -> None:
    """D A D has the inertia of A, which dense algebra tells; D spans twelve powers of ten."""
    draw = np.random.default_rng(seed)
    count = 60
    pattern = sp.random_array((count, count), density=0.08, rng=draw, data_sampler=draw.standard_normal)
    matrix = sp.csc_array(pattern + pattern.T + sp.diags_array(draw.standard_normal(count)))
    negative = int((np.linalg.eigvalsh(matrix.toarray()) < 0.0).sum())
    scale = sp.diags_array(10.0 ** draw.uniform(-6.0, 6.0, count))
    for one in (matrix, sp.csc_array(scale @ matrix @ scale)):
        assert counted_or_refused(one) in (negative, None)
    assert counted_or_refused(matrix) == negative


@pytest.mark.parametrize("seed", range(3))
def test_a_hermitian_matrix_counts_twice_in_its_real_embedding(seed: int) -> None:
    draw = np.random.default_rng(seed)
    count = 40
    part = sp.random_array((count, count), density=0.1, rng=draw, dtype=complex)
    hermitian = sp.csc_array(part + part.conj().T + sp.diags_array(draw.standard_normal(count) + 0j))
    real, imaginary = hermitian.real, hermitian.imag
    embedded = sp.csc_array(sp.block_array([[real, -imaginary], [imaginary, real]]))
    negative = int((np.linalg.eigvalsh(hermitian.toarray()) < 0.0).sum())
    assert SuperLU(embedded).negative == 2 * negative


class Noisy(Factoriser):
    """Solves with a backward error of rounding, another one each time."""

    def __init__(self, backend: str) -> None:
        super().__init__(backend)
        self.draw = np.random.default_rng(5)

    def __call__(self, matrix: sp.csc_array) -> Factor:
        """A factor whose solve is disturbed."""
        made = super().__call__(matrix)
        norm, real = float(abs(matrix).sum(axis=0).max()), made.solve

        def solve(right: np.ndarray) -> np.ndarray:
            size = EPSILON * norm * np.linalg.norm(real(right), axis=0)
            noise = self.draw.standard_normal(right.shape)
            return real(right + size * noise / np.linalg.norm(noise, axis=0))

        made.solve = solve  # type: ignore[method-assign]
        return made


@pytest.mark.parametrize("backend", factorisations())
@pytest.mark.parametrize("place", ["above rigid-body modes", "on a mode"])
def test_rounding_beside_the_shift_does_not_spoil_the_modes_far_from_it(backend: str, place: str) -> None:
    """A pair six powers of ten nearer to the shift than the others: a solve's rounding grows by as much."""
    low = [1e-15, 2e-15] if place == "above rigid-body modes" else [3.1e-3, 3.6e-3]
    values = np.sort(np.concatenate([low, 1e-3 * np.arange(1.0, 9.0), np.linspace(0.1, 1.0, 190)]))
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((len(values), len(values))))[0]
    stiffness = (turn * values) @ turn.T
    pencil = PlainPencil(
        sp.csc_array((stiffness + stiffness.T) / 2.0),
        sp.eye_array(len(values), format="csc"),
        Scale(1.0, 1.0, 1.0),
        rigid_count=2 if place == "above rigid-body modes" else 0,
    )
    target = 0.0 if place == "above rigid-body modes" else 3.6e-3 * (1.0 + 1e-8)
    modes = modes_near(pencil, float(np.sqrt(target) / (2.0 * np.pi)), 5, Shared(Noisy(backend)))  # type: ignore[arg-type]
    elastic = values[pencil.rigid_count :]
    nearest = np.sort(elastic[np.argsort(np.abs(np.sqrt(elastic) - np.sqrt(target)))[:5]])
    assert np.allclose(pencil.scale.eigenvalue(1.0) * modes.frequency_hz**2, nearest, rtol=1e-8)
    assert modes.residual.max() < 1e-10
    said = modes.rounding * np.sqrt(len(values))  # of one rounding each; a row's sum makes as many
    assert (np.abs(pencil.scale.eigenvalue(1.0) * modes.frequency_hz**2 / nearest - 1.0) < 2.0 * said).all()
