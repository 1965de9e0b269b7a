"""Plates larger than their zone and rows: where pillars stand, the shape sought, areas, and other models of the same plate."""

from __future__ import annotations

import json
from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geometry.layout import Design, antinode_places, half_wavelength_m
from geometry.materials import MATERIALS, Stack
from geometry.tet.scenes import tet_panel
from geometry.tiling import tile
from pipeline.case.model import Case, case_from_dict, parsed
from pipeline.case.reading import apply_overrides
from pipeline.cli.main import main
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models import modes
from pipeline.models.answer_parts import TargetMode
from pipeline.models.modes import solve_modes, without_supports
from pipeline.planning.model_choice import Request
from pipeline.planning.plan import modes_step
from pipeline.planning.resource_estimate import pillar_count
from pipeline.records.record import DesignRecord
from solvers.analytic.beams import free_free_mode, roots, zone_mode
from solvers.analytic.plates import Strip, kirchhoff_mode, levy_hz, mindlin_mode, mindlin_wave_hz, thin_plate_hz
from solvers.measures.confinement import measure, target_shape
from solvers.measures.correlation import weigh
from tests.helpers.whole_solid import check_pairwise, check_within_both_bars, solid_on_foam
from tests.verification.test_zone_edges import AREAS, joined, some

RAW: dict[str, Any] = {
    "name": "larger",
    "material": "aluminium",
    "plate": {"thickness_mm": 1.5, "length_mm": 30.0, "width_mm": 26.0},
    "zone": {"length_mm": 12.0, "width_mm": 8.0, "nodal_lines": 1, "centre_mm": [2.0, -1.5]},
    "pillar": {"shape": "square", "side_mm": 1.6, "height_mm": 5.0},
    "array": {"pitch_mm": 4.0, "rows": 1, "surround": True},
    "solve": {"accuracy": 0.01},
}
SMALL = {  # that the whole solid is quickly solved
    **RAW,
    "plate": {"thickness_mm": 1.5, "length_mm": 22.0, "width_mm": 18.0},
    "zone": {"length_mm": 8.0, "width_mm": 6.0, "nodal_lines": 1, "centre_mm": [1.5, -1.0]},
}
DISPLAY: dict[str, Any] = {  # as studies/large-display.toml, small enough for the whole solid
    "material": "glass",
    "plate": {"thickness_mm": 0.7, "length_mm": 22.0, "width_mm": 18.0},
    "zone": {"length_mm": 8.0, "width_mm": 4.0, "nodal_lines": 1, "centre_mm": [1.0, -0.6]},
    "pillar": {"material": "aluminium", "shape": "square", "side_mm": 1.0, "height_mm": 2.0},
    "array": {"pitch_mm": 2.4, "rows": 2, "surround": True},
    "solve": {"accuracy": 0.02},
    "support": [{"kind": "foam", "edge": "y-", "stiffness_N_per_m2": 3e6}],
}
STRIP = Strip(0.06, 0.015, Stack.of(0.7e-3, MATERIALS["glass"]), 2)


def case_of(*settings: str) -> Case:
    return case_from_dict(RAW, None, settings)


def test_rows_close_around_the_zone() -> None:
    """The corners are filled, nothing stands on the zone, and no two pillars are nearer than a pitch."""
    design = case_of("array.rows=2", "plate.length_mm=60", "plate.width_mm=50").design
    centres = design.pillar_centres() - np.array(design.centre_m)
    assert len(centres) == pillar_count(design) == len(DesignRecord.of_design(design).standing)
    inside = np.abs(centres) < np.array([design.length_m, design.width_m]) / 2.0
    assert not inside.all(axis=1).any()
    corner = np.array([design.length_m, design.width_m]) / 2.0 + 0.8e-3 + 4e-3
    for sign in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        assert np.abs(centres - sign * corner).max(axis=1).min() < 1e-12
    apart = np.linalg.norm(centres[:, None] - centres[None], axis=2) + np.eye(len(centres))
    assert apart.min() == pytest.approx(4e-3, rel=1e-9)
    places = {tuple(row) for row in np.round(centres, 9).tolist()}
    assert places == {(-x, y) for x, y in places} == {(x, -y) for x, y in places}


