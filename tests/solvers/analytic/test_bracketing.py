"""The bracketed root against scipy's, on smooth, flat, steep and lopsided functions, and its refusals."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, cosh, exp, inf, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from solvers.analytic.beams import MAX_COUNT, root_between
from solvers.errors import SolverError

FUNCTIONS: list[tuple[Callable[[float], float], float, float]] = [
    (lambda x: cos(x) - x, 0.0, 1.0),
    (lambda x: x**3 - 2.0 * x - 5.0, 2.0, 3.0),
    (lambda x: 1.0 - 1.0 / x**2, 0.5, 1.51),
    (lambda x: (x - 3.0) ** 3, 0.0, 5.0),
    (lambda x: exp(x) - 1e-8, -30.0, 0.0),
    (lambda x: cos(x) * cosh(x) - 1.0, 4.0, 5.0),
    (lambda x: sin(x) / x, 2.0, 4.0),
    (lambda x: -1.0 if x < 0.3 else 1.0, 0.0, 1.0),
]


@pytest.mark.parametrize("number", range(len(FUNCTIONS)))
def test_the_root_is_scipys_and_cheap(number: int) -> None:
    function, low, high = FUNCTIONS[number]
    calls = 0

    def counted(x: float) -> float:
        nonlocal calls
        calls += 1
        return function(x)

    result = root_between(counted, low, high, 1e-12)
    exact = 3.0 if number == 3 else brentq(function, low, high, xtol=1e-13)
    assert result == pytest.approx(exact, abs=3e-12)
    assert calls <= (60 if number in (3, 7) else 15)
    assert root_between(function, high, low, 1e-12) == pytest.approx(result, abs=3e-12)


@given(st.floats(-0.999, 0.999), st.floats(1.0, 9.0), st.floats(1e-12, 1e-3))
def test_the_error_stays_within_what_was_asked(root: float, power: float, xtol: float) -> None:
    """f = sign |x - root|^power is steep or flat at will; the interval is [-1, 1]."""
    result = root_between(lambda x: (x - root) * abs(x - root) ** (power - 1.0), -1.0, 1.0, xtol)
    assert abs(result - root) <= xtol + 1e-12


def test_an_end_may_be_the_root() -> None:
    assert root_between(sin, 0.0, 1.0, 1e-12) == 0.0
    assert root_between(lambda x: x - 1.0, 0.5, 1.0, 1e-12) == 1.0


def test_refusals() -> None:
    with pytest.raises(SolverError, match="no sign change"):
        root_between(lambda x: x**2 + 1.0, -1.0, 1.0, 1e-9)
    with pytest.raises(SolverError, match="no sign change"):
        root_between(lambda x: inf if x > 0.5 else -1.0, 0.0, 1.0, 1e-9)
    with pytest.raises(SolverError, match="no finite value"):
        root_between(lambda x: float("nan") if 0.2 < x < 0.8 else x - 0.5, 0.0, 1.0, 1e-9)
    with pytest.raises(SolverError, match=f"after {MAX_COUNT}"):
        root_between(lambda x: -1.0 if x < 1 / 3 else 1.0, 0.0, 1.0, 0.0, 0.0)  # nothing is nearer than the next number
