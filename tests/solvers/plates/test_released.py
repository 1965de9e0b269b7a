"""A plate without its soft supports from the same plate with them: counts without a factorisation, and its modes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import eigsh

from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS
from geometry.supports import SOFT, Support
from pipeline.planning.resource_estimate import softness
from solvers.fem.eigen import Modes, Shared, count_below, modes_in_band
from solvers.plates.assembled import PlateModel, Reductions
from solvers.plates.released import released
from solvers.superelement.interface import Interface, ReductionSettings

GLASS, ALUMINIUM = MATERIALS["glass"], MATERIALS["aluminium"]
BAND = 20e3, 60e3
SETTINGS = ReductionSettings(Interface(3, 2), 150e3, HexSettings(2, 2e-3, 0), max_edge_m=5e-3, bare_size_m=2e-3)
PLATE = Design(
    8e-3, 8e-3, 0.7e-3, 1, GLASS, Pillar("square", 1.5e-3, 1.5e-3, 2.5e-3, ALUMINIUM), 4e-3, 4e-3, 1, 0.0,
    centre_m=(1.5e-3, -1e-3), larger_m=(32e-3, 29e-3), surround=True,
)  # fmt: skip
FOAM = Support("foam", edge="y-", bedding_n_m2=1e4)
SPRING = Support("spring", at_m=(-13e-3, 11e-3), radius_m=0.5e-3, stiffness_n_m=1e2)
MASS = Support("mass", at_m=(13e-3, 11e-3), radius_m=0.5e-3, mass_kg=1e-9)
SUPPORTS = {"foam": (FOAM,), "spring": (SPRING,), "mass": (MASS,), "all": (FOAM, SPRING, MASS)}
NAMES = [pytest.param(name, marks=[] if name == "all" else pytest.mark.slow) for name in SUPPORTS]


@cache
def solved(name: str) -> tuple[PlateModel, Modes]:
    design = replace(PLATE, supports=SUPPORTS[name])
    model = PlateModel(design, Reductions(design.stack, design.pillar, SETTINGS))
    return model, modes_in_band(model.pencil(None), *BAND)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_counts_are_those_of_a_factorisation(name: str) -> None:
    model, modes = solved(name)
    loose = model.released(None)
    span = released(model.assembled(None), modes.count, modes.frequency_hz)
    assert (
        loose and span and BAND[0] <= span.ends_hz[0] < 1.01 * BAND[0] and 0.99 * BAND[1] < span.ends_hz[1] <= BAND[1]
    )
    assert len(span.counts) == 2
    pencil = loose.pencil(None)
    assert pencil.rigid_count == 6
    for end, (value, counted) in zip(span.ends_hz, span.counts.items(), strict=True):
        assert value == pencil.scale.eigenvalue(end) and counted == count_below(pencil, end)
    assert span.within(BAND) == span.ends_hz and span.within((10e3, 70e3)) == (10e3, 70e3)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_no_motion_meets_more_of_a_support_than_the_bound(name: str) -> None:
    """E <= t (K + l M) and F <= f (M + K / l), by the largest eigenvalues of the plate, near the worst panel's."""
    model, _ = solved(name)
    plate, loose = model.assembled(None), model.released(None)
    assert loose
    own, other = plate.pencil(), loose.pencil(None)
    value = own.scale.eigenvalue(BAND[0])
    resisting = sp.csc_array(other.stiffness + value * other.mass)
    parts = own.stiffness - other.stiffness, value * (own.mass - other.mass)
    for bound, part in zip(plate.softness(value), parts, strict=True):
        largest = (
            eigsh(part, 1, resisting, which="LA", tol=1e-10, return_eigenvectors=False)[0] if abs(part).max() else 0.0
        )
        assert largest <= bound * (1.0 + 1e-9) + 1e-14 and bound <= 30.0 * largest + 1e-12


