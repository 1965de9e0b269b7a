"""Velocity feedback at points of a beam under a harmonic force; e^{+j omega t}, phasors W = W_d + j W_q.

The law in displacement form: f = -j K' C W, that is F_d = K' W_q and F_q = -K' W_d, which is a damper of K'/omega. Its gain on
velocity is K = -K'/omega < 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.active_beam.free_beam import EXACTLY, FreeBeam
from solvers.errors import SolverError, checked_frequencies


@dataclass(frozen=True)
class Layout:
    """Where loops act and listen: points_m (p,), spread (p, loops) of a loop's signal over the points, pick (loops, p).

    Dual when pick is spread transposed: every loop then takes power out at any gain.
    """

    name: str
    points_m: tuple[float, ...]
    spread: tuple[tuple[float, ...], ...]
    pick: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        spread, pick = np.array(self.spread, dtype=float), np.array(self.pick, dtype=float)
        points = len(self.points_m)
        if not points or len(set(self.points_m)) < points:
            raise SolverError("feedback needs at least one point, all different")
        if spread.ndim != 2 or spread.shape[0] != points or pick.shape != spread.shape[::-1]:
            raise SolverError(f"feedback {self.name}: spread must be (points, loops), pick (loops, points)")

    @property
    def dual(self) -> bool:
        """True when what a loop senses is what its forces do work on."""
        return bool(np.array_equal(np.array(self.pick), np.array(self.spread).T))

    @property
    def region_m(self) -> tuple[float, float]:
        """Outermost points, m: the stretch that the loops shall confine to."""
        return min(self.points_m), max(self.points_m)


def layouts(left_m: float, apart_m: float, length_m: float) -> tuple[Layout, ...]:
    """Loops about `left` and, mirrored, on the other side; all but the first have two points `apart` from each other.

    point: one point on each side with its own velocity. pair: two, each with its own. couple: two pulled by opposed forces
    of their relative velocity, a couple. opposed: two, each with its own, the inner ones with the sign turned over: not dual.
    """
    half = apart_m / 2.0
    two, four = (
        (left_m, length_m - left_m),
        (left_m - half, left_m + half, length_m - left_m - half, length_m - left_m + half),
    )
    relative = ((1.0, -1.0, 0.0, 0.0), (0.0, 0.0, -1.0, 1.0))
    return (
        Layout("point", two, _diagonal(1.0, 1.0), _diagonal(1.0, 1.0)),
        Layout("pair", four, _diagonal(*(1.0,) * 4), _diagonal(*(1.0,) * 4)),
        Layout("couple", four, tuple(zip(*relative, strict=True)), relative),
        Layout("opposed", four, _diagonal(1.0, -1.0, -1.0, 1.0), _diagonal(*(1.0,) * 4)),
    )


def _diagonal(*values: float) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in np.diag(values).tolist())


@dataclass(frozen=True)
class ForcedBeam:
    """Steady state: deflection phasors at x (n,) per newton of excitation, loop signals (loops,), point forces (p,).

    Powers in W for an excitation of 1 N peak: given by it, taken by the loops.
    """

    x_m: FloatArray
    deflection: ComplexArray
    signals: ComplexArray
    forces: ComplexArray
    given_w: float
    taken_w: float


def forced(
    beam: FreeBeam, layout: Layout, gain_n_m: complex, omega: float, x_m: FloatArray, source_m: float
) -> ForcedBeam:
    """Beam under 1 N at `source` with the loops closed: f = -(I + H C G B)^-1 H C g, H = j K'.

    gain_n_m is K' (0: open loop), complex where the loops answer late: K' e^{-j omega delay}.
    SolverError for a gain that is not finite, a frequency not above 0, a lossless resonance hit exactly, a singular loop.
    """
    if not np.isfinite(gain_n_m):
        raise SolverError(f"gain K' = {gain_n_m:g} N/m: must be finite")
    omega = float(checked_frequencies(omega))
    points, spread, pick = np.array(layout.points_m), np.array(layout.spread), np.array(layout.pick)
    field = beam.receptance(x_m, np.append(points, source_m), 1j * omega)
    at = beam.receptance(np.append(points, source_m), np.append(points, source_m), 1j * omega)
    law = 1j * gain_n_m
    loop = np.eye(pick.shape[0]) + law * pick @ at[:-1, :-1] @ spread
    try:
        signals = np.asarray(-np.linalg.solve(loop, law * pick @ at[:-1, -1]), dtype=np.complex128)
    except np.linalg.LinAlgError:
        raise SolverError(EXACTLY) from None
    forces = spread @ signals
    moved = at @ np.append(forces, 1.0)
    return ForcedBeam(
        x_m=x_m,
        deflection=field @ np.append(forces, 1.0),
        signals=signals,
        forces=forces,
        given_w=_power_w(1.0, moved[-1], omega),
        taken_w=-float(sum(_power_w(f, w, omega) for f, w in zip(forces, moved[:-1], strict=True))),
    )


def _power_w(force: complex, deflection: complex, omega: float) -> float:
    """Mean power of a force on a moving point, Re(F conj(j omega W))/2."""
    return float(0.5 * np.real(force * np.conj(1j * omega * deflection)))


@dataclass(frozen=True)
class Confinement:
    """Amplitudes over a region and beyond it, m/N: largest and root mean square; ratio of the two rms values."""

    inside_max: float
    outside_max: float
    inside_rms: float
    outside_rms: float

    @property
    def ratio(self) -> float:
        """rms inside over rms outside."""
        return self.inside_rms / self.outside_rms


def confinement(x_m: FloatArray, deflection: ComplexArray, region_m: tuple[float, float]) -> Confinement:
    """Amplitudes within `region` and beyond it; x evenly spaced. SolverError when a side holds no point."""
    inside = (x_m > region_m[0]) & (x_m < region_m[1])
    size = np.abs(deflection)
    if not inside.any() or inside.all():
        raise SolverError("the region to confine to must hold some of the beam and leave some of it out")
    rms = [float(np.sqrt(np.mean(size[part] ** 2))) for part in (inside, ~inside)]
    return Confinement(float(size[inside].max()), float(size[~inside].max()), *rms)
