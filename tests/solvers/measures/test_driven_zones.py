"""Zones driven in turn: modes against the whole system solved at once, at a peak found by brute force."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh

from geometry.layout import Design
from geometry.materials import MATERIALS
from solvers.errors import SolverError
from solvers.measures.confinement import DrivenZones, Profile, drive_zones

QUALITY = 40.0
DESIGN = Design(
    40e-3, 10e-3, 2e-3, 4, MATERIALS["aluminium"], None, 4e-3, 4e-3, 0, 5e-3, zones=2, shared_rows=0, zone_gap_m=10e-3
)
Y = np.array([-18e-3, -12e-3, -7e-3, 0.0, 7e-3, 12e-3, 18e-3])  # two in each zone, three beside them
WEIGHTS = np.array([1.0, 0.7, 1.3, 2.0, 1.0, 1.2, 0.5])
SHAPE = np.cos(np.pi * DESIGN.from_zone_m(Y) / DESIGN.width_m)


def springs() -> tuple[np.ndarray, np.ndarray]:
    """Seven unequal masses in a row, the passive ones on stiffer springs; frequencies of some Hz."""
    ground = np.diag([900.0, 400.0, 380.0, 900.0, 390.0, 410.0, 950.0])
    steps = np.diff(np.eye(7), axis=0) * np.array([6.0, 7.0, 8.0, 9.0, 8.0, 7.0])[:, None]
    return ground + steps.T @ steps, np.diag([1.0, 1.2, 1.1, 1.0, 1.3, 1.05, 0.9])


def directly(zone: np.ndarray, hertz: float) -> np.ndarray:
    stiffness, mass = springs()
    return np.linalg.solve(stiffness * (1.0 + 1j / QUALITY) - (2.0 * np.pi * hertz) ** 2 * mass, zone * WEIGHTS * SHAPE)


def test_zones_driven_by_modes_are_the_whole_system_solved() -> None:
    """All modes, so that nothing is left out; the peak within the finest step, 1/(2 FINE) of a half-power width."""
    values, vectors = eigh(*springs())
    tones, band = np.sqrt(values) / (2.0 * np.pi), (2.0, 5.0)
    driven = drive_zones(DESIGN, tones, Profile(Y, WEIGHTS, vectors, SHAPE, 1.0), band, QUALITY)
    inside = np.array([(np.abs(Y - middle) < 5e-3).astype(float) for middle in DESIGN.zone_centres_m])
    parts = [*inside, 1.0 - inside.sum(axis=0)]
    assert driven.peak_hz[0] != driven.peak_hz[1]

    def rms(part: np.ndarray, moved: np.ndarray) -> float:
        return float(np.sqrt((part * WEIGHTS) @ np.abs(moved) ** 2 / (part @ WEIGHTS)))

    sweep = np.linspace(*band, 3001)
    for zone in (0, 1):
        top = sweep[np.argmax([rms(inside[zone], directly(inside[zone], f)) for f in sweep])]
        assert driven.peak_hz[zone] == pytest.approx(top, rel=1.0 / QUALITY / 12 + 2e-3)
        moved = directly(inside[zone], driven.peak_hz[zone])
        levels = [20.0 * np.log10(rms(part, moved) / rms(inside[zone], moved)) for part in parts]
        assert driven.level_db[zone] == pytest.approx(levels, abs=1e-9)
        own = inside[zone] * WEIGHTS
        share = abs(own @ (SHAPE * moved)) ** 2 / ((own @ SHAPE**2) * (own @ np.abs(moved) ** 2))
        assert driven.mac[zone] == pytest.approx(share, rel=1e-9)
    assert driven.isolation_db == -max(driven.level_db[0, 1], driven.level_db[1, 0])
    assert driven.confinement_db == -max(driven.level_db[:, 2])


def test_the_least_of_three_zones_counts() -> None:
    level = np.array([[0.0, -8.0, -20.0, -9.0], [-7.0, 0.0, -6.0, -12.0], [-19.0, -8.0, 0.0, -10.0]])
    driven = DrivenZones(np.array([30e3, 31e3, 30e3]), level, np.ones(3))
    assert driven.isolation_db == 6.0 and driven.confinement_db == 9.0


def test_no_mode_is_an_error() -> None:
    profile = Profile(Y, WEIGHTS, np.empty((7, 0)), SHAPE, 1.0)
    with pytest.raises(SolverError, match="no mode"):
        drive_zones(DESIGN, np.empty(0), profile, (2.0, 5.0), QUALITY)
