"""Extremes of bands between the sampled wavevectors: along straight segments of a path, and over the irreducible zone.

A segment is searched where the cubic through sampled values and group velocities (Hellmann-Feynman, one-sided at degenerate
points) may exceed the best sample; the zone from its best grid points, with the gradient.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.elements import FloatArray
from solvers.superelement.lattice import Lattice
from solvers.waves.branches import Solved, one_sided

CLOSE = 1e-3  # of an interval: where a search stops; a smooth extreme is then known to its square
INSIDE = np.linspace(0.0, 1.0, 18)[1:-1]
STARTS = 4  # grid points from which an extreme over the zone is sought


@dataclass(frozen=True)
class Extreme:
    """A band's largest or smallest frequency in Hz and where it is, wavevector (2,) in rad/m."""

    hz: float
    wavevector: FloatArray


class Line:
    """The sorted bands on a straight segment of a path, sampled at its wavevectors (m, 2), with slopes along the segment."""

    def __init__(self, solved: Solved, wavevectors: FloatArray) -> None:
        self.solved, self.start, self.along = solved, wavevectors[0], wavevectors[-1] - wavevectors[0]
        self.at = np.linalg.norm(wavevectors - self.start, axis=1) / np.linalg.norm(self.along)
        waves = [solved(k) for k in wavevectors]
        self.value = np.array([w.eigenvalue for w in waves])[:, : solved.count]
        slopes = [one_sided(solved.lattice, w, self.along) for w in waves]
        self.beyond, self.before = (np.array(side)[:, : solved.count] for side in zip(*slopes, strict=True))
        self._extremes: dict[tuple[int, int], Extreme] = {}

    def extreme(self, band: int, sign: int) -> Extreme:
        """The largest (sign 1) or smallest (-1) frequency of a sorted band (from 0) on the segment, ends included."""
        if (band, sign) not in self._extremes:
            self._extremes[band, sign] = self._search(band, sign)
        return self._extremes[band, sign]

    def _search(self, band: int, sign: int) -> Extreme:
        value = sign * self.value[:, band]
        beyond, before = sign * self.beyond[:, band], sign * self.before[:, band]
        ends, top = np.maximum(value[:-1], value[1:]), cubic_top(self.at, value, beyond, before)
        bound = np.maximum(2.0 * top - ends, tent_top(self.at, value, beyond, before))
        best, where = float(value.max()), float(self.at[value.argmax()])
        for i in np.flatnonzero((top > ends) & (bound >= best)):
            inside, at = self._inside(band, sign, self.at[i], self.at[i + 1])
            if inside > best:
                best, where = inside, at
        return Extreme(_hz(self.solved.lattice, sign * best), self.start + where * self.along)

    def _inside(self, band: int, sign: int, low: float, high: float) -> tuple[float, float]:
        """The largest value of sign times a band's eigenvalue between two samples, and where it is."""
        from scipy.optimize import minimize_scalar  # slow to import

        minimum = minimize_scalar(
            lambda s: -sign * self._eigenvalue(float(s), band),
            bounds=(low, high),
            method="bounded",
            options={"xatol": CLOSE * (high - low)},
        )
        return float(-minimum.fun), float(minimum.x)

    def _eigenvalue(self, s: float, band: int) -> float:
        return float(self.solved(self.start + s * self.along).eigenvalue[band])


def cubic_top(at: FloatArray, value: FloatArray, beyond: FloatArray, before: FloatArray) -> FloatArray:
    """Largest value inside each interval of the cubics through values (m,) and slopes beyond and before them, (m - 1,)."""
    step = np.diff(at)[:, None]
    t = INSIDE[None]
    low, high = value[:-1, None], value[1:, None]
    rise = (t * (1.0 - t)) * ((1.0 - t) * step * beyond[:-1, None] - t * step * before[1:, None])
    cubic = low + (high - low) * t * t * (3.0 - 2.0 * t) + rise
    return np.asarray(cubic.max(axis=1))


def tent_top(at: FloatArray, value: FloatArray, beyond: FloatArray, before: FloatArray) -> FloatArray:
    """Where the tangents from both ends of each interval meet: the top of a crossing, and above any concave arc, (m - 1,)."""
    step, up, down = np.diff(at), beyond[:-1], -before[1:]
    rising = (up > 0.0) & (down > 0.0)
    share = (value[1:] - value[:-1] + down * step) / np.where(rising, up + down, 1.0)
    return np.asarray(np.where(rising, value[:-1] + up * share, -np.inf))


def zone_extreme(solved: Solved, grid: FloatArray, value: FloatArray, band: int, sign: int) -> Extreme:
    """The extreme of a sorted band (from 0) over the zone, from its scaled eigenvalues (n,) on a grid (n, 2) in rad/m."""
    lattice = solved.lattice
    edge = np.pi / np.array(lattice.cell.size_m[:2])
    scale = float(np.abs(value).max()) or 1.0
    order = np.argsort(-sign * value, kind="stable")
    best, where = sign * float(value[order[0]]), grid[order[0]]

    def objective(share: FloatArray) -> tuple[float, FloatArray]:
        nonlocal best, where
        waves = solved(share * edge)
        if sign * float(waves.eigenvalue[band]) > best:
            best, where = sign * float(waves.eigenvalue[band]), share * edge
        slope = np.array([part[band, band].real for part in lattice.slopes(waves)])
        return -sign * float(waves.eigenvalue[band]) / scale, -sign * slope * edge / scale

    from scipy.optimize import minimize  # slow to import

    for start in _spread(grid[order] / edge, STARTS):
        minimize(objective, start, jac=True, method="L-BFGS-B", bounds=[(-1.0, 1.0)] * 2, options={"ftol": 1e-12})
    return Extreme(_hz(lattice, sign * best), where)


def _spread(points: FloatArray, count: int) -> list[FloatArray]:
    """The first points that lie apart from one another, at most `count`: starts of a search in several valleys."""
    apart = 2.0 / np.sqrt(len(points))
    chosen: list[FloatArray] = []
    for point in points:
        if all(np.linalg.norm(point - other) > apart for other in chosen):
            chosen.append(point)
        if len(chosen) == count:
            break
    return chosen


def _hz(lattice: Lattice, eigenvalue: float) -> float:
    return float(lattice.cell.scale.frequency(np.array(eigenvalue)))
