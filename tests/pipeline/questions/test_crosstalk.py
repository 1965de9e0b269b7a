"""Several zones on one plate: geometry, one zone as before, a whole solid, energy, and what is refused."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geometry.hex.boxes import VOID, Boxes, hex_mesh, panel_boxes
from geometry.mesh import Mesh
from pipeline.case.model import Case, case_from_dict
from pipeline.cli.main import main
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models import forced as driven_zones
from pipeline.models import parts
from pipeline.models.answer_parts import DrivenZone, TouchStateRecord
from pipeline.models.forced import forced_plate
from pipeline.plots import style
from pipeline.plots.fields import draw_outlines
from pipeline.plots.rendering import _dimensions
from pipeline.questions.crosstalk import CrosstalkResult
from pipeline.questions.response import PeakRecord
from pipeline.questions.tolerance import SampleRecord
from pipeline.records.record import (
    DesignRecord,
)
from solvers.driven import curve_bars
from solvers.driven.curve_bars import Doubts
from solvers.driven.error_bars import Variation
from solvers.driven.several_patches import Zones, power_flow, zone_volts, zones_of
from solvers.fem.eigen import modes_near
from solvers.fem.solid import SolidModel
from solvers.measures.confinement import target_shape
from solvers.measures.target_mode import MIN_MAC
from solvers.piezo.forced import ForcedPlate
from solvers.piezo.responses import resonances_hz
from solvers.plates.assembled import PlateModel
from tests.helpers.asked import crosstalk_of
from tests.helpers.coarse_cells import mesh_coarsest
from tests.helpers.scenes import STEEL_PILLARS

QUIET = TerminalLog(quiet=True)
ZONE = STEEL_PILLARS["zone"]
BASE = {**STEEL_PILLARS, "solve": {"accuracy": 0.1, "band_kHz": [20.0, 50.0]}}
PATCHES = {
    "size_mm": [3.0, 2.0, 0.3],
    "face": "touch",
    "centres_mm": [[-5.0, -6.0], [5.0, 6.0], [0.0, 6.0]],
    "sensors": [2],
}
TWO = [ZONE, {"shared_rows": 1}]


def case_of(zone: Any = TWO, patches: Any = None, **more: Any) -> Case:
    raw = {**BASE, "zone": zone} | ({"patches": patches} if patches else {})
    return case_from_dict(raw, overrides=[(key.replace("__", "."), value) for key, value in more.items()])


@pytest.fixture(scope="module")
def forced() -> Iterator[ForcedPlate]:
    with pytest.MonkeyPatch.context() as patch:
        mesh_coarsest(patch)
        yield forced_plate(case_of(patches=PATCHES), QUIET)


def test_tables_are_one_table_and_rows_stand_between_the_zones() -> None:
    """Two zones of 10 mm, one row of feet of 2 mm between them; three with four rows over a wider gap."""
    design = case_of().design
    assert design == case_of({**ZONE, "count": 2, "shared_rows": 1}).design
    assert (design.zones, design.shared_rows) == (2, 1)
    assert design.zone_gap_m == pytest.approx(2e-3) and design.zone_centres_m == pytest.approx([-6e-3, 6e-3])
    assert design.row_places() == pytest.approx([-12e-3, 0.0, 12e-3])
    assert design.half_span_m == pytest.approx(11e-3 + 2e-3 + 4e-3)
    assert (
        len(design.pillar_centres())
        == 3 * len(design.column_centres())
        == sum(len(s.centres) for s in design.standing())
    )
    far = [{**ZONE, "centre_y_mm": -40.0}, {"centre_y_mm": 0.0, "shared_rows": 4}, {"centre_y_mm": 40.0}]
    design = case_of(far).design
    gap = [-34.0, -29.0, -11.0, -6.0]
    assert 1e3 * design.row_places() == pytest.approx([-46.0, *gap, *(-y for y in gap[::-1]), 46.0])
    assert case_of({**ZONE, "count": 3, "shared_rows": 4, "gap_mm": 30.0}).design == design


def test_pictures_show_every_zone_and_row() -> None:
    design = DesignRecord.of_design(case_of().design)
    assert len(design.standing) == len(design.pillar_centres_m) == 3 * 4
    _, axes = style.panels(2.0)
    draw_outlines(axes, design)
    assert sorted(float(line.get_ydata()[0]) for line in axes.lines) == pytest.approx([-11.0, -1.0, 1.0, 11.0])
    words = _dimensions(design, None)
    assert "2 zones 10 mm wide" in words and "3 rows of 4 square" in words


@pytest.mark.slow
def test_one_zone_is_what_it_was(forced: ForcedPlate) -> None:
    """Not a byte of the understood case differs, and its zone moves as the response says."""
    assert case_of([ZONE]).to_dict() == case_of(ZONE).to_dict() == case_of({**ZONE, "count": 1}).to_dict()
    assert not {"zones", "shared_rows", "zone_gap_m"} & case_of(ZONE).to_dict()["design"].keys()
    with pytest.MonkeyPatch.context() as patch:
        mesh_coarsest(patch)
        single = forced_plate(case_of(ZONE, {**PATCHES, "centres_mm": [[-5.0, 0.0], [5.0, 1.0]], "sensors": []}), QUIET)
    tones = np.array([25e3, 40e3])
    curve, ours = single.curve(tones), zones_of(single).rms(single.signs, tones)
    assert curve.passive_rms_m_per_v is not None
    assert ours[:, 0] == pytest.approx(curve.zone_rms_m_per_v, rel=1e-9)
    assert ours[:, 1] == pytest.approx(curve.passive_rms_m_per_v, rel=1e-9)


@pytest.mark.slow
def test_two_zones_meet_the_whole_solid_as_one_zone_does() -> None:
    """Elastic modes of cells joined against one mesh of the plate on the lines of all cells: what the reduction leaves out
    at coarse feet is as much with a row between two zones as without.
    """
    one, two = _apart(case_of(ZONE)), _apart(case_of())
    assert two <= 1.5 * one < 0.03


def _apart(case: Case) -> float:
    """Largest relative difference of elastic modes between the joined plate and the solid."""
    with pytest.MonkeyPatch.context() as patch:
        mesh_coarsest(patch)
        model = parts.build(case, "plate", 50e3, QUIET, [])
    assert isinstance(model, PlateModel) and case.design.pillar
    materials = {"plate": case.design.material, "pillar": case.design.pillar.material}
    solid = SolidModel(_on_all_lines(model, case), materials, (), True)
    apart = []
    for symmetry in ("SS", "SA"):  # both zones alike, and against each other
        ours, theirs = (np.sort(modes_near(each.pencil(symmetry), 20e3, 6).frequency_hz) for each in (model, solid))
        apart.append(float(np.abs(ours / theirs - 1.0).max()))
    return max(apart)


def _on_all_lines(model: PlateModel, case: Case) -> Mesh:
    """The quarter x, y >= 0 of the plate on the union of its panels' lines."""
    design, tiling = case.design, model.tiling
    lines: tuple[list[float], ...] = ([0.0], [0.0], [])
    for place in tiling.representatives(False):
        panel = tiling.panel(*place)
        boxes = panel_boxes(panel, design.stack, design.pillar, model.reductions.settings(panel))
        for axis, own in enumerate((boxes.x, boxes.y)):
            both = np.concatenate([own, -own]) if axis in panel.halved else own
            lines[axis].extend(v for v in both + panel.middle[axis] if v > 0.0)
        lines[2].extend(boxes.z)
    x, y, z = (np.unique(np.round(each, 9)) for each in lines)
    middles = [(each[1:] + each[:-1]) / 2.0 for each in (x, y, z)]
    above = middles[2] > design.thickness_m
    region = np.where(above, VOID, 0) * np.ones((len(x) - 1, len(y) - 1, 1), dtype=np.int64)
    for cx, cy in design.pillar_centres():
        near = [np.abs(middles[axis] - c) < 1e-3 for axis, c in enumerate((cx, cy))]
        region[near[0][:, None, None] & near[1][None, :, None] & above] = 1
    return hex_mesh(Boxes(x, y, z, region, ("plate", "pillar")), 3)


