"""Eigenpairs: none missing, none invented, and every claim of a solve checked against dense algebra."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.linalg import eigh

from solvers.errors import CountMismatch, SolverError
from solvers.fem import eigen
from solvers.fem.assembly import Scale, assemble
from solvers.fem.eigen import PlainPencil, Shared, lowest_pairs, modes_in_band, modes_near
from solvers.fem.factor import Factoriser
from solvers.fem.solid import Pencil, constrain, free_mask
from solvers.machine import factorisations
from tests.helpers import small_meshes as small

BODY = {"body": small.SOFT}
CUBE = (1e-3, 1e-3, 1e-3)


def pencil(clamped: tuple[str, ...] = (), order: int = 2, edges: tuple[float, ...] = small.EDGES_M) -> Pencil:
    """A small block."""
    mesh = small.hexes(order, (2, 2, 2), edges)
    return constrain(assemble(mesh, BODY), free_mask(mesh, clamped))


def dense(of: Pencil | PlainPencil) -> np.ndarray:
    """Every elastic frequency by dense algebra, Hz."""
    values = eigh(of.stiffness.toarray(), of.mass.toarray(), eigvals_only=True)
    return of.scale.frequency(values[of.rigid_count :])


def diagonal(values: list[float]) -> PlainPencil:
    """A pencil whose eigenvalues are known."""
    eye = sp.csc_array(sp.eye_array(len(values), format="csc"))
    return PlainPencil(sp.csc_array(sp.diags_array(np.array(values), format="csc")), eye, Scale(1.0, 1.0, 1.0))


@pytest.mark.parametrize("clamped", [(), ("touch",), ("x-", "x+")])
def test_a_band_holds_exactly_the_modes_of_dense_algebra(clamped: tuple[str, ...]) -> None:
    body = pencil(clamped)
    truth = dense(body)
    low, high = (truth[3] + truth[4]) / 2.0, (truth[19] + truth[20]) / 2.0
    modes = modes_in_band(body, low, high)
    assert np.allclose(modes.frequency_hz, truth[4:20], rtol=1e-9)
    assert (modes.count.expected, modes.count.found) == (16, 16)
    from_zero = modes_in_band(body, 0.0, high)
    assert np.allclose(from_zero.frequency_hz, truth[:20], rtol=1e-9)


@pytest.mark.parametrize("count", [1, 5, 12])
def test_the_nearest_modes_are_those_of_dense_algebra(count: int) -> None:
    body = pencil(("touch",))
    truth = dense(body)
    aim = truth[9] * 1.01
    modes = modes_near(body, aim, count)
    nearest = np.sort(truth[np.argsort(np.abs(truth - aim))[:count]])
    assert np.allclose(modes.frequency_hz, nearest, rtol=1e-9)
    assert modes.count.expected == modes.count.found == count


def test_a_few_modes_are_found_by_a_factor_that_counts() -> None:
    """Two counts close a narrow window; its modes come from the second one's factor, and the next window from its own count."""
    body, shared = pencil(("touch",)), Shared()
    truth = dense(body)
    ends = [(truth[i] + truth[i + 1]) / 2.0 for i in (3, 6, 8)]
    first = modes_in_band(body, ends[0], ends[1], shared)
    second = modes_in_band(body, ends[1], ends[2], shared)
    assert (first.factorisations, second.factorisations) == (2, 1)
    assert np.allclose([*first.frequency_hz, *second.frequency_hz], truth[4:9], rtol=1e-9)
    assert (first.count.expected, second.count.expected, second.count.below) == (3, 2, 7)


def test_vectors_are_orthonormal_and_meet_the_equation() -> None:
    body = pencil(("touch",))
    modes = modes_near(body, 2e5, 8)
    weighted = body.mass @ modes.vectors
    assert np.abs(modes.vectors.T @ weighted - np.eye(8)).max() < 1e-9
    assert np.allclose(body.apply_mass(modes.vectors), weighted, atol=1e-12 * np.abs(weighted).max())
    assert modes.residual.max() < 1e-10


def test_the_factor_of_a_window_is_kept_where_it_serves_what_follows() -> None:
    body = pencil(("touch",))
    truth = dense(body)
    low, high = (truth[3] + truth[4]) / 2.0, (truth[19] + truth[20]) / 2.0
    shared = Shared(keeps=True)
    modes_in_band(body, low, high, shared)
    assert shared.near and shared.near[1] == pytest.approx(
        (body.scale.eigenvalue(low) + body.scale.eigenvalue(high)) / 2.0
    )
    assert shared.near[0].negative == (truth < body.scale.frequency(np.array([shared.near[1]]))[0]).sum()
    modes_in_band(body, high, 1.3 * high, shared)
    assert shared.near is None or shared.near[1] > body.scale.eigenvalue(high)
    assert modes_in_band(body, low, high, Shared()).factorisations == 3


