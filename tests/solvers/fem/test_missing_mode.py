"""What one mode that was not computed may have of a load, against every mode of small pencils."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from geometry.elements import FloatArray
from solvers.fem.assembly import Scale
from solvers.fem.eigen import PlainPencil, Shared, factor_near
from solvers.fem.factor import Factor, Factoriser
from solvers.fem.missing_mode import largest_outside

SIZE = 60


def drawn(seed: int, peaked: float) -> tuple[PlainPencil, FloatArray, FloatArray, FloatArray]:
    """A pencil, its eigenvalues and modes, and a load whose strengths sum to 1, most of them in few modes."""
    random = np.random.default_rng(seed)
    mass = np.diag(random.uniform(0.5, 2.0, SIZE))
    turned, _ = np.linalg.qr(random.normal(size=(SIZE, SIZE)))
    vectors = turned / np.sqrt(np.diag(mass))[:, None]
    values = np.sort(random.uniform(0.05, 8.0, SIZE)) ** 2
    heavy = mass @ vectors
    pencil = PlainPencil(sp.csc_array(heavy @ np.diag(values) @ heavy.T), sp.csc_array(mass), Scale(1.0, 1.0, 1.0))
    strengths = random.dirichlet(np.full(SIZE, peaked))
    return pencil, values, vectors, heavy @ np.sqrt(strengths)


@pytest.mark.parametrize("peaked", [0.05, 0.3, 3.0])
def test_no_mode_outside_has_more(peaked: float) -> None:
    better = 0
    for seed in range(8):
        pencil, values, vectors, load = drawn(seed, peaked)
        for reach in ((4.0, 16.0), (0.0, 9.0)):
            inside = (values >= reach[0]) & (values <= reach[1])
            strengths = (vectors.T @ load) ** 2
            bound = largest_outside(pencil, Shared(), load, vectors[:, inside], reach)
            missing = 1.0 - strengths[inside].sum()
            assert strengths[~inside].max() <= bound * (1.0 + 1e-9) <= missing * (1.0 + 2e-9)
            better += bound < 0.8 * missing
    assert better >= 4 or peaked < 0.1


def test_a_mode_alone_has_its_strength() -> None:
    """All the load that is missing in one mode: the bound is met."""
    pencil, values, vectors, _ = drawn(1, 1.0)
    inside = (values >= 4.0) & (values <= 16.0)
    own, other = np.flatnonzero(inside)[3], np.flatnonzero(~inside)[0]
    heavy = pencil.apply_mass(vectors)
    load = np.sqrt(0.7) * heavy[:, own] + np.sqrt(0.3) * heavy[:, other]
    assert largest_outside(pencil, Shared(), load, vectors[:, inside], (4.0, 16.0)) == pytest.approx(0.3, rel=1e-5)


def test_two_modes_that_share_what_is_missing_are_told_apart() -> None:
    pencil, values, vectors, _ = drawn(1, 1.0)
    inside = (values >= 4.0) & (values <= 16.0)
    heavy, (low, high) = pencil.apply_mass(vectors), (np.flatnonzero(values < 2.0)[0], np.flatnonzero(values > 20.0)[0])
    load = np.sqrt(0.3) * heavy[:, low] + np.sqrt(0.2) * heavy[:, high]
    bound = largest_outside(
        pencil, Shared(), load + np.sqrt(0.5) * heavy[:, inside][:, 0], vectors[:, inside], (4.0, 16.0)
    )
    assert bound == pytest.approx(0.3, rel=1e-5)


def test_a_kept_factor_serves_where_its_shift_lies_within() -> None:
    """The same bound without another factorisation; at a shift that lies outside the factor is not taken."""
    pencil, values, vectors, load = drawn(2, 0.3)
    inside = (values >= 4.0) & (values <= 16.0)
    strengths = (vectors.T @ load) ** 2
    for shift, made in ((9.0, 0), (3.0, 1)):
        count: list[int] = []
        shared = Shared(_Counting(count))
        shared.near = factor_near(pencil, shift, Factoriser())
        bound = largest_outside(pencil, shared, load, vectors[:, inside], (4.0, 16.0))
        assert strengths[~inside].max() <= bound <= 1.0 - strengths[inside].sum() + 1e-9
        assert len(count) == made and shared.near[0].negative == (values < shift).sum()


class _Counting(Factoriser):
    def __init__(self, count: list[int]) -> None:
        super().__init__()
        self.count = count

    def __call__(self, matrix: sp.csc_array) -> Factor:
        self.count.append(1)
        return super().__call__(matrix)