def test_every_pillar_has_a_panel_of_its_own() -> None:
    design = case_of("array.rows=2", "plate.length_mm=60", "plate.width_mm=50").design
    tiling = tile(design, 6e-3)
    assert len(tiling.feet) == len(design.pillar_centres())
    for (i, j), (x, y) in tiling.feet.items():
        assert tiling.x[i] < x - 0.8e-3 and x + 0.8e-3 < tiling.x[i + 1]
        assert tiling.y[j] < y - 0.8e-3 and y + 0.8e-3 < tiling.y[j + 1]
    for lines, size in ((tiling.x, 0.06), (tiling.y, 0.05)):
        assert [lines[0], lines[-1]] == pytest.approx([-size / 2.0, size / 2.0])
        assert np.diff(lines).min() > 1e-4 and np.diff(lines).max() <= 6e-3 * (1.0 + 1e-9)


@pytest.mark.parametrize("share", [1.0, 1e-1, 1e-2, 1e-3, 3.7])
def test_a_tie_is_decided_alike_at_every_scale(share: float) -> None:
    """Pillars 1.2 pitches apart: binary fractions must not choose whether their panels meet."""
    lengths = {"thickness_mm": 1.5, "length_mm": 40.0, "width_mm": 34.0}, {"length_mm": 12.0, "width_mm": 8.0}
    plate, zone = ({key: share * length for key, length in each.items()} for each in lengths)
    raw = {
        **RAW, "plate": plate, "zone": {**zone, "nodal_lines": 1, "centre_mm": [share * 2.0, share * -1.5]},
        "pillar": {"shape": "square", "side_mm": share * 1.6, "height_mm": share * 5.0},
        "array": {"pitch_mm": share * 4.0, "rows": 1, "surround": True},
    }  # fmt: skip
    tiling = tile(case_from_dict(raw).design, share * 7.2e-3)
    assert (len(tiling.x), len(tiling.y), len(tiling.feet)) == (9, 8, 10)


def test_the_shape_is_free_where_the_plate_ends_and_pinned_where_it_goes_on() -> None:
    s = np.linspace(0.0, 1.0, 41)
    sine = zone_mode(3, True, True).shape(s)
    assert sine / sine[5] == pytest.approx(np.sin(4.0 * pi * s) / np.sin(4.0 * pi * s[5]), abs=1e-9)
    half = zone_mode(2, True, False).shape(s)
    whole = free_free_mode(5).shape(0.5 + s / 2.0)  # the odd half of a free beam twice as long
    assert half == pytest.approx(whole * half[-1] / whole[-1], abs=1e-9)
    assert np.abs(zone_mode(2, False, True).shape(s)[::-1]) == pytest.approx(np.abs(half), abs=1e-9)
    assert half_wavelength_m(1.0, 3, 2) == pytest.approx(pi / zone_mode(3, True, True).kappa)
    assert half_wavelength_m(1.0, 4, 1) == pytest.approx(pi / zone_mode(4, True, False).kappa, rel=1e-4)
    assert half_wavelength_m(1.0, 0, 1) is None and half_wavelength_m(2.0, 0, 2) == 2.0
    assert zone_mode(4, True, False).kappa == pytest.approx(roots("pinned", "free", 4)[-1])


@pytest.mark.parametrize("settings", [(), ("zone.centre_mm=[9.0, 0.0]", "array.surround=false")])
def test_the_shape_sits_on_the_zone(settings: tuple[str, ...]) -> None:
    """Nodes at the pinned ends, a free end at the plate's edge, and as many lines between as asked for."""
    design = case_of(*settings).design
    x = np.linspace(*design.zone_ends_m, 401)
    shape = target_shape(design, np.column_stack([x, np.full(401, design.centre_m[1])]))
    ends = np.abs(shape[[0, -1]]) < 1e-9
    assert ends.tolist() == list(design.goes_on)
    assert (np.diff(np.sign(shape[1:-1])) != 0).sum() == design.nodal_lines