@pytest.mark.slow
def test_a_zone_s_motion_is_that_of_the_whole_face(forced: ForcedPlate) -> None:
    """Both zones and the rest from the unfolded operating shape: points in y of either sign, weights by the nearest areas."""
    zones, tone = zones_of(forced), 33e3
    volts = zone_volts(forced, np.array([[-5e-3, -6e-3], [5e-3, 6e-3], [0.0, 6e-3]]))
    assert np.array_equal(np.abs(volts), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    (ours,) = zones.rms(volts[0], np.array([tone]))
    points, values = forced.driven_by(volts[0].astype(complex)).shape(tone)
    weights = np.concatenate([basis.group.touch(basis.columns)[0].weights for basis in forced.modes[:1]])
    weights = np.tile(weights, len(points) // len(weights))
    for place, part in enumerate([points[:, 1] < -1e-3, points[:, 1] > 1e-3]):
        part = part & (np.abs(points[:, 1]) < 11e-3)
        rms = np.sqrt((weights[part] @ np.abs(values[part]) ** 2) / weights[part].sum())
        assert ours[place] == pytest.approx(rms, rel=1e-9)
        own = target_shape(forced.design, points[part] - [0.0, forced.design.zone_centres_m[place]])
        alike = abs((weights[part] * own) @ values[part]) ** 2 / (weights[part] @ own**2) / weights[part].sum() / rms**2
        assert zones.mac(volts[0], tone, place) == pytest.approx(alike, rel=1e-9)
    assert ours[0] != pytest.approx(ours[1], rel=0.05)
    lower = np.abs(points[:, 1] + 6e-3) < 5e-3
    target = target_shape(case_of(ZONE).design, points[lower] + [0.0, 6e-3])
    norms = weights[lower] @ target**2, weights[lower] @ np.abs(values[lower]) ** 2
    mac = abs((weights[lower] * target) @ values[lower]) ** 2 / np.prod(norms)
    assert zones.mac(volts[0], tone, 0) == pytest.approx(mac, rel=1e-9)
    flow = power_flow(forced.driven_by(volts[0].astype(complex)), tone)
    assert flow.patches_w.sum() == pytest.approx(flow.lost_w, rel=1e-9) and flow.lost_w > 0.0


@pytest.mark.slow
def test_what_one_zone_does_to_the_other_is_what_the_other_does_to_it(forced: ForcedPlate) -> None:
    """The plate turned by half: patches at (-5, -6) and (5, 6) mm are each other's images, the sensor's mass aside."""
    case = case_of(patches={**PATCHES, "centres_mm": [[-5.0, -6.0], [5.0, 6.0]], "sensors": []})
    with pytest.MonkeyPatch.context() as patch:
        mesh_coarsest(patch)
        record = crosstalk_of(case, QUIET, points=3)
    first, second = record.zones
    assert first.peak_hz == pytest.approx(second.peak_hz, rel=1e-6)
    assert first.level_db == pytest.approx(second.level_db[::-1], abs=1e-4) and first.level_db[0] == 0.0
    assert record.worst_db == max(first.level_db[1], second.level_db[0])
    assert CrosstalkResult.from_document(record.to_dict()) == record
    assert f"at most {round(record.worst_db, 1) + 0.0:.1f} dB" in record.pictures()[0].alt  # 0.0, not -0.0


def test_a_level_and_its_share_are_those_of_the_same_areas(forced: ForcedPlate) -> None:
    """10^(dB/10) (1 - share)/share = A_passive/A_zone, the share of zone and passive face from the unfolded shape.

    Documents of response, touch, crosstalk and tolerance have levels alone, no share of the zone: that of `touch` is of the
    free mode's shape. Where one gets a zone_share, it belongs here.
    """
    for part in (PeakRecord, SampleRecord, DrivenZone, TouchStateRecord):
        assert "zone_share" not in part.declared
    zones, tone, design = zones_of(forced), 33e3, forced.design
    fed = zone_volts(forced, np.array(PATCHES["centres_mm"]) * 1e-3)[0]
    (rms,) = zones.rms(fed, np.array([tone]))
    points, values = forced.driven_by(fed.astype(complex)).shape(tone)
    own = forced.modes[0].group.touch(forced.modes[0].columns)[0].weights
    energy = np.tile(own, len(points) // len(own)) * np.abs(values) ** 2
    y = points[:, 1]
    inside, passive = energy[(y > -11e-3) & (y < -1e-3)].sum(), energy[(np.abs(y) < 1e-3) | (np.abs(y) > 11e-3)].sum()
    share = inside / (inside + passive)
    areas = (2.0 * design.half_span_m - 2.0 * design.width_m) / design.width_m
    assert (rms[0] / rms[-1]) ** 2 * (1.0 - share) / share == pytest.approx(areas, rel=1e-6)


def doubts_of(forced: ForcedPlate, frequency: float, load: float) -> Doubts:
    """Every mode's frequency and every driver's load off by as much, relative."""
    value = np.concatenate([basis.eigenvalue for basis in forced.modes])
    gain = np.concatenate([basis.gain[:, forced.drivers] for basis in forced.modes])
    group = np.repeat(np.arange(len(forced.modes)), [len(basis.eigenvalue) for basis in forced.modes])
    ends = value[:, None] * ((1.0 + frequency * np.array([-1.0, 1.0])) ** 2 - 1.0)
    errors = np.full(len(value), frequency)
    return Doubts(value, ends, errors, load * np.abs(gain), np.full(gain.shape[1], load), group, 0.18, 0.0)


def test_curves_have_bars_that_hold_what_a_resonance_within_its_own_makes(
    forced: ForcedPlate, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Any resonance moved anywhere within its bar, of a percent here: no zone's curve leaves its own, some come near."""
    case = case_of(patches=PATCHES)
    assert case.patches is not None
    monkeypatch.setattr(driven_zones, "forced_plate", lambda *_, **__: forced)
    monkeypatch.setattr(driven_zones, "doubts", lambda *_: doubts_of(forced, 0.01, 0.0))
    monkeypatch.setattr(curve_bars, "AT_ONCE", 5)
    record = crosstalk_of(case, QUIET, points=9)
    zones, fed = zones_of(forced), zone_volts(forced, np.array(case.patches.centres_m))[0]
    bars = np.array(record.zones[0].over_rms_error_m_per_V, dtype=float)
    nominal, used = np.array(record.zones[0].over_rms_m_per_V), 0.0
    assert bars.shape == nominal.shape and np.isfinite(bars).all()
    for basis in forced.modes:
        for place, value in enumerate(basis.eigenvalue):
            for end in (0.99, 0.997, 1.004, 1.01):
                varied = Variation(basis, (place,), (value * end**2,)).of(forced)
                moved = Zones(varied, zones.grams, zones.shapes).rms(fed, np.array(record.frequency_hz)).T[:-1]
                off = np.abs(moved - nominal)
                assert (off <= bars * (1.0 + 1e-9)).all()
                used = max(used, float((off / bars).max()))
    assert used > 0.5


def test_curves_have_bars_about_as_wide_as_all_that_is_wrong_together(
    forced: ForcedPlate, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Plates whose modes are all off at once, each by a share of its bar drawn evenly from -1 to 1.

    Independent shares that add up by their squares come to 1/sqrt(3) of the bar: nine of ten lie within it, and half of them
    beyond a tenth of it.
    """
    monkeypatch.setattr(driven_zones, "forced_plate", lambda *_, **__: forced)
    monkeypatch.setattr(driven_zones, "doubts", lambda *_: doubts_of(forced, 0.002, 0.0))
    record = crosstalk_of(case_of(patches=PATCHES), QUIET, points=41)
    zones, fed = zones_of(forced), zone_volts(forced, np.array(PATCHES["centres_mm"]) * 1e-3)[0]
    nominal, bars = (
        np.array(getattr(record.zones[0], name)) for name in ("over_rms_m_per_V", "over_rms_error_m_per_V")
    )
    draw, used = np.random.default_rng(5), []
    for _ in range(12):
        other = forced.driven_by(np.zeros(len(forced.plate.patches), dtype=complex))
        other.modes = [
            replace(
                basis, eigenvalue=basis.eigenvalue * (1.0 + 0.002 * draw.uniform(-1.0, 1.0, len(basis.eigenvalue))) ** 2
            )
            for basis in forced.modes
        ]
        moved = Zones(other, zones.grams, zones.shapes).rms(fed, np.array(record.frequency_hz)).T[:-1]
        used.append(np.abs(moved - nominal) / bars)
    assert np.mean(np.array(used) <= 1.0) > 0.9 and np.median(used) > 0.1


def test_a_peak_s_bars_follow_its_mode(forced: ForcedPlate, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bars hold what the plate shows at the moved peak of a moved resonance; the driven zone's own level is exactly 0.

    At a tone that stays, a resonance of quality 300 moved by a percent leaves a sixth of the height: no such bar is meant.
    """
    case = case_of(patches=PATCHES)
    assert case.patches is not None
    monkeypatch.setattr(driven_zones, "forced_plate", lambda *_, **__: forced)
    monkeypatch.setattr(driven_zones, "doubts", lambda *_: doubts_of(forced, 0.01, 0.02))
    record = crosstalk_of(case, QUIET, points=2)
    zones, fed = zones_of(forced), zone_volts(forced, np.array(case.patches.centres_m))[0]
    first = record.zones[0]
    assert first.level_db[0] == first.level_error_db[0] == 0.0  # type: ignore[index]
    assert "zones at 0 dB, " in [*record.lines()][1]
    rms, half = np.array(first.rms_m_per_V), np.array(first.rms_error_m_per_V, dtype=float)
    assert half[0] < 0.2 * rms[0] and (half > 0.02 * rms).all()
    tones = np.concatenate([basis.frequency_hz for basis in forced.modes])
    nearest = float(tones[np.abs(tones - first.peak_hz).argmin()])
    basis, place = next((b, int(k)) for b in forced.modes for k in np.flatnonzero(b.frequency_hz == nearest))
    for end in (0.99, 1.01):
        varied = Variation(basis, (place,), (basis.eigenvalue[place] * end**2,)).of(forced)
        (moved,) = Zones(varied, zones.grams, zones.shapes).rms(fed, np.array([first.peak_hz * end]))
        assert (np.abs(moved[:-1] - rms) <= half * (1.0 + 1e-9)).all()


def test_a_zone_whose_peak_is_not_its_target_mode_is_told(
    forced: ForcedPlate, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """At one of the plate's resonances the zone moves in its target shape, at another in another: only the latter is told."""
    volts = zone_volts(forced, np.array([[-5e-3, -6e-3], [5e-3, 6e-3], [0.0, 6e-3]]))[0]
    zones = zones_of(forced)
    tones = resonances_hz(forced)
    macs = np.array([zones.mac(volts, float(tone), 0) for tone in tones])
    assert ((macs >= 0.0) & (macs <= 1.0)).all() and macs.max() > MIN_MAC > macs.min()
    case = case_of(patches=PATCHES)
    monkeypatch.setattr(driven_zones, "forced_plate", lambda *_, **__: forced)
    for tone, said in ((tones[macs.argmax()], False), (tones[macs.argmin()], True)):
        monkeypatch.setattr(Zones, "peak_hz", lambda *_, tone=float(tone): tone)
        crosstalk_of(case, TerminalLog(quiet=False), points=2)
        assert ("zone 1 moves most at" in capsys.readouterr().err) == said


def test_patches_of_the_antinodes_stand_in_every_zone() -> None:
    case = case_of(patches={"size_mm": [2.0, 2.0, 0.3], "sensors": [1]})
    assert case.patches is not None and case.patches.count == 8
    assert case.patches.sensors == (1, 5) and case.patches.drivers == (0, 2, 3, 4, 6, 7)
    assert 1e3 * np.array(case.patches.centres_m)[:, 1] == pytest.approx([-6.0] * 4 + [6.0] * 4)


@pytest.mark.parametrize(
    ("zone", "said"),
    [
        (
            [ZONE, {"width_mm": 12.0, "shared_rows": 1}],
            r"\[\[zone\]\] 2: width_mm = 12.0: must be 10.0 as in the first",
        ),
        ([ZONE, {"shared_rows": 1}, {"shared_rows": 2}], "must be the same between all zones"),
        ([ZONE, {}], "the zones touch"),
        ([{**ZONE, "centre_y_mm": -6.0}, {}], "must be a number in every table or in none"),
        ([{**ZONE, "centre_y_mm": 0.0}, {"centre_y_mm": 20.0}], "must ascend evenly around 0"),
        ({**ZONE, "count": 2, "shared_rows": 2, "gap_mm": 3.0}, "must be at least 7, the width of 2 rows"),
        ({**ZONE, "count": 2, "shared_rows": 1, "gap_mm": 9.0}, "must be even if gap_mm = 9 leaves room"),
        ({**ZONE, "shared_rows": 2}, "applies to several zones only"),
    ],
)
def test_zones_that_cannot_be_are_one_line(zone: Any, said: str) -> None:
    with pytest.raises(InputError, match=said) as refused:
        case_of(zone)
    assert len(refused.value.lines) == 1


def test_commands_of_one_zone_say_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = Path(__file__).resolve().parents[3] / "examples" / "37-two-zones.toml"
    for command in ("modes", "response", "hybrid", "travel", "broadband"):
        assert main([command, str(file), "--quiet"]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "zone.count = 2" in line and "supports a single zone" in line
    with pytest.raises(InputError, match="no patch drives zone 2"):
        crosstalk_of(case_of(patches={**PATCHES, "centres_mm": [[-5.0, -6.0]], "sensors": []}), QUIET)
