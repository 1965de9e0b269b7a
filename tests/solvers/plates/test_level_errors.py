"""Bars of levels over frequency: the change over the interval in which frequencies may lie, edges and resonances included."""

from __future__ import annotations

import numpy as np
import pytest

from solvers.plates.column import level_bars

TONES = np.linspace(30e3, 40e3, 41)


def never(_: float) -> float:
    raise AssertionError("a smooth curve is told by its samples")


def test_a_straight_curve_changes_by_its_slope_times_the_bar() -> None:
    slope = 2e-3  # dB/Hz
    bars = level_bars(TONES, slope * TONES, 0.01, never)
    assert bars == pytest.approx(slope * 0.01 * TONES, rel=1e-9)


def test_at_an_edge_the_bar_is_the_change_over_the_interval_not_the_slope() -> None:
    """Above the edge of a pass band a decay grows as the square root of the distance: its slope there is infinite."""
    edge, error = 35.1e3, 4e-3

    def decay(tone: float) -> float:
        return float(np.sqrt(max(tone - edge, 0.0)))

    values = np.array([decay(tone) for tone in TONES])
    bars = np.array(level_bars(TONES, values, error, decay), dtype=float)
    exact = [max(abs(decay(tone * (1 + end)) - decay(tone)) for end in (-error, error)) for tone in TONES]
    near = np.abs(TONES - edge) < 2.0 * error * edge
    assert near.sum() == 2 and bars[near] == pytest.approx(np.array(exact)[near], rel=1e-9)
    assert (bars >= 0.8 * np.array(exact)).all()  # between samples the square root lies at most a fifth above its chord


def test_without_an_estimate_or_a_level_there_is_no_bar() -> None:
    assert level_bars(TONES, TONES, None, never) == [None] * len(TONES)
    values = np.full(len(TONES), np.nan)
    values[:30] = 1.0
    bars = level_bars(TONES, values, 1e-3, lambda tone: 1.0 if tone < 37.3e3 else None)
    assert bars[:28] == [0.0] * 28 and bars[30:] == [None] * 11
    assert level_bars(TONES[:1], np.array([1.0]), 1e-3, lambda tone: tone / 30e3) == [pytest.approx(1e-3)]