@pytest.mark.parametrize("lines", [0, 3, 6])
def test_theory_knows_pinned_ends(lines: int) -> None:
    """Between pinned sides and ends a rectangle's waves are its modes, by Kirchhoff and by Mindlin."""
    along = (lines + 1) * pi / STRIP.length_m
    exact = thin_plate_hz(STRIP, along, STRIP.across_per_m)
    assert levy_hz(STRIP, lines) == pytest.approx(exact, rel=1e-12)
    assert kirchhoff_mode(STRIP, lines, "pinned").frequency_hz == pytest.approx(exact, rel=1e-6)
    shear = mindlin_wave_hz(STRIP, along, STRIP.across_per_m)
    assert mindlin_mode(STRIP, lines, "pinned").frequency_hz == pytest.approx(shear, rel=1e-6)
    one = replace(STRIP, held=1)
    assert kirchhoff_mode(one, lines, "pinned").frequency_hz == pytest.approx(levy_hz(one, lines), rel=1e-4)
    between = [levy_hz(replace(STRIP, held=held), lines) for held in (0, 1, 2)]
    assert between == sorted(between) and len({*between}) == 3


def check_areas(design: Design, kind: str) -> None:
    mesher = (lambda panel: tet_panel(design, panel, 1.5e-3)) if kind == "tetrahedra" else None
    model = joined(design, mesher)
    vectors = some(model.assembled(None).dof)
    touch = model.touch(None, vectors)
    zone, whole = design.length_m * design.width_m, design.plate_m[0] * design.plate_m[1]
    assert touch.weights.sum() == pytest.approx(whole, rel=AREAS)
    assert touch.weights[touch.is_active(design)].sum() == pytest.approx(zone, rel=10.0 * AREAS)
    x0, x1, y0, y1 = design.reach_m
    beyond = touch.weights[design.beyond_rows(touch.points)].sum()
    assert beyond == pytest.approx(whole - (x1 - x0) * (y1 - y0), rel=10.0 * AREAS)
    own = measure(touch, design, None)
    ratio = 10.0 ** (own.confinement_db / 10.0) * (1.0 - own.zone_share) / own.zone_share
    assert ratio == pytest.approx(whole / zone - 1.0, rel=10.0 * AREAS)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["square", "round"])
def test_the_zone_ends_at_all_four_borders(kind: str) -> None:
    """Panels are cut along x and y, also at the corners of the zone, where both lines meet."""
    shape = ("pillar={shape='round', diameter_mm=1.6, height_mm=5.0}",) if kind == "round" else ()
    check_areas(case_of(*shape, "plate.thickness_mm=1.5").design, kind)


@pytest.mark.slow
def test_the_zone_of_tetrahedra_ends_at_all_four_borders() -> None:
    check_areas(case_of("plate.length_mm=24", "plate.width_mm=18").design, "tetrahedra")


def test_antinodes_are_the_zone_s_own() -> None:
    """N + 1 of them between pinned ends, and a patch at the end of the plate alone where only that is free."""
    patches = "patches={size_mm=[2.0, 2.0, 0.3], face='touch'}"
    inner = case_of(patches, "zone.nodal_lines=2").patches
    assert inner is not None
    assert 1e3 * np.array(inner.centres_m) == pytest.approx(np.array([[-2.0, -1.5], [2.0, -1.5], [6.0, -1.5]]))
    edge = case_of(patches, "zone.centre_mm=[9.0, 0.0]", "array.surround=false", "zone.nodal_lines=2").patches
    assert edge is not None
    x = [1e3 * place for place, _ in edge.centres_m]
    assert len(x) == 3 and x[-1] == pytest.approx(15.0 - 1.0) and min(x) > 3.0 + 1.0
    assert antinode_places((0.0,), 0.012, (2e-3, 2e-3, 3e-4), ends=False)[0] == ((0.0, 0.0),)


def test_patches_lie_between_the_rows_around_a_zone() -> None:
    """A row beside the zone has their x, a column before it their y, and no pillar both."""
    design = case_of().design
    centres, middle = 1e3 * design.pillar_centres(), 1e3 * np.array(design.centre_m)
    beside, before = (
        np.abs(centres[:, axis] - middle[axis]) > 1e3 * half
        for axis, half in ((1, design.width_m / 2.0), (0, design.length_m / 2.0))
    )
    x, y = centres[beside & ~before][0, 0], centres[before & ~beside][0, 1]
    patches = f"patches={{size_mm=[2.0, 2.0, 0.3], face='back', centres_mm=[[{x}, {y}]]}}"
    assert case_of(patches).patches is not None
    x, y = centres[0]
    for at in ([x, y], [x + 1.7, y], [x, y - 1.7]):
        with pytest.raises(InputError, match="patch 0 on the back overlaps a pillar's foot"):
            case_of(patches, f"patches.centres_mm=[[{at[0]}, {at[1]}]]")
    assert case_of(patches, "array.surround=false", f"patches.centres_mm=[[{x}, -1.5]]").patches is not None


