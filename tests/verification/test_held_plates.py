"""Plates with pillars, and with patches as those of vibrotactile papers, clamped at two opposite edges: the whole solid."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from geometry.elements import FloatArray
from geometry.hex.boxes import boxes_of, hex_mesh
from geometry.hex.scenes import HexSettings, plate_scene
from pipeline.case.model import Case, case_from_dict
from pipeline.logs import TerminalLog
from pipeline.models.forced import forced_plate
from pipeline.models.modes import solve_modes
from pipeline.planning.model_choice import Request
from solvers.driven.error_bars import frequency_errors
from solvers.fem.assembly import assemble
from solvers.fem.eigen import modes_in_band
from solvers.fem.factor import Factoriser
from solvers.fem.solid import SolidModel
from solvers.fem.surface import SAME_M
from studies.independent import bonded_solid
from tests.helpers.whole_solid import edge_gram
from tests.verification import test_finger_on_a_solid as fingers

CLAMPS = [{"kind": "clamp", "edge": "x-"}, {"kind": "clamp", "edge": "x+"}]
PILLARS: dict[str, Any] = {
    "material": "aluminium", "plate": {"thickness_mm": 2.0}, "zone": {"length_mm": 22.0, "width_mm": 10.0, "nodal_lines": 2},
    "pillar": {"shape": "square", "side_mm": 2.0, "height_mm": 5.0},
    "array": {"pitch_mm": 6.0, "rows": 1, "extension_mm": 3.0}, "solve": {"accuracy": 0.01}, "support": CLAMPS,
}  # fmt: skip
PATCHES = {**fingers.BARE, "solve": {"accuracy": 0.01, "band_kHz": [15.0, 60.0]}, "support": CLAMPS}
OWN = 3e-4  # error of the solid with patches, which a layer less towards the edges changes by at most 1.2e-4
LEFT = 0.28  # of a layer's change at a foot, where displacements go as r^0.55: 1 / (0.25^-1.1 - 1)


def solid_hz(case: Case, band_hz: tuple[float, float], layers: int = 2) -> dict[str | None, FloatArray]:
    """Modes of the quarter with the nodes of its end tied, its elements graded to feet and clamp by a factor of 0.25."""
    scene = plate_scene(case.design, HexSettings(3, 4e-3, layers, 0.25), quarter=True)
    scene.x[case.design.half_length_m] = True
    materials = {"plate": case.design.material, "pillar": case.design.material}
    solid = SolidModel(hex_mesh(boxes_of(scene), 3), materials, ("x+",), True)
    return {name: modes_in_band(solid.pencil(name), *band_hz).frequency_hz for name in ("SS", "AS")}


@pytest.mark.slow
def test_a_clamped_plate_with_pillars_lies_within_its_bars_of_the_whole_solid() -> None:
    case, band_hz = case_from_dict(PILLARS), (1e3, 6e4)
    fine, coarse = (solid_hz(case, band_hz, layers) for layers in (2, 1))
    for symmetry, tones in fine.items():
        left = LEFT * (coarse[symmetry] / tones - 1.0)
        query = Request("plate", band_hz=band_hz, symmetry=symmetry, search=False)
        rows = solve_modes(case, query, TerminalLog(True)).rows
        assert len(rows) == len(tones) > 2
        for row, tone, still in zip(rows, tones.tolist(), left.tolist(), strict=True):
            assert row.error is not None and row.error < 0.01
            assert row.frequency_hz == pytest.approx(tone * (1.0 - still), rel=row.error + still / 2.0)


ON_FOAM: dict[str, Any] = {
    **PILLARS, "material": "glass", "pillar": {**PILLARS["pillar"], "material": "aluminium"},
    "support": [{"kind": "foam", "edge": edge, "stiffness_N_per_m2": 1e9} for edge in ("y-", "y+")],
}  # fmt: skip


def on_foam_hz(case: Case, symmetry: str, band_hz: tuple[float, float], layers: int) -> FloatArray:
    """Modes of a class of the quarter, whose edge face y+ has springs along z spread over it."""
    design, order = case.design, 3
    assert design.pillar is not None
    mesh = hex_mesh(boxes_of(plate_scene(design, HexSettings(order, 4e-3, layers, 0.25), quarter=True)), order)
    pencil = SolidModel(mesh, {"plate": design.material, "pillar": design.pillar.material}, (), True).pencil(symmetry)
    face, product = edge_gram(mesh, "y+", order)
    unit = design.thickness_m * pencil.scale.young_pa * pencil.scale.length_m
    free, number = pencil.free[face, 2], np.cumsum(pencil.free.ravel()) - 1
    springs = product[np.ix_(free, free)] * design.supports[0].bedding_n_m2 / unit
    added, at = sp.coo_array(springs), number[3 * face[free] + 2]
    held = sp.csc_array((added.data, (at[added.row], at[added.col])), shape=pencil.stiffness.shape) + pencil.stiffness
    return modes_in_band(replace(pencil, stiffness=sp.csc_array(held)), *band_hz).frequency_hz


@pytest.mark.slow
def test_a_plate_with_pillars_on_foam_lies_within_its_bars_of_the_whole_solid() -> None:
    """Glass with pillars of aluminium; the foam is stiff enough to lift the rigid motion into the band."""
    case, band_hz = case_from_dict(ON_FOAM), (2e3, 5e4)
    for symmetry, least in (("SS", 5), ("AS", 4)):
        fine, coarse = (on_foam_hz(case, symmetry, band_hz, layers) for layers in (1, 0))
        left = LEFT * (coarse[: len(fine)] / fine - 1.0)
        query = Request("plate", band_hz=band_hz, symmetry=symmetry, search=False)
        rows = solve_modes(case, query, TerminalLog(True)).rows
        assert len(rows) == len(fine) >= least
        for row, tone, still in zip(rows, fine.tolist(), left.tolist(), strict=True):
            assert row.error is not None and row.error < 0.01
            assert row.frequency_hz == pytest.approx(tone * (1.0 - still), rel=row.error + still / 2.0)


def patched_hz(case: Case, layers: int = 3, size_m: float = 2.5e-3, near_hz: float = 3.5e4) -> FloatArray:
    """Even modes of the quarter with short-circuited patches and tied nodes at its end."""
    assert case.patches is not None
    boxes, patch_boxes = fingers.boxes_with_patches(case, layers, size_m, True)
    plate, patch = (hex_mesh(each, fingers.ORDER) for each in (boxes, patch_boxes))
    patch.nodes[:, 2] += case.design.thickness_m
    joined = bonded_solid(
        assemble(plate, {"plate": case.design.material}), patch, case.patches.material, case.patches.size_m[2]
    )
    moves = np.column_stack([joined.place_nm[:, :2] != 0, np.ones(len(joined.place_nm), dtype=bool)])
    moves[np.abs(joined.place_nm[:, 0] * SAME_M - case.design.half_length_m) < 2.0 * SAME_M] = False
    free, (coupling, dielectric) = np.flatnonzero(moves), joined.bending
    stiffness = sp.block_array(
        [[joined.stiffness[free][:, free], coupling[free]], [coupling[free].T, -dielectric]], format="csc"
    )
    none = sp.csc_array(dielectric.shape)
    mass = sp.block_diag([joined.mass[free][:, free], none], format="csc")
    unit, shift = float(stiffness.diagonal().max()), (2.0 * np.pi * near_hz) ** 2
    stiffness, mass = stiffness / unit, mass * (shift / unit)
    factor = Factoriser()(sp.csc_array(stiffness - mass))
    inverse = spla.LinearOperator(stiffness.shape, matvec=factor.solve, dtype=float)
    start = factor.solve(mass @ np.ones(stiffness.shape[0]))
    values = spla.eigsh(stiffness, 8, mass, sigma=1.0, OPinv=inverse, v0=start, return_eigenvectors=False)
    return np.asarray(np.sort(near_hz * np.sqrt(values[values > 0.0])))


@pytest.mark.slow
def test_a_clamped_plate_with_patches_lies_within_its_bars_of_the_whole_solid() -> None:
    """The patches' potential is a degree of freedom of the solid."""
    case = case_from_dict(PATCHES)
    forced = forced_plate(case, TerminalLog(True), None, [])
    group = next(place for place, basis in enumerate(forced.modes) if basis.group.symmetries == ("SS",))
    tones, bars = forced.modes[group].frequency_hz, frequency_errors(forced)[group]
    known, low, high = patched_hz(case), *forced.band_hz
    inside = known[(known > low) & (known < high)]
    ours = [(tone, bar) for tone, bar in zip(tones, bars, strict=True) if low < tone < high]
    assert len(ours) == len(inside) > 1
    for (tone, bar), exact in zip(ours, inside.tolist(), strict=True):
        assert bar < 0.01 and tone == pytest.approx(exact, rel=bar + OWN)
