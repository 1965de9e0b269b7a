"""Clamped and simply supported discs of a plate's back face against whole solids with the same nodes held."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geometry.elements import FloatArray
from geometry.hex.boxes import boxes_of, hex_mesh
from geometry.hex.panels import disc_mesh
from geometry.hex.scenes import HexSettings, plate_scene
from geometry.layout import region_materials
from geometry.materials import Material, Stack
from geometry.supports import Support
from geometry.tiling import Panel
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models.cell_cache import CellCache, MatrixCache
from pipeline.models.modes import solve_modes
from pipeline.planning.model_choice import Request
from solvers.accuracy.reduction import mode_errors
from solvers.fem.assembly import Scale, assemble
from solvers.fem.eigen import modes_in_band
from solvers.fem.solid import constrain, free_mask
from solvers.plates import held
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.cell import Cell
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.supports import Hold
from tests.verification.test_supports import ALUMINIUM, MARGIN, bare_design, clamped_case, solved

SIZE, SMALL = (24e-3, 18e-3, 2e-3), (12e-3, 9e-3, 2e-3)
AXES = {"clamp": [0, 1, 2], "simple": [2]}
# of the change by the innermost of three layers that shrink by 0.25: r^(1/2) leaves 1 / (4 - 1) on, and as much is its error
LEFT = 0.33


def plate(supports: list[Support], size_m: tuple[float, float, float] = SIZE, top_hz: float = 4e5) -> PlateModel:
    """A bare plate from reduced cells of the degrees that `auto` gives one of this size."""
    design = bare_design(supports, size_m)
    return PlateModel(design, Reductions(design.stack, None, settings(top_hz)))


def settings(top_hz: float) -> ReductionSettings:
    return ReductionSettings(Interface(4, 2, ()), top_hz, HexSettings(3, 2e-3, 0), 6e-3, None, 1)


def solid_hz(
    panel: Panel,
    disc: tuple[str, float],
    band_hz: tuple[float, float],
    mirrors: dict[str, str],
    thick_m: float = SIZE[2],
    finest: int = 3,
) -> tuple[FloatArray, FloatArray]:
    """Modes of a rectangle of plate with the nodes of a disc held, mirrored at some sides, and what they still err by."""
    (kind, radius), tones = disc, []
    for layers in (finest, finest - 1):
        mesh = disc_mesh(panel, Stack.of(thick_m, ALUMINIUM), radius, HexSettings(3, 2e-3, layers, 0.25))
        assert panel.foot
        at = np.array(panel.foot) - panel.middle if not panel.halved else np.zeros(2)
        inside = np.hypot(*(mesh.nodes[:, :2] - at).T) < radius * (1.0 + 1e-9)
        free = free_mask(mesh, (), mirrors)
        free[np.ix_(inside & (mesh.nodes[:, 2] > thick_m * (1.0 - 1e-9)), AXES[kind])] = False
        pencil = constrain(assemble(mesh, {"plate": ALUMINIUM}, Scale.of(thick_m, ALUMINIUM)), free)
        tones.append(modes_in_band(pencil, *band_hz).frequency_hz)
    fine, coarse = tones
    left = LEFT * (coarse / fine - 1.0)
    return fine * (1.0 - left), left


def compare(model: PlateModel, known: tuple[FloatArray, FloatArray], band_hz: tuple[float, float], least: int) -> None:
    """All modes of the model, none more, lie within their bars of the solid."""
    tones, bars, _ = solved(model, *band_hz)
    order = np.argsort(known[0])
    exact, left = known[0][order], known[1][order]
    assert len(tones) == len(exact) >= least
    assert (np.abs(tones / exact - 1.0) <= bars + left).all()
    assert np.median(bars) < 0.05


@pytest.mark.slow
def test_the_twist_of_a_plate_on_a_clamped_disc(monkeypatch: pytest.MonkeyPatch) -> None:
    """With fewer layers at the rim, whose bar is the wider, so that the proof takes seconds."""
    monkeypatch.setattr(held, "LAYERS", 1)
    model = plate([Support("clamp", radius_m=1.5e-3)], SMALL, 1e5)
    pencil, panel = model.pencil("AA"), Panel((-6e-3, -4.5e-3), (6e-3, 4.5e-3), (0.0, 0.0), (0, 1))
    (exact,), (left,) = solid_hz(panel, ("clamp", 1.5e-3), (1e3, 4e4), {"x-": "A", "y-": "A"}, finest=2)
    modes = modes_in_band(pencil, 1e3, 4e4)
    (tone,), errors = modes.frequency_hz, mode_errors(model.assembled("AA"), pencil, modes.vectors)
    assert pencil.rigid_count == 0
    assert tone == pytest.approx(exact, rel=float(errors.mesh[0] + MARGIN * errors.total[0]) + left)
    assert errors.mesh[0] < 0.02 and tone == pytest.approx(exact, rel=0.01)


@pytest.mark.slow
def test_a_disc_is_solved_once_for_plates_whose_panels_about_it_are_alike(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another radius, kind or layer is another one, and so is a panel with a function turned round."""
    monkeypatch.setattr(held, "disc_settings", lambda *_: HexSettings(2, 6e-3, 1))
    solved_discs: list[int] = []

    def counted(*given: Any) -> FloatArray:
        solved_discs.append(1)
        return np.eye(given[-1].shape[1])

    monkeypatch.setattr(held, "_stiffness", counted)
    reductions = Reductions(
        Stack.of(SMALL[2], ALUMINIUM), None, settings(1e5), CellCache(tmp_path), matrices=MatrixCache(tmp_path)
    )

    def solves(disc: Support, turned: bool = False, **changes: Any) -> tuple[int, Hold]:
        before, model = len(solved_discs), PlateModel(bare_design([disc], SMALL), reductions)
        if turned:
            model.cells = {name: _turned(cell) for name, cell in model.cells.items()}
        model.reductions = replace(reductions, **changes)
        (hold,) = model.assembled("SS").holds
        return len(solved_discs) - before, hold

    disc = Support("clamp", radius_m=1.5e-3)
    (first, computed), (again, kept) = solves(disc), solves(disc)
    assert (first, again) == (2, 0) and np.array_equal(computed.stiffness, kept.stiffness)
    assert solves(replace(disc, radius_m=1.4e-3))[0] == solves(replace(disc, kind="simple"))[0] == 2
    softer = Stack.of(SMALL[2], Material.isotropic("softer", 60e9, 2700.0, 0.34))
    assert solves(disc, turned=True)[0] == solves(disc, stack=softer)[0] == 2