def test_many_modes_are_collected_over_several_shifts(monkeypatch: pytest.MonkeyPatch) -> None:
    body = pencil(("touch",))
    truth = dense(body)
    monkeypatch.setattr(eigen.Basis, "slice_of", lambda size: 7)
    modes = modes_in_band(body, 0.0, (truth[39] + truth[40]) / 2.0)
    assert np.allclose(modes.frequency_hz, truth[:40], rtol=1e-9)
    assert modes.factorisations > 10


def test_a_free_body_has_six_rigid_motions_and_they_are_no_modes() -> None:
    body = pencil()
    assert body.rigid_count == 6
    truth = dense(body)
    modes = modes_near(body, truth[0] * 0.2, 3)
    assert modes.rigid_count == 6
    assert np.allclose(modes.frequency_hz[:3], truth[:3], rtol=1e-9)
    assert modes.frequency_hz.min() > 0.5 * truth[0]


@pytest.mark.parametrize(
    ("clamped", "mirrors", "expected"),
    [
        ((), {}, 6),
        (("touch",), {}, 0),
        ((), {"x-": "S"}, 3),
        ((), {"x-": "S", "y-": "S"}, 1),
        ((), {"x-": "S", "y-": "A"}, 2),
        ((), {"x-": "A", "y-": "A"}, 1),
    ],
)
def test_rigid_motions_that_survive_are_counted(
    clamped: tuple[str, ...], mirrors: dict[str, str], expected: int
) -> None:
    mesh = small.hexes(1)
    body = constrain(assemble(mesh, BODY), free_mask(mesh, clamped, mirrors))
    assert body.rigid_count == expected
    values = eigh(body.stiffness.toarray(), body.mass.toarray(), eigvals_only=True)
    assert (values < 1e-9 * values.max()).sum() == expected


def test_a_mode_that_lanczos_loses_once_is_fetched_again(monkeypatch: pytest.MonkeyPatch) -> None:
    body = pencil(("touch",))
    truth = dense(body)
    real, calls = eigen._Solver.lanczos, []

    def forgetful(self, solve, shift, count):  # type: ignore[no-untyped-def]
        values, vectors = real(self, solve, shift, count)
        calls.append(len(values))
        if len(calls) > 1:
            return values, vectors
        keep = np.arange(len(values)) != int(np.argmin(np.abs(self.pencil.scale.frequency(values) - truth[4])))
        return values[keep], vectors[:, keep]

    monkeypatch.setattr(eigen._Solver, "lanczos", forgetful)
    modes = modes_in_band(body, 0.0, (truth[8] + truth[9]) / 2.0)
    assert len(calls) == 2
    assert np.allclose(modes.frequency_hz, truth[:9], rtol=1e-9)


