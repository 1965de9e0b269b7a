"""Levels and shares are of the zone itself: whatever stands beside its border, integrals over the touch face end there.

For any motion 10^(level / 10) (1 - share) / share is the passive area over the zone's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
import pytest

from geometry.elements import FloatArray
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS, Stack
from geometry.mesh import Mesh
from geometry.tet.scenes import tet_panel, tet_plate
from geometry.tiling import Panel
from pipeline.case.model import load_case
from pipeline.logs import TerminalLog
from pipeline.models.modes import Request, solve_modes
from solvers.driven.several_patches import zones_of
from solvers.fem.solid import SolidModel
from solvers.measures.confinement import TouchField, measure
from solvers.piezo.forced import Drive, ForcedPlate
from solvers.piezo.patched_plate import PressedPlate
from solvers.plates.assembled import PlateModel, Reductions
from solvers.plates.column import Column
from solvers.superelement.interface import Interface, ReductionSettings

AREAS = 1e-6  # relative: what the areas of zone and passive face must hold
ALUMINIUM = MATERIALS["aluminium"]
ROUND = Pillar("round", 2.4e-3, 2.4e-3, 3e-3, ALUMINIUM)
SHAPES = {
    "square": replace(ROUND, shape="square"),
    "round": ROUND,
    "hexagonal": replace(ROUND, shape="hexagonal"),
    "tapered": replace(ROUND, shape="tapered", tip_m=1.6e-3),
    "cross": replace(ROUND, shape="cross", more_m=(("arm_m", 1e-3),)),
}
DESIGN = Design(8e-3, 6e-3, 1.5e-3, 2, ALUMINIUM, ROUND, 4e-3, 4e-3, 1, 1.5e-3)
COARSE = ReductionSettings(Interface(2, 2), 200e3, HexSettings(3, 4e-3, 0, 0.25, 3e-3), 4e-3)
Mesher = Callable[[Panel], Mesh]


def joined(design: Design, mesher: Mesher | None = None) -> PlateModel:
    return PlateModel(design, Reductions(Stack.of(design.thickness_m, ALUMINIUM), design.pillar, COARSE, None, mesher))


def passive_over_zone(design: Design) -> float:
    """Of a touch face that nothing hangs from."""
    return (2.0 * design.half_span_m - design.zones * design.width_m) / (design.zones * design.width_m)


def check(touch: TouchField, design: Design, symmetry: str | None) -> None:
    """The identity for random motions, and the area beyond the last row."""
    own = measure(touch, design, symmetry)
    ratio = 10.0 ** (own.confinement_db / 10.0) * (1.0 - own.zone_share) / own.zone_share
    assert ratio == pytest.approx(passive_over_zone(design), rel=AREAS)
    whole = touch.weights.sum()
    beyond = touch.weights[np.abs(touch.points[:, 1]) > design.half_span_m - design.extension_m].sum()
    assert beyond / whole == pytest.approx(design.extension_m / design.half_span_m, rel=AREAS)


def some(count: int) -> FloatArray:
    return np.random.default_rng(4).normal(size=(count, 3))


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES)
def test_the_zone_ends_at_its_border_for_every_shape(shape: str) -> None:
    design = replace(DESIGN, pillar=SHAPES[shape])
    model = joined(design)
    check(model.touch("SS", some(model.assembled("SS").dof)), design, "SS")


@pytest.mark.slow
def test_a_column_s_zone_ends_at_its_border() -> None:
    """What search and explorer rank designs by."""
    column = Column(DESIGN, Reductions(Stack.of(DESIGN.thickness_m, ALUMINIUM), ROUND, COARSE), pi / 5e-3)
    profile = column.profile(some(column.dof).astype(complex))
    zone = profile.weights[profile.y_m < DESIGN.width_m / 2.0].sum()
    assert zone == pytest.approx(DESIGN.pitch_x_m * DESIGN.width_m / 2.0, rel=AREAS)
    assert profile.weights.sum() == pytest.approx(DESIGN.pitch_x_m * DESIGN.half_span_m, rel=AREAS)


@pytest.mark.slow
def test_driven_zones_end_at_their_borders() -> None:
    """Response, tolerance and touch share the Gram matrices of the forced plate, crosstalk has its own of every zone."""
    model = joined(DESIGN)
    pressed = PressedPlate({"SS": model.assembled("SS")}, DESIGN, model.name)
    forced = ForcedPlate(pressed, DESIGN, Drive((0,), (), (30e3, 60e3), 100.0))
    zone, passive = forced.areas_m2
    assert zone == pytest.approx(DESIGN.length_m * DESIGN.width_m, rel=AREAS)
    assert passive is not None and passive / zone == pytest.approx(passive_over_zone(DESIGN), rel=AREAS)
    tones = np.array([40e3])
    curve, ours = forced.curve(tones), zones_of(forced).rms(forced.signs, tones)
    assert ours[:, 0] == pytest.approx(curve.zone_rms_m_per_v, rel=1e-9)


def test_every_zone_of_several_ends_at_its_borders() -> None:
    design = replace(DESIGN, width_m=4e-3, zones=2, shared_rows=1, zone_gap_m=2.4e-3)
    model = joined(design)
    touch = model.touch("SS", some(model.assembled("SS").dof))
    own = np.abs(design.from_zone_m(touch.points[:, 1])) < design.width_m / 2.0
    assert touch.weights[own].sum() == pytest.approx(2.0 * design.length_m * design.width_m, rel=AREAS)


@pytest.mark.slow
@pytest.mark.parametrize("pillar", [ROUND, replace(ROUND, fillet_m=0.3e-3)], ids=["round", "filleted"])
def test_tetrahedra_end_at_the_border(pillar: Pillar) -> None:
    """Cells of tetrahedra beside cells of hexahedra, and the whole body as tetrahedra."""
    design = replace(DESIGN, pillar=pillar)
    model = joined(design, lambda panel: tet_panel(design, panel, 1.5e-3))
    check(model.touch("SS", some(model.assembled("SS").dof)), design, "SS")
    mesh = tet_plate(design, 1.5e-3, True)
    solid = SolidModel(
        mesh, {"body": ALUMINIUM, "plate": ALUMINIUM, "pillar": ALUMINIUM}, (), True, design.touch_lines_m
    )
    check(solid.touch("SS", some(solid.pencil("SS").dof)), design, "SS")


CASE = """name = "plate"
material = "aluminium"
plate = { thickness_mm = 1.5 }
zone = { length_mm = 8, width_mm = 6, nodal_lines = 2 }
array = { pitch_mm = 4, rows = 1, extension_mm = 1.5 }
solve = { accuracy = 0.1 }
"""


@pytest.mark.slow
@pytest.mark.parametrize("model", ["auto", "solid"])
def test_step_pillars_end_at_the_border(model: str, tmp_path: Path) -> None:
    """A cylinder from a STEP file: assembled without symmetry, and the whole body as one mesh."""
    from geometry.cad.printing import write_step
    from geometry.cad.solids import pillar_solid

    write_step(pillar_solid(replace(ROUND, height_m=3e-3)), tmp_path / "round.step")
    file = tmp_path / "case.toml"
    file.write_text(f'{CASE}pillar = {{ shape = "step", file = "round.step" }}\n')
    case = load_case(file)
    case = replace(case, solve=case.solve.but(model=model))
    solved = solve_modes(case, Request("plate", band_hz=(60e3, 120e3)), TerminalLog(True))
    assert solved.rows
    symmetry = solved.rows[0].symmetry
    check(solved.model.touch(symmetry, solved.vectors[symmetry]), case.design, symmetry)
