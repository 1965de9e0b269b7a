"""Several zones anywhere on a larger plate: rows, areas, target modes of each, crosstalk, and the whole solid."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from geometry.tiling import tile
from pipeline.case.features import PLACES
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models.forced import forced_plate, solve, solve_response
from pipeline.models.modes import PartModes, of_other_zones, solve_modes
from pipeline.planning.model_choice import Request
from pipeline.planning.resource_estimate import pillar_count
from pipeline.records.record import DesignRecord
from solvers.measures.confinement import measure, target_shape
from tests.helpers.whole_solid import check_within_both_bars
from tests.verification.test_zone_edges import AREAS, joined, some

ZONE = {"length_mm": 6.0, "width_mm": 5.0, "nodal_lines": 1}
PLACES_MM = [[-5.5, -0.5], [6.1, -0.5]]
RAW: dict[str, Any] = {
    "name": "several",
    "material": "aluminium",
    "plate": {"thickness_mm": 1.5, "length_mm": 25.0, "width_mm": 14.0},
    "zone": [{**ZONE, "centre_mm": PLACES_MM[0]}, {"centre_mm": PLACES_MM[1]}],
    "pillar": {"shape": "square", "side_mm": 1.6, "height_mm": 5.0},
    "array": {"pitch_mm": 4.0, "rows": 1, "surround": True},
    "solve": {"accuracy": 0.03},
}
PATCHES = 'patches={size_mm=[1.0, 1.0, 0.2], face="touch"}'
QUIET = TerminalLog(quiet=True)
MIRRORED = [[-x, y] for x, y in PLACES_MM]


def case_of(*settings: str, places: list[list[float]] = PLACES_MM) -> Case:
    return case_from_dict(RAW, None, [("zone.centres_mm", places), *settings])


def test_tables_and_centres_are_the_same_zones() -> None:
    design = case_from_dict(RAW).design
    assert design == case_of().design and not design.is_mirrored
    halves = [{**ZONE, "centre_x_mm": -5.5, "centre_y_mm": -0.5}, {"centre_y_mm": -0.5, "centre_x_mm": 6.1}]
    assert case_from_dict({**RAW, "zone": halves}).design == design
    assert [1e3 * np.array(view.centre_m) for view in design.views] == [pytest.approx(place) for place in PLACES_MM]


def test_rows_stand_around_each_zone_and_pillars_at_one_place_are_one() -> None:
    design = case_of().design
    feet = 1e3 * design.pillar_centres()
    own = {(x + dx, y + dy) for x, y in PLACES_MM for dx in (-3.8, 3.8) for dy in (-3.3, 3.3)}
    assert {tuple(row) for row in feet.round(9).tolist()} == {(round(x, 9), round(y, 9)) for x, y in own}
    assert len(feet) == 8 == pillar_count(design) == len(DesignRecord.of_design(design).standing)
    shared = case_of(places=[[-4.0, 0.0], [3.6, 0.0]]).design  # one column between both
    assert len(shared.pillar_centres()) == 6 == sum(len(group.centres) for group in shared.standing())
    tiling = tile(design, 4e-3)
    assert len(tiling.feet) == 8 and np.diff(tiling.x).min() > 1e-4


@pytest.mark.slow
def test_areas_are_those_of_each_zone_and_of_none() -> None:
    """Panels are cut at the borders of every zone; what lies in another zone is neither active nor passive."""
    design = case_of().design
    model = joined(design, None)
    touch = model.touch(None, some(model.assembled(None).dof))
    whole, zone = 25e-3 * 14e-3, 6e-3 * 5e-3
    for view in design.views:
        areas = [touch.weights[part].sum() for part in (view.in_zone(touch.points), view.passive(touch.points))]
        assert areas == pytest.approx([zone, whole - 2.0 * zone], rel=10.0 * AREAS)
        level, inside = measure(touch, view, None).confinement_db, view.in_zone(touch.points)
        square = touch.weights[:, None] * touch.values**2
        rms = [
            square[part].sum(axis=0) / area
            for part, area in ((inside, areas[0]), (view.passive(touch.points), areas[1]))
        ]
        assert level == pytest.approx(10.0 * np.log10(rms[0] / rms[1]), abs=1e-9)
        shape = target_shape(view, touch.points[inside])
        assert touch.weights[inside] @ shape**2 > 0.2 * zone
    reach = (6.0 + 3.2) * (5.0 + 3.2) * 1e-6
    beyond = touch.weights[design.beyond_rows(touch.points)].sum()
    assert beyond == pytest.approx(whole - 2.0 * reach, rel=10.0 * AREAS)


def test_patches_of_the_other_zones_rest() -> None:
    patches = case_of(PATCHES).patches
    assert patches is not None and patches.count == 4 and patches.drivers == (0, 1) and patches.resting == (2, 3)
    assert [x for x, _ in patches.centres_m[2:]] == pytest.approx([x + 11.6e-3 for x, _ in patches.centres_m[:2]])
    listening = case_of(PATCHES, "patches.sensors=[1]").patches
    assert listening is not None and listening.sensors == (1, 3) and listening.resting == (2,)
    placed = case_of(PATCHES, "patches.centres_mm=[[-5.5, -0.5], [6.1, -0.5], [0.3, 5.0]]").patches
    assert placed is not None and placed.drivers == (0, 2) and placed.resting == (1,)


REFUSED = {
    "overlap": (
        [[-5.5, 0.0], [0.0, 0.0]],
        "zones 1 and 2 overlap: must be at least 6 mm apart along x or 5 mm along y",
    ),
    "columns": ([[-5.5, 0.0], [6.0, 0.0]], "columns of zones 1 and 2 are 3.9 mm apart along x: .* x = 2.1 or x = 6.1"),
    "rows": ([[-5.5, 0.0], [6.1, 0.2]], "rows of zones 1 and 2 are 0.2 mm apart along y: must be in line"),
    "on a zone": ([[-4.5, -1.65], [2.5, 1.65]], "pillars of zone 2 would stand on zone 1: must leave it free"),
    "off the plate": ([[-5.5, 0.0], [10.0, 0.0]], "the zone extends beyond the plate"),
    "a single one": ([[0.0, 0.0]], "a list of 2 to 20 centres"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_zones_in_each_other_s_way_are_one_line(name: str) -> None:
    places, said = REFUSED[name]
    with pytest.raises(InputError, match=said) as refused:
        case_of(places=places)
    assert len(refused.value.lines) == 1


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ("zone.centre_mm=[1.0, 1.0]", "cannot be combined with centre_mm"),
        ("zone.count=2", "give the centre of each zone by centres_mm"),
        ("zone.gap_mm=3.0", "must be left out with centres_mm"),
        ("array.stagger=true", "rows of several zones are aligned"),
        ("array.heights_mm=[5.0]", "rows of several zones are alike"),
        ("patches={size_mm=[1.0, 1.0, 0.2], behind_mm=2.0}", "applies to a single zone only"),
    ],
)
def test_keys_of_a_single_zone_are_refused(key: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        case_of(key, *(["array.surround=false"] if "array" in key else []))


def test_tables_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InputError, match=r"\[\[zone\]\] 2: centre_mm: must give the centre of each zone"):
        case_from_dict({**RAW, "zone": [RAW["zone"][0], {}]})
    with pytest.raises(InputError, match="centre_mm: requires a larger plate"):
        case_from_dict({**RAW, "plate": {"thickness_mm": 1.5}})


@pytest.mark.parametrize("command", ["search", "tolerance", "drift", "hybrid", "travel", "explore", "export table"])
def test_commands_of_one_zone_refuse_them(command: str) -> None:
    with pytest.raises(
        InputError, match=f"{PLACES} = 2 centres: must be centre_mm of one: {command} supports a single"
    ):
        case_of().refuse(command, ("[plate] length_mm",))


def solved(places: list[list[float]]) -> tuple[Case, PartModes]:
    case = case_of("solve.accuracy=0.1", places=places)
    return case, solve_modes(case, Request("plate", band_hz=(40e3, 60e3), search=False), QUIET)


@pytest.mark.slow
def test_the_mirrored_plate_has_the_same_modes_and_targets() -> None:
    """The first zone's target mode is that of the second zone where both are exchanged, or their places mirrored."""
    found = {}
    for name, places in {"own": PLACES_MM, "mirrored": MIRRORED, "exchanged": PLACES_MM[::-1]}.items():
        case, own = solved(places)
        (other,) = of_other_zones(case, own)
        first = own.target_part()
        assert first is not None and first.mac is not None and other.target.mac is not None
        found[name] = [row.frequency_hz for row in own.rows], first, other.target
    tones, first, second = found["own"]
    assert (
        len(tones) > 3 and abs(first.mac - second.mac) > 1e-3
    )  # the zones differ: their ends are unlike far from the edges
    for name, order in (("mirrored", (first, second)), ("exchanged", (second, first))):
        assert found[name][0] == pytest.approx(tones, rel=1e-6)
        for one, other in zip(found[name][1:], order, strict=True):
            assert one.frequency_hz == pytest.approx(other.frequency_hz, rel=1e-6)
            assert (one.mac, one.confinement_db) == pytest.approx((other.mac, other.confinement_db), rel=1e-4)