@pytest.mark.parametrize("entry", ["band", "near"])
def test_a_mode_that_lanczos_always_loses_is_never_silently_missing(
    entry: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = pencil(("touch",))
    truth = dense(body)
    real = eigen._Solver.lanczos

    def blind(self, solve, shift, count):  # type: ignore[no-untyped-def]
        values, vectors = real(self, solve, shift, count)
        keep = np.abs(self.pencil.scale.frequency(values) / truth[4] - 1.0) > 1e-6
        return values[keep], vectors[:, keep]

    monkeypatch.setattr(eigen._Solver, "lanczos", blind)
    with pytest.raises(CountMismatch, match=r"modes found between .* but the inertia count is"):
        if entry == "band":
            modes_in_band(body, 0.0, (truth[8] + truth[9]) / 2.0)
        else:
            modes_near(body, truth[4] * 1.001, 5)


def test_a_wrong_vector_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    body = pencil(("touch",))
    real = eigen._Solver.lanczos

    def sloppy(self, solve, shift, count):  # type: ignore[no-untyped-def]
        values, vectors = real(self, solve, shift, count)
        return values, vectors + 1e-3 * np.abs(vectors).max() * np.cos(np.arange(vectors.size)).reshape(vectors.shape)

    monkeypatch.setattr(eigen._Solver, "lanczos", sloppy)
    with pytest.raises(SolverError, match="residual"):
        modes_near(body, 2e5, 4)


def test_every_member_of_a_cubes_degenerate_modes_is_returned() -> None:
    body = pencil(edges=CUBE)
    truth = dense(body)
    sizes = np.diff(np.flatnonzero(np.append(True, np.abs(np.diff(truth[:30]) / truth[:29]) > 1e-7)))
    assert sizes.max() >= 2, "the cube must have degenerate modes"
    for index in np.flatnonzero(np.abs(np.diff(truth[:20])) < 1e-7 * truth[:19]):
        modes = modes_near(body, truth[index], 1)
        cluster = truth[np.abs(truth / truth[index] - 1.0) < 1e-6]
        assert np.allclose(modes.frequency_hz, cluster, rtol=1e-8), "clusters are kept whole"


def test_a_neighbour_that_the_search_missed_does_not_widen_what_is_returned(monkeypatch: pytest.MonkeyPatch) -> None:
    body = pencil(("touch",))
    truth = dense(body)
    far = [np.sort(np.abs(truth - one))[1:3] for one in truth[:20]]
    index = int(np.argmax([second / first for first, second in far]))  # one neighbour near, the other far
    aim, missed = truth[index], truth[np.argsort(np.abs(truth - truth[index]))[1]]
    assert far[index][1] > 3.0 * far[index][0]
    real = eigen._Solver.nearest

    def blind(self, target, count):  # type: ignore[no-untyped-def]
        values, vectors = real(self, target, count)
        keep = np.abs(self.pencil.scale.frequency(values) / missed - 1.0) > 1e-6
        return values[keep], vectors[:, keep]

    monkeypatch.setattr(eigen._Solver, "nearest", blind)
    modes = modes_near(body, aim, 1)
    assert np.allclose(modes.frequency_hz, [aim], rtol=1e-9)
    assert modes.count.expected == 1
    assert not modes.count.low_hz < missed < modes.count.high_hz


@pytest.mark.parametrize("backend", factorisations())
@pytest.mark.parametrize("distance", [0.0, 1e-13, -1e-12])
def test_a_search_that_begins_on_a_mode_finds_its_neighbours_too(backend: str, distance: float) -> None:
    body = pencil(edges=CUBE)
    truth = dense(body)
    for index in (2, 8, 11):
        modes = modes_near(body, truth[index] * (1.0 + distance), 6, backend)
        first = int(np.argmin(np.abs(truth - modes.frequency_hz[0] * (1.0 - 1e-9))))
        assert np.allclose(modes.frequency_hz, truth[first : first + len(modes.frequency_hz)], rtol=1e-8)
        assert modes.residual.max() <= eigen.CLEAN_RESIDUAL


def test_ten_equal_eigenvalues_are_all_found() -> None:
    body = diagonal([0.5, *[1.0] * 10, *np.linspace(2.0, 60.0, 60)])
    modes = modes_in_band(body, float(body.scale.frequency(np.array([0.9]))[0]), float(np.sqrt(1.1) / (2 * np.pi)))
    assert len(modes.frequency_hz) == 10
    assert np.abs(modes.vectors.T @ modes.vectors - np.eye(10)).max() < 1e-9


@pytest.mark.parametrize("backend", factorisations())
def test_a_shift_exactly_on_an_eigenvalue_is_moved(backend: str) -> None:
    values = [*range(1, 80)]
    body = diagonal([float(v) for v in values])
    at = float(body.scale.frequency(np.array([9.0]))[0])
    modes = modes_near(body, at, 3, backend)
    result = [round(body.scale.eigenvalue(f), 6) for f in modes.frequency_hz]
    assert result == [8.0, 9.0, 10.0]


def test_a_shift_on_a_computed_frequency_of_a_body_works() -> None:
    body = pencil(("touch",))
    truth = dense(body)
    assert np.allclose(modes_near(body, truth[6], 1).frequency_hz, truth[6], rtol=1e-9)


@pytest.mark.skipif(
    "rslab" not in factorisations(), reason="rslab (extra: fast) is not installed: nothing to compare with"
)
def test_both_factorisations_give_the_same_modes_and_counts() -> None:
    body = pencil(("touch",), order=3)
    first, second = (modes_near(body, 3e5, 12, backend) for backend in ("superlu", "rslab"))
    assert np.abs(first.frequency_hz / second.frequency_hz - 1.0).max() < 1e-9
    assert first.count.expected == second.count.expected


@pytest.mark.parametrize("backend", factorisations())
def test_the_inertia_counts_the_eigenvalues_below_the_shift(backend: str) -> None:
    body = pencil(("touch",))
    values = eigh(body.stiffness.toarray(), body.mass.toarray(), eigvals_only=True)
    factorise = Factoriser(backend)
    for below in (0, 1, 7, 40):
        shift = 0.5 * (values[below - 1] + values[below]) if below else 0.5 * values[0]
        factor = factorise(sp.csc_array(body.stiffness - shift * body.mass))
        assert factor.negative == below
        right = np.cos(np.arange(body.dof))
        again = (body.stiffness - shift * body.mass) @ factor.solve(right)
        assert np.linalg.norm(again - right) < 1e-8 * np.linalg.norm(right)


def test_an_unknown_factorisation_is_refused_with_what_there_is() -> None:
    with pytest.raises(SolverError, match=r"'abacus' is not installed; use .*superlu"):
        Factoriser("abacus")


def test_the_lowest_values_are_closed_by_a_count() -> None:
    body = diagonal([1.0, 1.0, 2.0, 2.0, 3.0, 3.0, *np.linspace(5.0, 50.0, 40)])
    assert np.allclose(lowest_pairs(body, 3, 2)[0][::2], [1.0, 2.0, 3.0], rtol=1e-10)
    assert np.allclose(lowest_pairs(body, 4)[0], [1.0, 1.0, 2.0, 2.0], rtol=1e-10)


def test_the_lowest_values_raise_when_one_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    body, real = diagonal([float(v) for v in range(1, 60)]), eigen._Solver.lanczos

    def blind(self, solve, shift, count):  # type: ignore[no-untyped-def]
        values, vectors = real(self, solve, shift, count)
        return np.delete(values, 1), np.delete(vectors, 1, axis=1)

    monkeypatch.setattr(eigen._Solver, "lanczos", blind)
    with pytest.raises(CountMismatch, match="the inertia count is"):
        lowest_pairs(body, 4)


def test_the_lowest_values_of_wrong_vectors_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    body, real = diagonal([float(v) for v in range(1, 60)]), eigen._Solver.lanczos

    def sloppy(self, solve, shift, count):  # type: ignore[no-untyped-def]
        values, vectors = real(self, solve, shift, count)
        return values, vectors + 1e-5

    monkeypatch.setattr(eigen._Solver, "lanczos", sloppy)
    with pytest.raises(SolverError, match="residual"):
        lowest_pairs(body, 4)


def test_an_empty_band_is_empty_and_counted() -> None:
    body = pencil(("touch",))
    modes = modes_in_band(body, 1.0, dense(body)[0] * 0.5)
    assert len(modes.frequency_hz) == 0
    assert modes.vectors.shape == (body.dof, 0)
    assert modes.count.expected == 0


def test_a_wide_band_above_a_crowd_is_whole() -> None:
    """Many modes below the band, few at its upper end: the nearest ones to the shift must be those of the band."""
    values = np.concatenate(
        [np.linspace(200.0, 340.0, 40), np.linspace(351.0, 900.0, 20), np.linspace(3000.0, 3420.0, 5)]
    )
    pencil = PlainPencil(
        sp.csc_array(sp.diags_array(values)), sp.csc_array(sp.eye_array(len(values))), Scale(1.0, 1.0, 1.0)
    )
    scale = pencil.scale
    ends = scale.frequency(np.array([350.0, 3430.0]))
    assert len(modes_in_band(pencil, *ends).frequency_hz) == 25


@pytest.mark.parametrize("count", range(1, 8))
def test_the_lowest_modes_of_a_square_bar_end_in_a_whole_pair(count: int) -> None:
    """Bending pairs of a free square bar: asking for a number that splits one returns it whole."""
    mesh = small.hexes(2, (6, 1, 1), (6e-3, 1e-3, 1e-3))
    modes = modes_near(constrain(assemble(mesh, {"body": small.SOFT}), free_mask(mesh)), 0.0, count)
    result = modes.frequency_hz
    assert len(result) == modes.count.expected == modes.count.found and len(result) - count in (0, 1)
    assert abs(result[1] / result[0] - 1.0) < 1e-9


def test_slight_rounding_is_bounded_by_the_columns_sums_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the bound is no longer slight, rounding is computed entry by entry: a refusal never rests on a bound."""
    body = pencil(("touch",))
    bound = modes_near(body, 0.0, 5).rounding
    monkeypatch.setattr(eigen, "SLIGHT", 0.0)
    modes = modes_near(body, 0.0, 5)
    size, values = np.abs(modes.vectors), body.scale.eigenvalue(modes.frequency_hz)
    exact = eigen.EPSILON * np.einsum("ik,ij,jk->k", size, abs(body.stiffness.toarray()), size) / (2.0 * values)
    assert modes.rounding == pytest.approx(exact, rel=1e-6)
    assert (exact <= bound).all() and bound.max() < 1e-8
