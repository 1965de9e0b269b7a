"""Which mode is the target mode: by how much of the shape it carries, never by how it looks alone."""

from __future__ import annotations

import numpy as np
import pytest

from solvers.measures.target_mode import LEAD, MAJORITY, WINDOW_MARGIN, verdict, widened_window

NAN = np.nan


def verdict_of(*modes: tuple[float, float, float]) -> tuple[str, int | None, tuple[int, ...]]:
    """Status, index and rivals of modes given as strength, zone share and MAC."""
    result = verdict(*np.array(modes, dtype=float).T)
    return result.status, result.index, result.rivals


def test_a_mode_that_hardly_moves_the_zone_is_not_the_target_one_however_well_it_looks() -> None:
    """A pillar's own mode: MAC and zone share of the best, a tenth of its strength."""
    assert verdict_of((0.03, 0.99, 0.99), (0.30, 0.95, 0.95)) == ("single", 1, ())


@pytest.mark.parametrize("mac", [4e-5, 0.01, 0.49])
def test_no_mode_below_half_of_the_shape_is_the_target_one(mac: float) -> None:
    assert verdict_of((0.9, 0.9, mac)) == ("none", None, ())


def test_without_strength_in_the_shape_there_is_none() -> None:
    assert verdict_of((0.0, 1.0, 1.0)) == ("none", None, ())
    assert verdict_of((NAN, 1.0, 1.0)) == ("none", None, ())


def test_a_plate_without_passive_face_keeps_all_of_its_motion_in_the_zone() -> None:
    assert verdict_of((0.9, NAN, 0.97), (0.05, NAN, 0.9)) == ("single", 0, ())


def test_equal_strength_is_decided_by_what_stays_in_the_zone() -> None:
    assert verdict_of((0.2, 0.3, 0.95), (0.2, 0.9, 0.95))[:2] == ("single", 1)


def test_two_modes_that_carry_the_shape_alike_split_it_and_both_are_named() -> None:
    assert verdict_of((0.21, 0.9, 0.98), (0.20, 0.9, 0.98), (0.01, 0.9, 0.98)) == ("split", 0, (1,))


def test_a_lead_just_above_the_bound_is_clear_and_just_below_it_is_not() -> None:
    for factor, status in ((1.01, "single"), (0.99, "split")):
        assert verdict_of((LEAD * factor * 0.1, 1.0, 0.9), (0.1, 1.0, 0.9))[0] == status


def test_a_mode_that_carries_less_than_all_others_together_is_split_whatever_its_lead() -> None:
    assert verdict_of((0.2, 1.0, 0.9), *[(0.1, 1.0, 0.9)] * 3)[0] == "split"
    assert verdict(*np.array([(0.2, 1.0, 0.9), (0.1, 1.0, 0.9)]).T).share == pytest.approx(2.0 / 3.0)
    assert MAJORITY == 0.5


def test_a_rival_counts_with_what_of_it_looks_like_the_shape() -> None:
    """0.14 is less than LEAD below 0.196, but only half of it is the target shape."""
    assert verdict_of((0.196, 1.0, 0.98), (0.14, 1.0, 0.5))[0] == "single"
    assert verdict_of((0.196, 1.0, 0.98), (0.14, 1.0, 0.98))[0] == "split"


def test_a_vague_shape_is_never_single() -> None:
    assert verdict_of((0.9, 1.0, 0.79))[0] == "split"


def test_the_order_of_the_modes_does_not_matter() -> None:
    modes = np.random.default_rng(3).uniform(0.01, 1.0, (40, 3))
    result = verdict(*modes.T)
    turned = verdict(*modes[::-1].T)
    assert result.index == len(modes) - 1 - turned.index and result.status == turned.status


def test_a_window_is_widened_to_both_sides_and_never_narrowed() -> None:
    assert widened_window((25e3, 45e3), 26e3) == ((1.0 - WINDOW_MARGIN) * 26e3, 45e3)
    assert widened_window((25e3, 45e3), 42e3) == (25e3, (1.0 + WINDOW_MARGIN) * 42e3)
    assert widened_window((25e3, 45e3), 35e3) == (25e3, 45e3)