@pytest.mark.slow
def test_a_mode_at_the_end_of_the_interval_leaves_its_count_open() -> None:
    model, modes = solved("foam")
    top = float(modes.frequency_hz[-1]) * (1.0 + 1e-7)
    narrow = modes_in_band(model.pencil(None), BAND[0], top)
    span = released(model.assembled(None), narrow.count, narrow.frequency_hz)
    assert span and len(span.counts) == 1


@pytest.mark.slow
def test_stiff_supports_are_not_released() -> None:
    for support in (replace(FOAM, bedding_n_m2=1e8), replace(MASS, mass_kg=1e-4)):
        model, modes = solved("foam")
        design = replace(PLATE, supports=(support,))
        other = PlateModel(design, model.reductions)
        assert max(other.assembled(None).softness(other.scale.eigenvalue(BAND[0]))) > SOFT
        assert released(other.assembled(None), modes.count, modes.frequency_hz) is None
    held = replace(PLATE, supports=(Support("clamp", edge="y-"),))
    assert PlateModel(held, model.reductions).released(None) is None


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_modes_follow_from_those_with_supports(name: str) -> None:
    """From one factor and as many solves; not from modes of which one is missing."""
    model, modes = solved(name)
    loose = model.released(None)
    span = released(model.assembled(None), modes.count, modes.frequency_hz)
    assert loose and span
    pencil = loose.pencil(None)
    truth = modes_in_band(pencil, *span.ends_hz)
    shared = Shared(guess=modes.vectors, counts=dict(span.counts))
    found = modes_in_band(pencil, *span.ends_hz, shared)
    assert found.factorisations == 1 and truth.factorisations == 3
    assert found.frequency_hz == pytest.approx(truth.frequency_hz, rel=1e-7)
    alike = np.abs(found.vectors.T @ pencil.apply_mass(truth.vectors))
    assert (alike.max(axis=1) > 1.0 - 1e-5).all()
    fewer = modes_in_band(pencil, *span.ends_hz, Shared(guess=modes.vectors[:, 1:], counts=dict(span.counts)))
    assert fewer.frequency_hz == pytest.approx(truth.frequency_hz, rel=1e-10) and fewer.factorisations > 1


def test_the_bound_of_a_plate_of_two_panels_is_nearly_met() -> None:
    design = Design(8e-3, 6e-3, 0.7e-3, 0, GLASS, None, 8e-3, 8e-3, 0, 0.0, supports=(FOAM,))
    settings = replace(SETTINGS, max_edge_m=9e-3)
    model = PlateModel(design, Reductions(design.stack, None, settings))
    plate, loose = model.assembled(None), model.released(None)
    assert loose and len(plate.placed_cells) == 2
    own, other = plate.pencil(), loose.pencil(None)
    value = own.scale.eigenvalue(BAND[0])
    resisting = sp.csc_array(other.stiffness + value * other.mass)
    largest = eigsh(own.stiffness - other.stiffness, 1, resisting, which="LA", return_eigenvectors=False)[0]
    assert largest < plate.softness(value)[0] < 1.9 * largest and plate.softness(value)[1] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["foam", "spring", "mass"])
def test_a_plan_knows_how_soft_supports_are(name: str) -> None:
    """The estimate bounds the worst panel's share, and is at most four times as large."""
    design = replace(PLATE, supports=SUPPORTS[name])
    plate = PlateModel(design, Reductions(design.stack, design.pillar, SETTINGS)).assembled(None)
    exact = max(plate.softness(plate.scale.eigenvalue(BAND[0])))
    assert exact <= softness(design, plate.tiling, BAND[0]) <= 4.0 * exact


@pytest.mark.slow
def test_foam_leaves_the_pattern_of_the_plate_and_so_its_symbolic_analysis(analysed: list[int]) -> None:
    """What orthogonal functions leave of a foam by rounding would be entries of its own."""
    design = replace(PLATE, supports=(FOAM,))
    model = PlateModel(design, Reductions(design.stack, design.pillar, SETTINGS))
    analysed.clear()  # of the cells
    for each in (model, model.released(None)):
        assert each
        count_below(each.pencil(None), BAND[0], each.assembled(None).factorise)
    assert len(analysed) == 1
