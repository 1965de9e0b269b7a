"""One answer from every window, and no mode outside what was searched can overturn a single one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest

from solvers.measures.target_mode import LEAD, Found, Largest, measures, search, verdict, weights

WINDOW = (30.0, 60.0)


@dataclass(frozen=True)
class Mode:
    frequency_hz: float
    strength: float
    zone_share: float
    mac: float


@dataclass
class Plate:
    """Modes drawn over frequency, and what was computed of them."""

    modes: tuple[Mode, ...]
    solved: list[tuple[float, float]] = field(default_factory=list)

    def between(self, low_hz: float, high_hz: float) -> list[Mode]:
        self.solved.append((low_hz, high_hz))
        return [mode for mode in self.modes if low_hz <= mode.frequency_hz < high_hz]

    def found(self, known_hz: tuple[float, float] = WINDOW, largest: Largest[Mode] | None = None) -> Found[Mode]:
        known = [m for m in self.modes if known_hz[0] <= m.frequency_hz < known_hz[1]]
        return search(WINDOW, known_hz, known, self.between, largest)

    def bound(self, modes: Sequence[Mode], reach_hz: tuple[float, float]) -> float:
        """The best bound there is."""
        return max((m.strength for m in self.modes if not reach_hz[0] <= m.frequency_hz <= reach_hz[1]), default=0.0)


def drawn(seed: int) -> Plate:
    """A plate whose strengths sum to 1, a few of them large."""
    random = np.random.default_rng(seed)
    count = int(random.integers(6, 30))
    strength = random.dirichlet(np.full(count, 0.15))
    tones, shares, macs = (
        random.uniform(2.0, 200.0, count),
        random.uniform(0.1, 1.0, count),
        random.uniform(0.3, 1.0, count),
    )
    macs[np.argmax(strength)] = random.uniform(0.8, 1.0)
    return Plate(tuple(map(Mode, tones, strength, shares, macs)))


def test_no_mode_outside_can_overturn_a_single_one() -> None:
    """All modes of the plate judged together, or the whole missing strength in one mode of the best shape, change nothing."""
    singles = 0
    for seed in range(400):
        plate = drawn(seed)
        found = plate.found()
        if found.verdict.status != "single":
            continue
        singles += 1
        best = found.modes[found.verdict.index or 0]
        every = weights(plate.modes)
        own = plate.modes.index(best)
        assert every[own] >= LEAD * np.delete(every, own).max()
        worst = Mode(1.01 * found.reach_hz[1], found.missing, 1.0, 1.0)
        near = [found.window_hz[0] <= m.frequency_hz <= found.window_hz[1] for m in (*found.modes, worst)]
        again = verdict(*measures((*found.modes, worst)), near=np.array(near))
        assert again.status == "single" and again.index == found.verdict.index
    assert singles >= 20  # the draw has something to say


@pytest.mark.parametrize("known_hz", [(32.0, 34.0), (5.0, 40.0), (50.0, 199.0), (1.0, 250.0)])
def test_what_is_known_before_changes_nothing(known_hz: tuple[float, float]) -> None:
    for seed in range(100):
        ours, theirs = drawn(seed).found(), drawn(seed).found(known_hz)
        assert (ours.verdict, ours.modes, ours.reach_hz) == (theirs.verdict, theirs.modes, theirs.reach_hz)


def test_a_bound_of_one_mode_s_strength_saves_solves_and_overturns_nothing() -> None:
    saved = 0
    for seed in range(400):
        plate, other = drawn(seed), drawn(seed)
        found, without = plate.found(largest=plate.bound), other.found()
        saved += len(other.solved) - len(plate.solved)
        if found.verdict.status == "single":
            every = weights(plate.modes)
            own = plate.modes.index(found.modes[found.verdict.index or 0])
            assert every[own] >= LEAD * np.delete(every, own).max()
        assert found.verdict.status == "single" or without.verdict.status != "single"
    assert saved >= 20


def test_a_rival_below_the_window_makes_a_split() -> None:
    best, rival = Mode(45.0, 0.3, 1.0, 1.0), Mode(10.0, 0.25, 1.0, 0.9)
    assert Plate((best, rival)).found().verdict.status == "split"
    found = Plate((best, Mode(10.0, 0.15, 1.0, 0.9), *(Mode(70.0 + i, 0.1, 0.1, 0.1) for i in range(4)))).found()
    assert found.verdict.status == "single" and found.reach_hz[0] == 0.0


def test_nothing_more_is_computed_where_no_rival_has_room() -> None:
    plate = Plate((Mode(45.0, 0.8, 1.0, 0.95), Mode(10.0, 0.2, 1.0, 1.0)))
    assert plate.found().verdict.status == "single" and plate.solved == []


def test_a_mode_that_lacks_proof_is_not_single() -> None:
    found = Plate((Mode(45.0, 0.3, 1.0, 0.95),)).found()
    assert found.verdict.status == "split" and found.is_open and found.missing == pytest.approx(0.7)


def test_the_target_mode_carries_most_of_the_shape_and_not_of_the_motion() -> None:
    """The larger score of the two has the smaller weight, for less of it looks like the shape."""
    assert verdict(*np.array([(0.40, 1.0, 0.6), (0.35, 1.0, 0.98)]).T).index == 1