def test_a_measured_map_is_weighed_on_all_sides_of_the_zone() -> None:
    design = case_of().design
    x, y = np.meshgrid(np.linspace(-14.5, 14.5, 30), np.linspace(-12.5, 12.5, 26), indexing="ij")
    weights = weigh(1e-3 * np.column_stack([x.ravel(), y.ravel()]), design)
    on = design.in_zone(weights.points)
    assert weights.area_m2[on].sum() == pytest.approx(design.length_m * design.width_m, rel=0.1)
    assert weights.area_m2[~on].sum() == pytest.approx(0.03 * 0.026 - design.length_m * design.width_m, rel=0.1)


REFUSED = {
    "plate.width_mm": ("must accompany length_mm", {"plate": {"thickness_mm": 1.5, "length_mm": 30.0}}),
    "array.extension_mm": ("must be left out", {"array": {**RAW["array"], "extension_mm": 3.0}}),
    "zone.centre_mm": ("requires a larger plate", {"plate": {"thickness_mm": 1.5}}),
    "plate.length_mm": ("the zone extends beyond the plate", {"zone": {**RAW["zone"], "centre_mm": [10.0, 0.0]}}),
    "plate.width_mm = 26": ("3 rows do not fit", {"array": {**RAW["array"], "rows": 3}}),
    "zone.centre_y_mm": ("cannot be combined with centre_mm", {"zone": {**RAW["zone"], "centre_y_mm": 1.0}}),
    "array.surround": ("cannot be combined with shifted rows", {"array": {**RAW["array"], "stagger": True}}),
    "array.heights_mm": ("rows around a zone are alike", {"array": {**RAW["array"], "heights_mm": [5.0]}}),
    "pillar.faces": (
        "must be back where a finger",
        {"pillar": {**RAW["pillar"], "faces": "both"}, "touch": {"radius_mm": 2.0}},
    ),
    "margin": ("leaves a margin of 0.001", {"zone": {**RAW["zone"], "centre_mm": [2.0, -7.399]}}),
}


@pytest.mark.parametrize("key", REFUSED)
def test_what_does_not_fit_is_refused(key: str) -> None:
    text, tables = REFUSED[key]
    with pytest.raises(InputError, match=text) as fault:
        case_from_dict({**RAW, **tables})
    assert any(key in line for line in fault.value.lines) or key == "margin"


@pytest.mark.parametrize("command", ["explore", "broadband", "travel", "crosstalk"])
def test_commands_for_long_zones_refuse_it(command: str) -> None:
    with pytest.raises(InputError, match=r"plate.length_mm = 30: .* supports a plate as long as its zone only"):
        case_of().refuse(command)


@pytest.mark.slow
def test_a_plate_turned_by_half_a_turn_has_the_same_modes() -> None:
    query = Request("plate", band_hz=(40e3, 60e3), search=False)
    cases = (case_from_dict(SMALL, None, [("zone.centre_mm", place)]) for place in ([1.5, -1.0], [-1.5, 1.0]))
    tones = [[row.frequency_hz for row in solve_modes(case, query, TerminalLog(True)).rows] for case in cases]
    assert tones[0] == pytest.approx(tones[1], rel=1e-7) and len(tones[0]) > 3


@pytest.mark.slow
@pytest.mark.parametrize("settings", [(), ("array.surround=false",), ("zone.centre_mm=[0.0, 0.0]",)])
def test_reduced_cells_have_the_modes_of_the_whole_solid(settings: tuple[str, ...]) -> None:
    raw = apply_overrides(SMALL, parsed(settings))
    check_within_both_bars(raw, (30e3, 60e3), case_from_dict(raw).target_symmetry)


@pytest.mark.slow
def test_tetrahedra_of_the_cad_have_the_same_modes() -> None:
    """A zone anywhere is built by CadQuery and meshed by pytetwild, too."""
    query = Request("plate", band_hz=(30e3, 50e3), search=False)
    ours, theirs = (
        solve_modes(case_from_dict(SMALL, None, settings), query, TerminalLog(True)).rows
        for settings in ([], ["solve.model=solid", "solve.mesh=tet"])
    )
    assert len(ours) == len(theirs) > 2
    for one, other in zip(ours, theirs, strict=True):
        assert one.error is not None and other.error is not None
        assert one.frequency_hz == pytest.approx(other.frequency_hz, rel=one.error + other.error)


