"""Bare panels that do without some boundary functions: frequencies of the plate with all of them, and the loss foreseen."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS
from geometry.supports import Support
from geometry.tiling import tile
from solvers.accuracy.reduction import mode_errors
from solvers.fem.eigen import modes_near
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.sparing import needed, rise
from solvers.superelement.supports import full_panels

GLASS, ALUMINIUM = MATERIALS["glass"], MATERIALS["aluminium"]
PILLAR = Pillar("square", 1.5e-3, 1.5e-3, 2.5e-3, ALUMINIUM)
HIGH_HZ, ERROR = 45e3, 1e-4
FOAM = Support("foam", edge="y-", bedding_n_m2=1e5)
SETTINGS = ReductionSettings(
    Interface(4, 3), 3.0 * HIGH_HZ, HexSettings(3, 1.5e-3, 0), max_edge_m=3e-3, bare_size_m=1.5e-3
)
CENTRED = Design(
    6e-3, 6e-3, 0.7e-3, 1, GLASS, PILLAR, 3e-3, 3e-3, 1, 0.0, larger_m=(24e-3, 21e-3), surround=True
)  # fmt: skip
ASIDE = replace(CENTRED, centre_m=(1.5e-3, -1e-3), supports=(FOAM,))


@cache
def model(design: Design, sparing: bool) -> PlateModel:
    settings = replace(SETTINGS, sparing=(HIGH_HZ, ERROR) if sparing else None)
    return PlateModel(design, Reductions(design.stack, design.pillar, settings))


def modes(design: Design, symmetry: str | None, sparing: bool) -> tuple[np.ndarray, np.ndarray, float]:
    """Frequencies of a class, what leaving functions out costs them, and the number of functions."""
    own = model(design, sparing)
    pencil = own.pencil(symmetry)
    found = modes_near(pencil, 0.6 * HIGH_HZ, 8)
    value = np.array([pencil.scale.eigenvalue(tone) for tone in found.frequency_hz])
    return found.frequency_hz, rise(own.assembled(symmetry), value, found.vectors), pencil.dof


@pytest.mark.slow
@pytest.mark.parametrize(
    ("design", "symmetry"), [(ASIDE, None), (CENTRED, "SS"), (CENTRED, "AA")], ids=["aside", "SS", "AA"]
)
def test_frequencies_rise_by_what_is_foreseen(design: Design, symmetry: str | None) -> None:
    """A subspace raises every frequency; the work of the residual on what was left out says by how much."""
    full, nothing, many = modes(design, symmetry, False)
    spared, foreseen, few = modes(design, symmetry, True)
    risen = spared / full - 1.0
    assert not nothing.any() and few < 0.7 * many
    assert (risen > 0.0).all() and (risen <= foreseen).all()
    assert (foreseen <= 3.0 * risen).all()


@pytest.mark.slow
def test_the_loss_is_in_the_bar() -> None:
    plate, pencil = model(ASIDE, True).assembled(None), model(ASIDE, True).pencil(None)
    found = modes_near(pencil, 0.6 * HIGH_HZ, 3)
    value = np.array([pencil.scale.eigenvalue(tone) for tone in found.frequency_hz])
    own = rise(plate, value, found.vectors)
    assert (mode_errors(plate, pencil, found.vectors).degrees >= own).all() and (own > 0.0).all()


def test_panels_about_feet_and_supports_keep_everything() -> None:
    disc = Support("spring", at_m=(-8e-3, 4e-3), radius_m=1e-3, stiffness_n_m=1e4)
    tiling = tile(replace(ASIDE, supports=(FOAM, disc)), 3e-3)
    full = full_panels(tiling)
    assert set(tiling.feet) <= full and {(i, 0) for i in range(len(tiling.x) - 1)} <= full
    at = int(np.searchsorted(tiling.x, -8e-3)) - 1, int(np.searchsorted(tiling.y, 4e-3)) - 1
    assert {(at[0] + i, at[1] + j) for i in (-1, 0, 1) for j in (-1, 0, 1)} <= full
    assert (len(tiling.x) - 2, len(tiling.y) - 2) not in full


@pytest.mark.slow
def test_shorter_waves_need_more_and_too_short_ones_everything() -> None:
    bare = [cell for name, cell in model(ASIDE, False).cells.items() if name[2] == np.inf]
    cells = [max(bare, key=lambda cell: cell.size_m[0])]
    counts = [needed(cells, hertz, ERROR) for hertz in (5e3, 45e3, 120e3)]
    assert all(each is not None for each in counts)
    numbers = [int(each.sum()) for each in counts if each is not None]
    assert numbers == sorted(numbers) and numbers[0] < numbers[-1]
    assert needed(cells, 5e6, ERROR) is None
    nothing = needed(cells, 45e3, 0.0)
    assert nothing is not None and nothing.all()
