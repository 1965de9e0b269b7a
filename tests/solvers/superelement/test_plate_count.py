"""What a reduced plate may miss of its meshes: counted, and told without any fixed-interface mode to extrapolate from."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS, Stack
from solvers.accuracy.reduction import mode_errors, more_below
from solvers.fem.eigen import modes_in_band
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement import plate as plate_module
from solvers.superelement.interface import Interface, ReductionSettings

STEEL = MATERIALS["steel"]
PILLAR = Pillar("square", 1.8e-3, 1.8e-3, 5e-3, STEEL)
DESIGN = Design(16e-3, 8e-3, 1.5e-3, 2, STEEL, PILLAR, 4e-3, 4e-3, 1, 4e-3)
BARE = Design(16e-3, 8e-3, 1.5e-3, 2, STEEL, None, 4e-3, 4e-3, 0, 8e-3)
MESH = HexSettings(order=3, size_m=4e-3, layers=0, pillar_size_m=2.5e-3)
FINE_HZ = 3e6


@lru_cache
def model(top_hz: float, pillars: bool) -> PlateModel:
    design = DESIGN if pillars else BARE
    reduction = ReductionSettings(Interface(3, 3), top_hz, MESH)
    return PlateModel(design, Reductions(Stack.of(design.thickness_m, STEEL), design.pillar, reduction))


def count(top_hz: float, edge_hz: float, pillars: bool) -> int:
    return len(modes_in_band(model(top_hz, pillars).pencil("SS"), 100.0, edge_hz).frequency_hz)


@pytest.mark.parametrize(
    "edge_hz",
    [
        pytest.param(60e3, marks=pytest.mark.slow),
        pytest.param(90e3, marks=pytest.mark.slow),
        pytest.param(120e3, marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("pillars", [True, False])
def test_the_meshes_have_no_more_modes_than_the_bound_allows(edge_hz: float, pillars: bool) -> None:
    """The same meshes with all modes to 3 MHz stand for themselves; a model made for a sixth of the frequency misses some."""
    top_hz = 1.2 * edge_hz
    coarse = model(top_hz, pillars)
    more = more_below(coarse.assembled("SS"), coarse.pencil("SS"), edge_hz)
    missing = count(FINE_HZ, edge_hz, pillars) - count(top_hz, edge_hz, pillars)
    assert more is not None and 0 <= missing <= more


def test_a_reduction_that_loses_modes_says_so() -> None:
    """Bare panels reduced for 2 kHz have no mode of their own left: what they miss below 300 kHz is not small, and is told."""
    coarse = model(2e3, False)
    assert all(not len(cell.fixed_hz) for cell in coarse.cells.values())
    edge_hz = 300e3
    more = more_below(coarse.assembled("SS"), coarse.pencil("SS"), edge_hz)
    assert more is not None and more >= count(FINE_HZ, edge_hz, False) - count(2e3, edge_hz, False) >= 1


def test_above_the_modes_left_out_nothing_is_bounded() -> None:
    coarse = model(2e3, True)
    lowest = min(cell.dropped_hz for cell in coarse.cells.values())
    assert more_below(coarse.assembled("SS"), coarse.pencil("SS"), 1.01 * lowest) is None


@pytest.mark.slow
@pytest.mark.parametrize(("top_hz", "pillars"), [(2e3, False), (400e3, True), (700e3, False)])
def test_the_estimate_is_the_true_error_to_first_order(top_hz: float, pillars: bool) -> None:
    """Residual flexibility: within 5 % of the rise over the same meshes with all modes to 3 MHz, where that is below 0.5 %."""
    coarse, fine = model(top_hz, pillars), model(FINE_HZ, pillars)
    band = (15e3, 60e3) if pillars else (15e3, 110e3)
    ours, theirs = (modes_in_band(each.pencil("SS"), *band) for each in (coarse, fine))
    assert len(ours.frequency_hz) == len(theirs.frequency_hz) > 1
    rise = ours.frequency_hz / theirs.frequency_hz - 1.0
    text = mode_errors(coarse.assembled("SS"), coarse.pencil("SS"), ours.vectors).modes
    small = (rise < 0.005) & (rise > 1e-7)
    assert small.any() and np.abs(text[small] / rise[small] - 1.0).max() < 0.05
    assert (text[~small] >= 0.0).all()


def test_what_rounding_leaves_of_entries_that_symmetry_makes_zero_is_not_stored(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two fixed-interface modes of a cell do not mix: half of what was stored was rounding, and filled every factor."""
    plate = model(FINE_HZ, False).assembled("SS")
    clean = plate.pencil()
    monkeypatch.setattr(plate_module, "DROP_TOLERANCE", 0.0)
    whole = plate.pencil()
    assert clean.mass.nnz < 0.7 * whole.mass.nnz
    for one, other in ((clean.stiffness, whole.stiffness), (clean.mass, whole.mass)):
        size = np.sqrt(other.diagonal())
        left = abs(one - other).tocoo()
        assert (
            left.data <= 4e-14 * size[left.row] * size[left.col]
        ).all()  # no entry is the sum of more than four panels'


def test_the_touch_face_in_parts_is_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """No panel is left out or counted twice, and the last part may be smaller."""
    plate = model(2e3, False).assembled("SS")
    monkeypatch.setattr(plate_module, "CELLS", 4)
    assert len(plate.placed_cells) > 4 and len(plate.placed_cells) % 4
    vectors = np.random.default_rng(1).normal(size=(plate.dof, 2))
    whole, parts = plate.touch(vectors), list(plate.touch_parts(vectors))
    assert len(parts) > 1
    for name in ("points", "weights", "values"):
        assert np.array_equal(np.concatenate([getattr(part, name) for part in parts]), getattr(whole, name)), name