def _turned(cell: Cell) -> Cell:
    """A cell whose last function has the other sign, as one reduced again may have."""
    assert cell.bare
    sign = np.ones(cell.dof)
    sign[-1] = -1.0
    bare = replace(cell.bare, matrix=cell.bare.matrix * sign)
    return replace(
        cell, stiffness=cell.stiffness * np.outer(sign, sign), mass=cell.mass * np.outer(sign, sign), bare=bare
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["clamp", "simple"])
def test_a_plate_on_a_disc_in_its_middle(kind: str) -> None:
    """A quarter stands for it: the disc is its own image in both mirrors."""
    size, band = SMALL, (1e3, 8e4)
    model = plate([Support(kind, radius_m=1.5e-3)], size)
    panel = Panel((-6e-3, -4.5e-3), (6e-3, 4.5e-3), (0.0, 0.0), (0, 1))
    found = [solid_hz(panel, (kind, 1.5e-3), band, {"x-": x, "y-": y}) for x in "SA" for y in "SA"]
    assert len(model.symmetries) == 4
    compare(model, (np.concatenate([each[0] for each in found]), np.concatenate([each[1] for each in found])), band, 4)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["clamp", "simple"])
def test_a_plate_on_a_disc_anywhere(kind: str) -> None:
    """The disc lies on the lines between panels, and on no mirror."""
    at, band = (3e-3, 2e-3), (1e3, 5e4)
    known = solid_hz(Panel((-12e-3, -9e-3), (12e-3, 9e-3), at), (kind, 2e-3), band, {})
    compare(plate([Support(kind, at_m=at, radius_m=2e-3)]), known, band, 8)


