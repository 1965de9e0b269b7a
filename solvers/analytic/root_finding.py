"""A root between two ends of opposite sign, without the quarter of a second that importing a whole optimiser takes."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite

from solvers.errors import SolverError

MAX_COUNT = 200


def root_between(
    function: Callable[[float], float], low: float, high: float, xtol: float, rtol: float = 4e-16
) -> float:
    """x between two ends where f changes its sign, within xtol + rtol |x|: inverse quadratic steps, else halving.

    Raises SolverError when the ends have the same sign or a value is not finite. Source: chandrupatla1997.
    """
    a, b = float(high), float(low)
    fa, fb = function(a), function(b)
    if not (isfinite(fa) and isfinite(fb)) or (fa != 0.0 and fb != 0.0 and (fa < 0.0) == (fb < 0.0)):
        raise SolverError(f"no sign change between {low:g} and {high:g}: {fb:g} and {fa:g}")
    c, fc, share = a, fa, 0.5
    for _ in range(MAX_COUNT):
        best, value = (a, fa) if abs(fa) < abs(fb) else (b, fb)
        least = (xtol + rtol * abs(best)) / 2.0 / abs(a - b)
        if value == 0.0 or least > 0.5:
            return best
        x = a + min(max(share, least), 1.0 - least) * (b - a)
        fx = function(x)
        if not isfinite(fx):
            raise SolverError(f"no finite value at {x:g}, between {low:g} and {high:g}")
        if (fx < 0.0) == (fa < 0.0):
            c, fc = a, fa
        else:
            c, fc, b, fb = b, fb, a, fa
        a, fa = x, fx
        share = _inverse_quadratic(a, b, c, fa, fb, fc)
    raise SolverError(f"no root within {xtol:g} between {low:g} and {high:g} after {MAX_COUNT} steps")


def _inverse_quadratic(a: float, b: float, c: float, fa: float, fb: float, fc: float) -> float:
    """Share of the way from a to b where the parabola x(f) through three points has f = 0; half where that is not safe."""
    if fc in (fa, fb):
        return 0.5
    xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
    if phi**2 >= xi or (1.0 - phi) ** 2 >= 1.0 - xi:
        return 0.5
    return fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