@pytest.mark.slow
def test_reduced_cells_have_the_modes_of_the_whole_solid() -> None:
    check_within_both_bars(RAW, (30e3, 50e3), None)


@pytest.mark.slow
def test_crosstalk_is_that_of_the_mirrored_plate_and_response_that_of_the_first_zone() -> None:
    """Zones exchanged by a mirror exchange their levels; the rest of the first zone's peak is response's own."""
    band = (40e3, 60e3)
    cases = [case_of(PATCHES, "solve.accuracy=0.1", places=places) for places in (PLACES_MM, MIRRORED)]
    own, mirrored = (solve(case, QUIET, band, 5, []) for case in cases)
    for one, other in zip(own["zones"], mirrored["zones"], strict=True):
        assert one.peak_hz == pytest.approx(other.peak_hz, rel=1e-6) and one.centre_x_m == -other.centre_x_m
        assert one.level_db == pytest.approx(other.level_db, abs=1e-3)
        assert one.passive_db == pytest.approx(other.passive_db, abs=1e-3)
    first, second = own["zones"]
    assert first.drivers == [0, 1] and second.drivers == [2, 3] and own["gap_m"] == pytest.approx(5.6e-3)
    forced = forced_plate(cases[0], QUIET, band)
    curve = forced.driven_by(np.array([1.0, -1.0, 0.0, 0.0]) * forced.signs[0]).curve(np.array([first.peak_hz]))
    assert curve.zone_rms_m_per_v[0] == pytest.approx(first.rms_m_per_V[0], rel=1e-6)
    assert solve_response(cases[0], None, QUIET, band, 5, []).forced.drivers == [0, 1]