@pytest.mark.slow
@pytest.mark.parametrize("thick_m", [2e-3, 0.5e-3])
def test_four_screws(thick_m: float) -> None:
    """Each is the others' image; two of them leave a gap of a plate's thickness in the middle, or two."""
    at, band = (2.5e-3, 5e-3), (1e3, 7e4 * thick_m / 2e-3)
    supports = [Support("clamp", at_m=(x * at[0], y * at[1]), radius_m=1.5e-3) for x in (1, -1) for y in (1, -1)]
    panel = Panel((0.0, 0.0), (12e-3, 9e-3), at)
    found = [solid_hz(panel, ("clamp", 1.5e-3), band, {"x-": x, "y-": y}, thick_m) for x in "SA" for y in "SA"]
    model = plate(supports, (*SIZE[:2], thick_m))
    assert len(model.symmetries) == 4 and all(len(model.assembled(s).holds) == 1 for s in model.symmetries)
    tones, bars, rigid = solved(model, *band)
    exact = np.concatenate([each[0] for each in found])
    left = np.concatenate([each[1] for each in found])[np.argsort(exact)]
    assert rigid == 0 and len(tones) == len(exact) >= 6
    assert (np.abs(tones / np.sort(exact) - 1.0) <= bars + left).all() and np.median(bars) < 0.05


@pytest.mark.slow
def test_mirrored_classes_are_those_of_the_whole_plate() -> None:
    """Off the lines of mirrors the image of a disc is another one: its stiffness counts as often."""
    supports = [Support("clamp", at_m=(x, 0.0), radius_m=1e-3) for x in (3e-3, -3e-3)]
    model = plate(supports, SMALL, 2e5)
    classes = solved(model, 1e3, 6e4)[0]
    pencil = model.pencil(None)
    assert len(model.assembled(None).holds) == 2 and pencil.rigid_count == 0
    assert modes_in_band(pencil, 1e3, 6e4).frequency_hz == pytest.approx(classes, rel=1e-7)


@pytest.mark.parametrize(
    ("support", "said"),
    [
        ([{"kind": "foam", "at_mm": [0, 0], "radius_mm": 1.0, "stiffness_N_per_m2": 1.0}], "foam is for edges"),
        ([{"kind": "clamp", "at_mm": [0, 0]}], "support.0.radius_mm: missing, must be given with at_mm"),
        (
            [{"kind": "spring", "at_mm": [0, 0], "radius_mm": 1.0, "stiffness_N_per_m": 7.1e5}],
            "support.0.stiffness_N_per_m = 710000: must be at most 700000 on this disc",
        ),
        ([{"kind": "clamp", "at_mm": [10.95, 0], "radius_mm": 1.0}], "x from -11.9 to 11.9"),
        ([{"kind": "simple", "at_mm": [0, 9], "radius_mm": 1.0}], "the disc must lie on the plate"),
        ([{"kind": "clamp", "at_mm": [0, 0], "radius_mm": 40.0}], "support.0.radius_mm = 40: must be at most "),
        (
            [{"kind": "clamp", "at_mm": [x, 0], "radius_mm": radius} for x, radius in ((11, 4.0), (5, 1.0))],
            "support.0.at_mm = [11, 0]: the disc must lie on the plate",
        ),
        ([{"kind": "clamp", "at_mm": [0, 0], "radius_mm": 1.0, "mass_g": 1.0}], "support.0.mass_g"),
        (
            [{"kind": "clamp", "at_mm": [x, 0], "radius_mm": 1.0} for x in (-1.9, 1.9)],
            "support.1.at_mm = [1.9, 0]: must leave 2 mm, the plate's thickness",
        ),
        (
            [
                {"kind": "spring", "at_mm": [0, 0], "radius_mm": 1.0, "stiffness_N_per_m": 1.0},
                {"kind": "simple", "at_mm": [0, 1], "radius_mm": 1.0},
            ],
            "between the rims of support.0 and its own",
        ),
    ],
)
def test_a_disc_that_cannot_be_is_one_line(support: Any, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)) as fault:
        clamped_case(("support", support))
    assert len(fault.value.lines) == 1


PILLARS: dict[str, Any] = {
    "material": "aluminium", "plate": {"thickness_mm": 2.0}, "zone": {"length_mm": 24.0, "width_mm": 9.0, "nodal_lines": 2},
    "pillar": {"shape": "square", "side_mm": 2.0, "height_mm": 5.0},
    "array": {"pitch_mm": 4.0, "rows": 1, "extension_mm": 4.5}, "solve": {"accuracy": 0.02},
}  # fmt: skip


