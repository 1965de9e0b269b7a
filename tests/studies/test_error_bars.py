"""The page of error bars leaves out no part, and its scenes are the same each time."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pytest

from geometry.layout import Design
from geometry.materials import MATERIALS
from studies import error_bars
from studies.error_bars import SEED, Compared, described, of_block, paired


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


@pytest.mark.parametrize("part", error_bars.PARTS)
def test_scenes_are_the_same_each_time_and_those_of_another_seed_are_others(part: str) -> None:
    first, again, other = ([repr(scene) for scene in error_bars.scenes(part, 3, seed)] for seed in (SEED, SEED, 7))
    assert first == again and not [scene for scene in first if scene in other]
    assert [repr(scene) for scene in error_bars.scenes(part, 2)] == first[:2]
    assert all(described(scene) for scene in error_bars.scenes(part, 2))


def test_a_mode_that_either_list_lacks_lies_outside_every_bar() -> None:
    for ours, theirs in (([(2.0, 0.1), (1.0, 0.1)], [1.0]), ([(1.0, 0.1)], [1.0, 2.0])):
        error, bar = paired(ours, np.array(theirs))
        assert error.tolist() == [0.0, np.inf] and bar[0] == 0.1 and np.isfinite(bar[1])


@pytest.mark.slow
def test_a_block_of_any_material_is_compared_with_its_exact_solution(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(error_bars, "BLOCK_MODES", 2)
    monkeypatch.setattr(error_bars, "DEGREES", (8, 8, 8))
    design = Design(20e-3, 15e-3, 8e-3, 1, MATERIALS["brass"], None, *[np.nan] * 2, 0, 0.0)
    result = of_block("block", "superelement", design)
    assert len(result.error) >= 2 and result.within == 1.0


def test_one_mesh_is_not_compared_with_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    alike = error_bars.Compared("zone", "a plate", np.zeros(3), np.full(3, 1e-3))
    monkeypatch.setitem(error_bars.PARTS, "zones", error_bars.Part(lambda _: alike, 1))
    with pytest.raises(RuntimeError, match="not a digit differs"):
        error_bars.compare({"zones": 1})
