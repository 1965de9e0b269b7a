"""How high a bonded patch drives a plate, beside a solid that shares its nodes with the patch's, refined towards its edges."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from geometry.elements import FloatArray
from geometry.hex.boxes import HexSettings
from geometry.hex.grading import Grading, grid_lines
from geometry.layout import Design
from geometry.materials import MATERIALS
from geometry.piezo_materials import PIEZO_MATERIALS
from solvers.fem.assembly import assemble
from solvers.fem.eigen import PlainPencil, modes_in_band
from solvers.fem.surface import face_quadrature
from solvers.piezo.forced import Drive, ForcedPlate
from solvers.piezo.patch import bonded_patch
from solvers.piezo.patched_plate import CLASSES, PatchedPlate
from solvers.superelement.build import PlateModel, Reductions, ReductionSettings
from solvers.superelement.interface import Interface
from tests.helpers.bodies import bricks
from tests.helpers.bonded_solid import SAME_M, bonded_solid

ALUMINIUM, PZ26 = MATERIALS["aluminium"], PIEZO_MATERIALS["pz26"]
DESIGN = Design(24e-3, 10e-3, 2e-3, 2, ALUMINIUM, None, float("nan"), float("nan"), 0, 3e-3)
PATCH_M, PATCH_THICK_M, BAND_HZ = np.array([-4e-3, 4e-3, -2e-3, 2e-3]), 0.5e-3, (15e3, 80e3)
HIGH = 0.10  # of the height: what docs/decisions/0009-bonded-patches.md tells of the model's stiffness beneath a patch


def conforming(layers: int) -> tuple[FloatArray, FloatArray]:
    """Frequencies in Hz and heights of the modes that the patch drives: a quarter of plate and patch as one solid."""
    grading, back = Grading(2e-3, layers, 0.3), DESIGN.thickness_m
    x = grid_lines({0.0: False, PATCH_M[1]: True, DESIGN.length_m / 2.0: False}, grading)
    y = grid_lines({0.0: False, PATCH_M[3]: True, DESIGN.half_span_m: False}, grading)
    plate = bricks((x, y, grid_lines({0.0: False, back: True}, grading)), 3)
    patch = bricks((x[x < PATCH_M[1] + SAME_M], y[y < PATCH_M[3] + SAME_M], np.array([0.0, PATCH_THICK_M])), 3)
    system = assemble(plate, {"body": ALUMINIUM})
    joined, scale = bonded_solid(system, patch, PZ26, PATCH_THICK_M), system.scale
    unit = scale.young_pa * scale.length_m
    sides = joined.place_nm[:, :2] != 0
    free = np.flatnonzero(np.column_stack([sides, np.ones(len(sides), dtype=bool)]))  # between two mirrors
    scaled = joined.stiffness / unit, joined.mass / scale.mass_kg
    modes = modes_in_band(PlainPencil(*(sp.csc_array(each[free][:, free]) for each in scaled), scale, 1), *BAND_HZ)
    moved = np.zeros((3 * len(sides), modes.vectors.shape[1]))
    moved[free] = modes.vectors
    touch = face_quadrature(plate, "touch")
    heave = touch.interpolation @ (joined.plate.T @ moved)[2::3]
    return modes.frequency_hz, height(modes.frequency_hz, joined.load / unit @ moved, heave, touch.weights)


def height(frequency_hz: FloatArray, gain: FloatArray, heave: FloatArray, weights: FloatArray) -> FloatArray:
    """Mean-square u_z of each mode's peak on the touch face over volts, up to one factor for all."""
    return np.abs(gain) * np.sqrt(weights @ heave**2 / weights.sum()) / frequency_hz**2


def reduced() -> tuple[FloatArray, FloatArray]:
    """The same of the plate of reduced cells with its patch."""
    settings = ReductionSettings(Interface(6, 3), 540e3, HexSettings(3, 4e-3, 0, 0.2), 6e-3)
    made = PlateModel(DESIGN, Reductions(DESIGN.thickness_m, ALUMINIUM, None, settings))
    plates = {symmetry: made.assembled(symmetry) for symmetry in CLASSES}
    patch = bonded_patch(PZ26, PATCH_M, PATCH_THICK_M, True)
    plate = PatchedPlate(plates, [patch], True, flexibility=made.residual_flexibility)
    forced = ForcedPlate(plate, DESIGN, Drive((0,), (), BAND_HZ, 100.0), (1.0, 1.0))
    group = next(each for each in forced.modes if "SS" in each.group.symmetries)
    field = group.group.touch(group.columns)[0]
    heave = field.values[:, : len(group.frequency_hz)]
    return group.frequency_hz, height(group.frequency_hz, group.gain[:, 0], heave, field.weights)


@pytest.mark.slow
def test_a_peaks_height_lies_within_what_the_decision_tells() -> None:
    """Refined by a layer the solid comes down by 1 %; the reduced plate, stiffer beneath a patch, stands above both."""
    (tones, coarse), (_, fine), (ours_hz, ours) = conforming(1), conforming(2), reduced()
    assert len(tones) == len(ours_hz) == 3 and np.abs(ours_hz / tones - 1.0).max() < 0.005
    assert (coarse > fine).all() and (coarse / fine).max() < 1.02
    error = ours / fine - 1.0
    print(f"heights above a conforming solid's: {', '.join(f'{each:.1%}' for each in error)}")
    assert (error > 0.0).all() and error.max() < HIGH
