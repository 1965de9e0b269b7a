"""The bar of a forced motion's level holds every stiffness whose frequencies lie within theirs; which functions the bars of a
column's frequencies leave out.
"""

from __future__ import annotations

import numpy as np
import pytest

from geometry.hex.scenes import HexSettings
from geometry.materials import MATERIALS, Stack
from geometry.tiling import Panel
from solvers.accuracy.reduction import last_bubbles, last_layer
from solvers.plates.assembled import Reductions
from solvers.plates.column import forced_bars
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.waves.complex_bands import Row

QUALITY, ERROR = 50.0, 2e-3
RANDOM = np.random.default_rng(3)
VALUE = np.array([1.0, 1.3, 1.36, 2.2, 4.0])
FORCE = RANDOM.normal(size=5) + 1j * RANDOM.normal(size=5)
PARTS = [(RANDOM.uniform(1.0, 2.0, 12), RANDOM.normal(size=(12, 5))) for _ in range(2)]
MOVED = np.linspace(0.9, 2.4, 76)


def levels(change: np.ndarray) -> np.ndarray:
    """Level in dB of one part over the other with a stiffness changed by a symmetric matrix (5, 5)."""
    stiffness = (np.diag(VALUE) + change) * (1.0 + 1j / QUALITY)
    shares = np.array([np.linalg.solve(stiffness - moved * np.eye(5), FORCE) for moved in MOVED]).T
    inside, outside = (weights @ np.abs(values @ shares) ** 2 for weights, values in PARTS)
    return 10.0 * np.log10(inside / outside)


def bars(mixed: float) -> np.ndarray:
    return forced_bars(PARTS, FORCE, VALUE, MOVED, QUALITY, np.full(5, ERROR), mixed)


@pytest.mark.parametrize("seed", range(20))
def test_frequencies_anywhere_within_their_bars_leave_the_level_within_its_own(seed: int) -> None:
    factor = 1.0 + ERROR * np.random.default_rng(seed).uniform(-1.0, 1.0, 5)
    assert (np.abs(levels(np.diag(VALUE * (factor**2 - 1.0))) - levels(np.zeros((5, 5)))) <= bars(0.0)).all()


def test_modes_mixed_with_random_signs_change_the_level_by_its_bar_at_most() -> None:
    """Root mean square over forty draws of what mixes to first order; that of a sample may lie a fifth above its own."""
    most, squares = 1e-3 * 2.0 * ERROR * np.sqrt(np.outer(VALUE, VALUE)), np.zeros(len(MOVED))
    for seed in range(40):
        sign = np.triu(np.random.default_rng(seed).choice([-1.0, 1.0], (5, 5)), 1)
        squares += (levels(most * (sign + sign.T)) - levels(np.zeros((5, 5)))) ** 2 / 40.0
    assert (1e3 * np.sqrt(squares) <= 1.2 * (bars(1.0) - bars(0.0))).all()


def test_functions_of_the_last_degree_are_those_that_a_lower_interface_lacks() -> None:
    """On a row's lower and upper edge and on the side within, through the thickness as along the sides."""
    reduction = ReductionSettings(Interface(4, 3), 300e3, HexSettings(3, 2e-3, 0, 0.2, 3e-3))
    panel = Panel((-2e-3, -2e-3), (2e-3, 2e-3), None, (0, 1))
    row = Row(Reductions(Stack.of(2e-3, MATERIALS["aluminium"]), None, reduction).cell(panel), 204.0)
    face, moves = row.cell.interface, row.transform != 0.0
    for part, lower in ((last_layer, Interface(4, 2)), (last_bubbles, Interface(3, 3))):
        own = np.isin(np.arange(row.cell.dof), face.within(lower)) | (np.arange(row.cell.dof) >= face.count)
        of_last = moves[~own].any(axis=0)
        assert not (of_last & moves[own].any(axis=0)).any()
        assert np.array_equal(np.unique(row.periodic.ties.open_column[part(row.cell)]), np.flatnonzero(of_last))