def test_a_disc_keeps_off_pillars_and_patches() -> None:
    def one(at: list[float], **more: Any) -> list[str]:
        with pytest.raises(InputError) as fault:
            case_from_dict({**PILLARS, "support": [{"kind": "clamp", "at_mm": at, "radius_mm": 1.0}], **more})
        return fault.value.lines

    (pillar,) = one([0.0, 7.0])
    assert "support.0.at_mm = [0, 7]: the disc with 0.1 mm around it must lie on bare plate" in pillar
    patches = {"material": "pz26", "size_mm": [4.0, 3.0, 0.3], "centres_mm": [[0.0, 0.0]]}
    (patch,) = one([4.5, 0.0], patches=patches)
    assert "must lie 2 mm, the plate's thickness, off the patches: patch 0 is nearer" in patch
    case = case_from_dict(
        {**PILLARS, "support": [{"kind": "clamp", "at_mm": [5.1, 0.0], "radius_mm": 1.0}], "patches": patches}
    )
    assert case.design.supports[0].held_axes == "xyz"


def test_a_warm_plate_expands_on_rollers_and_not_between_screws() -> None:
    warm = {"plate": {"thickness_mm": 2.0}, "solve": {"accuracy": 0.02, "temperature_C": 60.0}}
    for kind, refused in (("simple", False), ("clamp", True)):
        discs = [{"kind": kind, "at_mm": [9.0, 0.0], "radius_mm": 1.0}]
        case = case_from_dict({**PILLARS, **warm, "support": discs})
        if not refused:
            case.refuse("modes", ("[[support]]",))
            continue
        with pytest.raises(InputError, match="clamps or simply supported edges"):
            case.refuse("modes", ("[[support]]",))


@pytest.mark.slow
def test_a_screw_beside_rows_of_pillars_lies_between_two_staircases() -> None:
    """On a solid of boxes the faces within the disc hold less than it, those that it meets more."""
    screws = [{"kind": "clamp", "at_mm": [x, y], "radius_mm": 1.5} for x in (8.0, -8.0) for y in (10.5, -10.5)]
    case = case_from_dict({**PILLARS, "array": {"pitch_mm": 4.0, "rows": 1, "extension_mm": 6.0}, "support": screws})
    query = Request("plate", band_hz=(1e3, 4e4), symmetry="SS", search=False)
    rows = solve_modes(case, query, TerminalLog(True)).rows
    low, high = (staircase_hz(case, within) for within in (True, False))
    assert len(rows) == 3 <= min(len(low), len(high))
    for row, less, more in zip(rows, low.tolist(), high.tolist(), strict=False):
        assert row.error is not None and row.error < 0.02 and more < 1.25 * less
        assert less * (1.0 - row.error) < row.frequency_hz < more * (1.0 + row.error)


def staircase_hz(case: Case, within: bool) -> FloatArray:
    """Modes of the quarter, even along x and y, with the nodes held of faces within a disc, or of all that it meets."""
    (x, y), radius, thick = case.design.supports[0].at_m, case.design.supports[0].radius_m, case.design.thickness_m
    scene = plate_scene(case.design, HexSettings(3, 3e-3, 1), quarter=True)
    for lines, middle in ((scene.x, x), (scene.y, y)):
        lines |= dict.fromkeys(np.linspace(middle - radius, middle + radius, 7).tolist(), False)
    mesh = hex_mesh(boxes_of(scene), 3)
    corners = mesh.nodes[mesh.cells]
    low, high = corners.min(axis=1), corners.max(axis=1)
    at = np.array([x, y])
    beyond = np.maximum(np.abs(low[:, :2] - at), np.abs(high[:, :2] - at))
    nearest = np.maximum(np.maximum(low[:, :2] - at, at - high[:, :2]), 0.0)
    chosen = np.hypot(*beyond.T) < radius * (1.0 + 1e-9) if within else np.hypot(*nearest.T) < radius * (1.0 - 1e-9)
    chosen &= np.abs(high[:, 2] - thick) < 1e-9
    nodes = np.unique(mesh.cells[chosen])
    nodes = nodes[np.abs(mesh.nodes[nodes, 2] - thick) < 1e-9]
    free = free_mask(mesh, (), {"x-": "S", "y-": "S"})
    free[nodes] = False
    system = assemble(mesh, region_materials(case.design.stack, case.design.pillar), Scale.of(thick, ALUMINIUM))
    return modes_in_band(constrain(system, free), 1e3, 4.2e4).frequency_hz
