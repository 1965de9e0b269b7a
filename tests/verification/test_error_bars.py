"""The error bars of scenes that no calibration saw, against the finest rung: they must hold in at least 95 of 100."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.bands import solve_bands
from pipeline.case import load_case
from pipeline.logs import TerminalLog
from pipeline.modes import Request, solve_modes

CASE = Path(__file__).resolve().parents[2] / "studies" / "three-rows.toml"
COARSE, FINE = (0.01, 0.003), 0.0005
HOLDS = 0.95
CALM = TerminalLog(True)
SEED = 20


def scenes(count: int) -> list[list[str]]:
    """Overrides of the reference case: thickness, zone, pillar and pitch drawn at random, the same each time."""
    draw = np.random.default_rng(SEED)
    found = []
    for _ in range(count):
        thickness, side = draw.uniform(1.2, 3.0), draw.uniform(1.2, 2.6)
        found.append(
            [
                f"plate.thickness_mm={thickness:.3f}",
                f"zone.width_mm={draw.uniform(14, 26):.3f}",
                f"zone.length_mm={draw.uniform(60, 130):.3f}",
                f"zone.nodal_lines={draw.integers(4, 9)}",
                f"pillar.side_mm={side:.3f}",
                f"pillar.height_mm={side * draw.uniform(1.8, 4.5):.3f}",
                f"array.pitch_mm={side * draw.uniform(1.6, 3.0):.3f}",
                "patches.sensors=[0]",
                "bands.points=1",
                "bands.count=8",
            ]
        )
    return found


def part(name: str, overrides: list[str], accuracy: float) -> tuple[np.ndarray, float]:
    """Some frequencies of a lone part and their bar."""
    case = load_case(CASE, [*overrides, f"solve.accuracy={accuracy}"])
    found = solve_modes(case, Request(name, near_hz=0.0, count=4), CALM)
    assert found.expected_error is not None
    return np.array([row.frequency_hz for row in found.rows[:4]]), found.expected_error


def bands(overrides: list[str], accuracy: float) -> tuple[np.ndarray, float]:
    """The bands at the corners of the path and their bar, the reduction's own error included."""
    case = load_case(CASE, [*overrides, f"solve.accuracy={accuracy}"])
    found = solve_bands(case, CALM)
    assert found.expected_error is not None and found.detail is not None
    return found.frequencies_hz, found.expected_error + found.detail.reduction_error


def held(coarse: tuple[np.ndarray, float], fine: tuple[np.ndarray, float]) -> tuple[int, int]:
    """How many frequencies lie within their bar, and how many there are."""
    moving = fine[0] > 1e-4 * fine[0].max()
    error = np.abs(coarse[0][moving] / fine[0][moving] - 1.0)
    return int((error <= coarse[1] + fine[1]).sum()), int(moving.sum())


def share(pairs: list[tuple[int, int]]) -> float:
    return sum(inside for inside, _ in pairs) / sum(count for _, count in pairs)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pillar", "zone"])
def test_bars_of_lone_parts(name: str) -> None:
    pairs = []
    for overrides in scenes(12):
        fine = part(name, overrides, FINE)
        pairs += [held(part(name, overrides, accuracy), fine) for accuracy in COARSE]
    assert sum(count for _, count in pairs) >= 90
    assert share(pairs) >= HOLDS, pairs


@pytest.mark.slow
def test_bars_of_bands() -> None:
    pairs = []
    for overrides in scenes(5):
        fine = bands(overrides, FINE)
        pairs += [held(bands(overrides, accuracy), fine) for accuracy in COARSE]
    assert sum(count for _, count in pairs) >= 100
    assert share(pairs) >= HOLDS, pairs
