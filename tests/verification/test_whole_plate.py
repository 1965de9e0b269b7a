"""A plate that is not its own mirror image, joined whole: against its symmetry classes and against the plate in one piece."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geometry.hex.boxes import VOID, Boxes, hex_mesh, panel_boxes
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS, Stack
from geometry.mesh import Mesh
from geometry.tiling import Panel, signature
from solvers.accuracy.reduction import mode_errors
from solvers.errors import SolverError
from solvers.fem.eigen import modes_in_band
from solvers.fem.solid import CLASSES, SolidModel
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.plate import WHOLE, AssembledPlate

ALUMINIUM = MATERIALS["aluminium"]
BOX = Pillar("square", 1.4e-3, 1.4e-3, 5e-3, ALUMINIUM)
CAD = replace(BOX, shape="step", file="skewed.step")
SHIFT = np.array([1.1e-3, 0.7e-3])  # of the file's pillar from its own axis
DESIGN = Design(16e-3, 12e-3, 2e-3, 2, ALUMINIUM, CAD, 4e-3, 4e-3, 1, 2e-3)
MESH = HexSettings(order=3, size_m=4e-3, layers=0, pillar_size_m=2.5e-3)
BAND_HZ = (20e3, 70e3)
ALIKE = 0.006


def skewed(panel: Panel) -> Mesh:
    """A piece whose pillar stands beside the place that it was given."""
    foot = tuple((np.array(panel.foot) + SHIFT).tolist())
    return hex_mesh(panel_boxes(replace(panel, foot=foot), DESIGN.stack, BOX, MESH), MESH.order)


FINE, COARSE = (
    ReductionSettings(face, hz, MESH, 4e-3) for face, hz in ((Interface(5, 3), 7e5), (Interface(3, 2), 3e5))
)


def joined(design: Design, mesher: object = None, reduction: ReductionSettings = FINE) -> PlateModel:
    return PlateModel(
        design, Reductions(Stack.of(design.thickness_m, ALUMINIUM), design.pillar, reduction, None, mesher)
    )


def in_one_piece(model: PlateModel) -> SolidModel:
    """The whole plate on the union of its pieces' lines."""
    tiling, result = model.tiling, ([], [], [])
    for i in range(len(tiling.x) - 1):
        for j in range(len(tiling.y) - 1):
            panel = tiling.panel(i, j)
            foot = tuple((np.array(panel.foot) + SHIFT).tolist()) if panel.foot else None
            boxes = panel_boxes(replace(panel, foot=foot), DESIGN.stack, BOX, MESH)
            for axis, lines in enumerate((boxes.x, boxes.y)):
                both = np.concatenate([lines, -lines]) if axis in panel.halved else lines
                result[axis].extend(both + panel.middle[axis])
            result[2].extend(boxes.z)
    x, y, z = (np.unique(np.round(line, 10)) for line in result)
    middles = [(line[1:] + line[:-1]) / 2.0 for line in (x, y, z)]
    above = middles[2] > DESIGN.thickness_m
    region = np.where(above, VOID, 0)[None, None, :] * np.ones((len(x) - 1, len(y) - 1, 1), dtype=np.int64)
    for cx, cy in DESIGN.pillar_centres() + SHIFT:
        foot = (np.abs(middles[0] - cx) < BOX.base_m / 2)[:, None, None] & (np.abs(middles[1] - cy) < BOX.base_m / 2)[
            :, None
        ]
        region[foot & above] = 1
    mesh = hex_mesh(Boxes(x, y, z, region, ("plate", "pillar")), MESH.order)
    return SolidModel(mesh, {"plate": ALUMINIUM, "pillar": ALUMINIUM}, (), False)


@pytest.mark.slow
def test_a_skewed_plate_is_the_solid_of_its_meshes() -> None:
    model = joined(DESIGN, skewed)
    solid = in_one_piece(model)
    assert model.symmetries == solid.symmetries == (None,)
    ours, truth = (modes_in_band(m.pencil(None), *BAND_HZ) for m in (model, solid))
    assert ours.rigid_count == truth.rigid_count == 6
    assert len(ours.frequency_hz) == len(truth.frequency_hz) > 10
    above = ours.frequency_hz / truth.frequency_hz - 1.0  # fewer lines than the union of them all, and a reduction
    assert above.min() > 0.0 and above.max() < ALIKE
    apart = np.flatnonzero(np.diff(truth.frequency_hz) > 0.01 * truth.frequency_hz[:-1]) + 1  # near ones mix
    sums = [np.add.reduceat(m.pillar_share(None, f.vectors), [0, *apart]) for m, f in ((model, ours), (solid, truth))]
    assert len(apart) > 5 and np.abs(sums[0] - sums[1]).max() < 0.02
    assert 0.0 < mode_errors(model.assembled(None), model.pencil(None), ours.vectors).total.max() < 0.01
    upright = joined(replace(DESIGN, pillar=BOX))  # a negative control: the feet where the design has them
    others = np.sort(np.concatenate([modes_in_band(upright.pencil(p), *BAND_HZ).frequency_hz for p in CLASSES]))
    assert len(others) != len(truth.frequency_hz) or np.abs(others / truth.frequency_hz - 1.0).max() > 2.0 * ALIKE


@pytest.mark.slow
def test_the_whole_plate_has_the_modes_of_all_mirror_classes() -> None:
    design = replace(DESIGN, pillar=BOX)
    model = joined(design, reduction=COARSE)
    whole = AssembledPlate(model.tiling, every_piece(model), WHOLE)
    apart = np.sort(np.concatenate([modes_in_band(model.pencil(p), *BAND_HZ).frequency_hz for p in CLASSES]))
    together = modes_in_band(whole.pencil(), *BAND_HZ)
    assert together.rigid_count == 6
    assert np.allclose(together.frequency_hz, apart, rtol=1e-7)


def every_piece(model: PlateModel) -> dict:
    """The cells of the negative sides too, each reduced for itself."""
    reductions = Reductions(Stack.of(DESIGN.thickness_m, ALUMINIUM), BOX, COARSE)
    panels = [model.tiling.panel(i, j) for i in range(len(model.tiling.x) - 1) for j in range(len(model.tiling.y) - 1)]
    return {signature(panel): reductions.cell(panel) for panel in {signature(p): p for p in panels}.values()}


@pytest.mark.slow
def test_mirror_classes_of_a_skewed_plate_are_refused() -> None:
    model = joined(DESIGN, skewed, COARSE)
    with pytest.raises(SolverError, match="not its own mirror image"):
        model.assembled("SS")
