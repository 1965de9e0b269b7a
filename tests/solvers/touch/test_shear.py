"""Net shear of a travelling wave: closed forms at both ends of the load, quadrature between, and what stands."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from solvers.touch.effects import _contact_half_angle, crest_motion, drive_share


@pytest.mark.parametrize("lag", [0.0, 0.6, 1.2, np.pi / 2.0])
@pytest.mark.parametrize("load", [0.2, 0.999, 1.001, 1.7, 3.0, 12.0])
def test_the_share_is_the_pressure_summed_where_the_face_drives_and_brakes(load: float, lag: float) -> None:
    half = _contact_half_angle(load)
    offset = np.cos(half) if load > 1.0 else -1.0 / load

    def pressure(theta: float) -> float:
        return float(max(0.0, np.cos(theta) - offset))

    ends = [-np.pi, -half, lag - np.pi / 2.0, lag + np.pi / 2.0, half, np.pi]
    ends = sorted({min(np.pi, max(-np.pi, end)) for end in ends})

    def mean(of: Callable[[float], float]) -> float:
        return sum(quad(of, low, high)[0] for low, high in pairwise(ends))

    net = mean(lambda theta: pressure(theta) * np.sign(np.cos(theta - lag)))
    assert drive_share(load, lag) == pytest.approx(net / mean(pressure), abs=1e-6)


def test_its_limits_are_those_of_a_soft_and_of_a_hard_contact() -> None:
    assert drive_share(0.0) == 0.0 and drive_share(0.01) == pytest.approx(0.02 / np.pi)
    assert drive_share(np.pi) == pytest.approx(1.0) and drive_share(1e4) == pytest.approx(1.0)
    assert drive_share(1.0) == pytest.approx(drive_share(1.0 + 1e-9), rel=1e-3)
    assert drive_share(5.0, np.pi / 2.0) == pytest.approx(0.0, abs=1e-12), "a standing wave drags neither way"


def test_the_crest_runs_against_the_wave_and_stands_still_without_one() -> None:
    """w = a cos(kx - wt) of a thin plate: the face moves by (h/2) k a w at its crests."""
    a, k, h, f = 1e-6, 200.0, 2e-3, 30e3
    x = np.linspace(0.0, 0.05, 7)[:, None]
    forth = a * np.exp(-1j * k * x)
    speed = h / 2.0 * k * a * 2.0 * np.pi * f
    for field, slope, sign in ((forth, -1j * k * forth, -1.0), (forth.conj(), 1j * k * forth.conj(), 1.0)):
        motion = crest_motion(h / 2.0 * slope, field, f)
        assert motion.crest_m_s == pytest.approx(sign * speed) and motion.lag(3, 0) == pytest.approx(0.0, abs=1e-6)
    standing = crest_motion((-1j * k * h * forth).real + 0j, 2.0 * forth.real + 0j, f)
    assert np.abs(standing.crest_m_s).max() < 1e-12 and standing.lag(3, 0) == pytest.approx(np.pi / 2.0)