@pytest.mark.slow
def test_a_display_on_foam_has_the_modes_of_the_whole_solid(monkeypatch: pytest.MonkeyPatch) -> None:
    """Glass, two rows of aluminium on four sides, a zone off the middle, and one edge on foam, which lifts two rigid motions
    into the band; the others are not those of the plate without it.
    """
    query, case = Request("plate", band_hz=(1e3, 3e4), search=False), case_from_dict(DISPLAY)
    ours, free = (solve_modes(each, query, TerminalLog(True)) for each in (case, case.but({"support": []})))
    theirs = solid_on_foam(case.but({"solve.accuracy": 0.05}), query, ours.rigid_count, monkeypatch)
    check_pairwise(ours.rows, theirs.rows)
    assert len(case.design.pillar_centres()) == 28 and (ours.rigid_count, free.rigid_count) == (4, 6)
    assert len(ours.rows) == len(free.rows) + 2
    with pytest.raises(AssertionError):
        check_pairwise(ours.rows[2:], free.rows)


@pytest.mark.slow
@pytest.mark.parametrize("edge", ["y-", "x+"])
def test_the_plate_without_its_foam_follows_from_that_on_it(edge: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As solved again, inside a hundredth of its bars: frequency, level, MAC, strength, and which modes rival it."""
    foam = {"kind": "foam", "edge": edge, "stiffness_N_per_m2": 3e3}
    larger = {"thickness_mm": 1.0, "length_mm": 30.0, "width_mm": 26.0}
    case = case_from_dict({**RAW, "plate": larger, "solve": {"accuracy": 0.1}, "support": [foam]})
    request, log = Request(), TerminalLog(True)
    solved = solve_modes(case, request, log, modes_step(case, request).choice)
    followed = without_supports(case, request, solved, log)
    monkeypatch.setattr(modes, "_released", lambda *_: (None, None))
    again = without_supports(case, request, solved, log)
    assert followed and again and followed.dof >= again.dof and followed.count.high_hz < again.count.high_hz
    own, other = (each.target_part() for each in (followed, again))
    assert isinstance(own, TargetMode) and isinstance(other, TargetMode)
    assert own.frequency_hz == pytest.approx(other.frequency_hz, rel=0.01 * (other.frequency_error or 0.0))
    assert own.frequency_error == pytest.approx(other.frequency_error, rel=0.1)
    assert own.confinement_db == pytest.approx(other.confinement_db, abs=0.01 * (other.confinement_error_db or 0.0))
    assert own.mac == pytest.approx(other.mac, abs=0.01 * (other.mac_error or 0.0))
    assert own.strength == pytest.approx(other.strength, abs=0.01 * (other.strength_error or 0.0))
    assert (own.status, len(own.rivals)) == (other.status, len(other.rivals))
    below = [row.frequency_hz for row in followed.rows]
    assert below == pytest.approx(
        [r.frequency_hz for r in again.rows if r.frequency_hz < followed.count.high_hz], rel=1e-4
    )


@pytest.mark.slow
def test_the_answer_names_the_target_shape_along_x(tmp_path: Path) -> None:
    """sin((N + 1) pi (x + L/2)/L) where the plate goes on beyond both ends, in the plate's record; the zone's own is free."""
    file, out = tmp_path / "larger.toml", tmp_path / "modes.json"
    file.write_text(
        """
        name = "larger"
        material = "aluminium"
        plate = { length_mm = 40.0, width_mm = 30.0, thickness_mm = 2.0 }
        zone = { length_mm = 16.0, width_mm = 12.0, centre_mm = [2.0, 1.0], nodal_lines = 1 }
        pillar = { side_mm = 2.0, height_mm = 6.0 }
        array = { pitch_mm = 4.0, rows = 1, surround = true }
        solve = { accuracy = 0.05 }
        """
    )
    for part, shape in (("plate", "sine"), ("zone", "free-free")):
        assert main(["modes", str(file), "--part", part, "--json", str(out), "--quiet"]) == 0
        assert json.loads(out.read_text())["target"]["shape"] == shape
