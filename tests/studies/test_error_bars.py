"""The page of error bars leaves out no part, and its scenes are the same each time."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np

from studies import error_bars
from studies.error_bars import Compared


def results() -> list[Compared]:
    """One frequency within its bar and one outside of it for every part."""
    return [Compared(part, "a scene", np.array([1e-4, 3e-4]), np.array([2e-4, 2e-4])) for part in error_bars.PARTS]


def test_every_part_is_drawn_and_told() -> None:
    figure = error_bars.drawn(results())
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [*error_bars.PARTS, "bar = error"]
    plt.close(figure)
    page = error_bars.page(results())
    assert all(f"| {part} | 2 | 50.0% | 1.50 |" in page for part in error_bars.PARTS)


def test_scenes_are_the_same_each_time_and_those_of_another_seed_are_others() -> None:
    first, again, other = ([*error_bars.designs(3, seed)] for seed in (error_bars.SEED, error_bars.SEED, 7))
    assert first == again and not [design for design in first if design in other]
    assert {error_bars.described(design) for design in error_bars.designs(2)} == {
        error_bars.described(design) for design in error_bars.designs(3, error_bars.SEED)
    } - {error_bars.described(first[2])}


def test_every_part_has_a_number_of_scenes() -> None:
    assert list(error_bars.COUNTS) == list(error_bars.PARTS)
