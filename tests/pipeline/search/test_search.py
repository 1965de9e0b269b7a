"""antinode search: what may vary, what a design must keep, cheap fidelities before expensive ones, evaluations kept,
faults told.
"""

from __future__ import annotations

import json
import re
from dataclasses import replace
from math import isnan
from pathlib import Path

import numpy as np
import pytest

from geometry.layout import Pillar
from pipeline.case.model import Case, load_case
from pipeline.case.schema import known_keys, of_any_element
from pipeline.cli.main import main
from pipeline.errors import InputError
from pipeline.paths import ROOT, STUDIES
from pipeline.questions.search import Search, SearchResult, Varied
from pipeline.search import fidelity, optimiser
from pipeline.search.fidelity import (
    COLUMN,
    PLATE,
    STRIP,
    EvaluationCache,
    FidelityResult,
    by_strip,
    column_level_error_db,
    evaluate,
    frequency_slack,
    worst,
)
from pipeline.search.optimiser import Settings, front
from pipeline.search.space import searchable_keys, word_keys
from pipeline.search.terms import FoundDesign, Limits, Range, mass_kg
from tests.helpers.recording_log import RecordingLog
from tests.helpers.searching import parse_vary, read_space

CASE = str(STUDIES / "three-rows.toml")
ON_GLASS = str(ROOT / "examples" / "28-zone-on-glass.toml")
SCREWED = str(ROOT / "examples" / "30-screwed-plate.toml")
SMALL = (
    "zone.length_mm=40", "zone.nodal_lines=3", "zone.width_mm=18", "array.rows=1", "array.extension_mm=5", "solve.accuracy=0.1",
    "patches.centres_mm=[[0.0,0.0]]", "patches.sensors=[]", "patches.size_mm=[4.0,3.0,0.3]",
)  # fmt: skip
VARY = ("--vary", "pillar.height_mm=5.6:6.6")


def run(*arguments: str) -> int:
    try:
        return main(["search", *arguments])
    except SystemExit as end:
        return int(end.code or 0)


def small(*more: str) -> list[str]:
    return [part for text in (*SMALL, *more) for part in ("--set", text)]


def fake(case, fidelity: str, near_hz: float | None = None, cache: object = None) -> FidelityResult:
    """A smooth landscape with its top at 6.56 mm and 4.75 mm, between the strips' grid points; they see it 0.4 mm off."""
    height, pitch = 1e3 * case.design.pillar.height_m, 1e3 * case.design.pitch_x_m
    top = 6.16 if fidelity == STRIP else 6.56
    clamped = 20.0 - 30.0 * (height - top) ** 2 - 4.0 * (pitch - 4.75) ** 2
    return FidelityResult(
        fidelity=fidelity, frequency_hz=5e3 * height, confinement_db=clamped, extension_db=clamped - 1.0, mac=0.95
    )


def put(monkeypatch: pytest.MonkeyPatch, result) -> None:
    """A landscape in place of all models."""
    monkeypatch.setattr(optimiser, "evaluate", result)
    monkeypatch.setattr(optimiser, "by_strip", lambda case, softness: result(case, STRIP))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "--vary: missing"),
        (("--vary", "pillar.height_mm"), "KEY=LOW:HIGH"),
        (("--vary", "pillar.hight_mm=5:8"), "pillar.height_mm"),
        (("--vary", "pillar.height_mm=8:5"), "below the high end"),
        (("--vary", "pillar.height_mm=five:8"), "must be numbers"),
        (("--vary", "pillar.height_mm=-5:8"), "above 0"),
        (("--vary", "pillar.diameter_mm=1:2"), "square pillar"),
        (("--vary", "array.rows=1:2.5"), "whole numbers"),
        (("--vary", "solve.accuracy=0.01:0.02"), "does not set a number of the plate"),
        (("--vary", "pillar.height_mm=5:8", "--vary", "pillar.height_mm=6:7"), "already"),
        (("--vary", "pillar.height_mm=5:8", "--goal", "beauty"), "--goal"),
        (("--vary", "pillar.height_mm=5:8", "--min-frequency", "-3kHz"), "--min-frequency"),
        (("--vary", "pillar.height_mm=5:8", "--mac", "1.5"), "--mac"),
        (("--vary", "pillar.height_mm=5:8", "--set", "array.rows=0"), "array.rows"),
        (("--vary", "pillar.height_mm=5:8", "--evaluations", "0"), "1 or more"),
        (("--vary", "pillar.height_mm=5:8", "--goal", "worst"), "tolerance.height_mm"),
        (("--vary", "array.heights_mm=5:0.001"), "below the high end"),
        (("--vary", "zone.count=1:2"), "zone.count: cannot vary, one zone has no other"),
        (("--vary", "array.stagger=0:1"), "must be array.stagger=false:true"),
        (("--vary", "array.pitches_y_mm=1:1.5", "--set", "array.pitch_x_mm=4"), "overlap"),
    ],
)
def test_a_bad_search_is_one_line_and_exit_code_2(
    arguments: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(CASE, "--quiet", *arguments) == 2
    text = [line for line in capsys.readouterr().err.splitlines() if line]
    assert len(text) == 1 and said in text[0]


def test_what_may_vary() -> None:
    keys = searchable_keys()
    assert keys["array.rows"] and keys["zone.nodal_lines"] and not keys["pillar.height_mm"]
    assert not {"pillar.shape", "pillar.file", "solve.accuracy"} & set(keys)
    height = parse_vary("pillar.height_mm=5:8")
    assert height.snapped(0.43333) == 6.3 and height.snapped(-1.0) == 5.0 and height.snapped(2.0) == 8.0
    assert parse_vary("array.rows=1:4").snapped(0.5) in (2, 3)


def test_the_file_is_its_own_first_design() -> None:
    space = read_space(CASE, [], ["pillar.height_mm=5:8", "array.pitch_mm=4:8"])
    assert space.own_values() == (6.3, 4.0)
    assert space.case(space.own_values()).to_dict() == space.case().to_dict()
    assert read_space(CASE, ["pillar.height_mm=9"], ["pillar.height_mm=5:8"]).own_values() is None


@pytest.mark.parametrize(("right", "up"), [(1, 1), (-1, 1), (-1, -1)])
def test_a_zone_moves_over_a_larger_plate_by_assembled_plates_alone(
    right: int, up: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A landscape with its top at (3, -2) mm, or mirrored or turned: the zone goes there, both coordinates at once."""
    top, tried = np.array([3e-3 * right, -2e-3 * up]), []

    def plate(case: Case, fidelity: str, near_hz: float | None = None, cache: object = None) -> FidelityResult:
        tried.append((fidelity, near_hz))
        away = float(1e6 * ((np.array(case.design.centre_m) - top) ** 2).sum())
        return FidelityResult(fidelity=fidelity, frequency_hz=40e3, confinement_db=20.0 - away, mac=0.9)

    put(monkeypatch, plate)
    place, out = [8 * right, -5 * up], tmp_path / "found.json"
    more = ["--set", f"zone.centre_mm={place}", "--evaluations", "40", "--quiet", "--json", str(out)]
    assert run(ON_GLASS, "--vary", "zone.centre_mm=-9:9", *more) == 0
    found = json.loads(out.read_text())
    assert {each for each, _ in tried} == {PLATE} and {near for _, near in tried} == {None}
    assert found["evaluations"][0]["set"]["zone.centre_mm[1]"] == place[0]
    best = [found["best"]["set"][f"zone.centre_mm[{axis}]"] for axis in (1, 2)]
    assert best == pytest.approx(1e3 * top, abs=0.5)
    assert f"zone.centre_mm=[{best[0]:g},{best[1]:g}]" in found["repeat"]
    design = load_case(ON_GLASS).design
    whole = 0.09 * 0.06 * design.stack.mass_kg_m2 + len(design.pillar_centres()) * design.pillar.mass_kg
    assert found["best"]["mass_kg"] == pytest.approx(whole)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--vary", "pillar.height_mm=6:7", "--goal", "widest"), "search --goal widest supports a plate as long as"),
        (("--vary", "zone.centre_mm=60:70"), "the zone extends beyond the plate"),
        (("--vary", "zone.centre_x_mm=60:70"), "the zone extends beyond the plate"),
        (
            ("--vary", "zone.centre_mm=0:2", "--vary", "zone.centre_x_mm=0:2"),
            "cannot vary together with zone.centre_x_mm",
        ),
        (("--vary", "zone.centres_mm=0:2"), "does not set a number of the plate"),
        (("--vary", "array.rows=20:30"), "rows do not fit between zone and edge"),
        (("--vary", "array.extension_mm=1:2"), "must be left out of a plate with length_mm"),
    ],
)
def test_what_a_larger_plate_cannot_vary_is_one_line(
    arguments: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(ON_GLASS, "--quiet", *arguments) == 2
    text = [line for line in capsys.readouterr().err.splitlines() if line]
    assert len(text) == 1 and said in text[0]


@pytest.mark.parametrize(
    "given", [("zone.centre_mm=[8.0,-5.0]",), ("zone.centre_mm=[0.0,-5.0]", "zone.centre_x_mm=8.0")]
)
def test_the_zone_moves_along_each_axis_in_a_range_of_its_own(given: tuple[str, ...]) -> None:
    """What is not varied stays, and the design of the file is known to the search."""
    space = read_space(ON_GLASS, [*given], ["zone.centre_y_mm=-6:0", "zone.centre_x_mm=4:9"])
    assert space.own_values() == (-5.0, 8.0)
    moved = space.case((-2.0, 4.5))
    assert 1e3 * np.array(moved.design.centre_m) == pytest.approx([4.5, -2.0])
    assert space.overrides((-2.0, 4.5)) == ["zone.centre_y_mm=-2", "zone.centre_x_mm=4.5"]
    one = read_space(ON_GLASS, [*given], ["zone.centre_x_mm=4:9"])
    assert 1e3 * np.array(one.case((4.5,)).design.centre_m) == pytest.approx([4.5, -5.0])


def test_a_key_with_a_value_a_row_varies_row_by_row() -> None:
    space = read_space(CASE, ["pillar.height_mm=6.2"], ["array.heights_mm=5:7", "array.extension_mm=5:25"])
    assert [variable.name for variable in space.variables][:3] == [f"array.heights_mm[{row}]" for row in (1, 2, 3)]
    assert space.own_values() == (6.2, 6.2, 6.2, 25.0)
    assert space.case(space.own_values()).to_dict() == space.case().to_dict()
    assert space.overrides((6.6, 6.2, 5.8, 8.0)) == ["array.heights_mm=[6.6,6.2,5.8]", "array.extension_mm=8"]
    heights = [pillar.height_m for pillar in space.case((6.6, 6.2, 5.8, 8.0)).design.graded]
    assert heights == pytest.approx([6.6e-3, 6.2e-3, 5.8e-3])
    with pytest.raises(InputError, match="cannot vary together"):
        read_space(CASE, [], ["array.heights_mm=5:7", "array.rows=1:3"])


@pytest.mark.parametrize(
    ("key", "title"),
    [
        ("pillar.height_mm", "pillar height (mm)"),
        ("zone.shared_rows", "zone shared rows"),
        ("array.heights_mm[2]", "array heights [2] (mm)"),
        ("pillar.section.1.side_mm", "pillar section 1 side (mm)"),
    ],
)
def test_an_axis_names_its_key_in_words(key: str, title: str) -> None:
    assert Varied(key=key, low=1.0, high=2.0, step=0.1).title == title


def test_a_key_of_two_words_is_chosen() -> None:
    space = read_space(CASE, [], ["array.stagger=false:true", "pillar.faces=both:back", "pillar.height_mm=5:8"])
    told = [variable.written(value) for variable, value in zip(space.variables, (1, 0, 6.3), strict=True)]
    assert space.own_values() == (0, 0, 6.3) and told == ["true", "back", 6.3]
    assert space.overrides((1, 1, 6.0)) == ["array.stagger=true", "pillar.faces=both", "pillar.height_mm=6"]
    assert {space.values((share, share, 0.0))[:2] for share in (0.0, 0.2, 0.7, 1.0)} == {(0, 0), (1, 1)}
    with pytest.raises(InputError, match=r"must be pillar\.faces=back:both"):
        parse_vary("pillar.faces=back:touch")


CAP = "pillar={side_mm=2.0, section=[{height_mm=6.3}, {side_mm=3.0, height_mm=1.0}]}"
CHANGES = {  # every key of rows, tips, faces and zones: what the file has beside, what is varied
    "array.heights_mm": ((), "5:7"),
    "array.sides_mm": ((), "1.5:2.5"),
    "array.pitches_y_mm": (("array.pitch_x_mm=4",), "4:6"),
    "array.stagger": (("pillar.side_mm=1.5",), "false:true"),
    "pillar.faces": ((), "back:both"),
    "pillar.shape": ((), "square:hexagonal"),
    "pillar.material": ((), "steel:brass"),
    "pillar.section.1.side_mm": ((CAP,), "2:3"),
    "pillar.section.1.height_mm": ((CAP,), "0:2"),
    "pillar.section.1.material": ((CAP,), "steel:titanium"),
    "zone.shared_rows": (("zone.count=2",), "1:4"),
    "zone.gap_mm": (("zone.count=2", "zone.shared_rows=2"), "8:20"),
}
REFUSED = {  # keys of what stands on a plate, or how it is held against it: what a search says of each
    "touch.radius_mm": "3:6", "touch.impedance": "finger:pen", "touch.at_mm": "0:5", "touch.force_N": "0.1:1",
    "touch.gap_um": "1:2", "touch.limit_V": "1:9", "touch.impedance.mass_g": "1:2", "patches.behind_mm": "3:8",
    "patches.size_mm": "1:3", "patches.centres_mm": "0:3", "patches.drive_V": "1:9", "pillar.file": "a:b",
}  # fmt: skip


@pytest.mark.parametrize("key", CHANGES)
def test_a_key_beyond_the_thesis_varies_the_design(key: str) -> None:
    """Both ends are designs of their own, and the file's value where it has one lies between them."""
    fixed, ends = CHANGES[key]
    raw = CASE if not fixed or not fixed[0].startswith("zone") else str(ROOT / "examples" / "37-two-zones.toml")
    fixed = (*fixed, "patches.centres_mm=[[0.0,0.0]]", "patches.sensors=[]") if raw == CASE else fixed
    space = read_space(raw, fixed, [f"{key}={ends}"])
    low, high = (space.values([share] * len(space.variables)) for share in (0.0, 1.0))
    assert space.case(low).design != space.case(high).design
    overrides = "".join(space.overrides(high))
    assert overrides.startswith(f"{key}=") and ends.split(":")[1] in overrides


@pytest.mark.parametrize("key", REFUSED)
def test_a_key_that_shapes_no_plate_is_refused_by_one_line(key: str) -> None:
    with pytest.raises(InputError) as refused:
        read_space(CASE, [], [f"{key}={REFUSED[key]}"])
    (line,) = refused.value.lines
    assert f"{key} does not set a number of the plate" in line
    assert line.endswith("must be a number or a choice in one of [plate], [zone], [pillar], [array]")


def test_every_key_of_a_case_file_varies_or_is_told_why_not() -> None:
    varied = {*searchable_keys(), *word_keys()}
    assert {*map(of_any_element, CHANGES)} <= varied and not REFUSED.keys() & varied
    for key in {*known_keys()} - varied:
        with pytest.raises(InputError, match=rf"--vary {re.escape(key)}=1:2: .* must be "):
            parse_vary(f"{key}=1:2")


def test_materials_and_shapes_are_chosen_by_name() -> None:
    space = read_space(CASE, [], ["material=steel:aluminium", "pillar.shape=hexagonal:square"])
    assert [variable.words for variable in space.variables] == [("aluminium", "steel"), ("square", "hexagonal")]
    assert space.own_values() == (0, 0) and space.overrides((1, 1)) == ["material=steel", "pillar.shape=hexagonal"]
    assert read_space(CASE, ["material=pmma"], ["material=steel:aluminium"]).own_values() is None
    with pytest.raises(InputError, match=r"material=aluminium:AlSi7Mg0\.6, two of aluminium, "):
        parse_vary("pillar.material=gold:steel")
    with pytest.raises(InputError, match=r"pillar\.diameter_mm"):
        read_space(CASE, [], ["pillar.shape=square:round"])


def test_a_section_of_the_file_is_varied() -> None:
    space = read_space(CASE, [CAP], ["pillar.section.1.side_mm=2.2:3.2", "pillar.section.1.height_mm=0.5:2"])
    assert space.own_values() == (3.0, 1.0)
    assert space.case((2.5, 2.0)).design.pillar.upper[0].base_m == pytest.approx(2.5e-3)
    with pytest.raises(InputError, match=r"2 must be the number of one of its tables, 0 to 1"):
        read_space(CASE, [CAP], ["pillar.section.2.side_mm=2.2:3"])


def test_the_widest_band_ranks_columns_and_plates(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two rows tuned apart: bands add up to 0.6 mm of difference and part beyond; no strip is asked, and kHz are told."""

    def banded(case, fidelity: str, near_hz=None, cache=None, banded: bool = False) -> FidelityResult:
        assert banded and fidelity != STRIP
        one, other = (1e3 * pillar.height_m for pillar in case.design.row_pillars)
        width = 4.0 + (abs(one - other) if abs(one - other) < 0.6 else -1.0)
        return FidelityResult(
            fidelity=fidelity, frequency_hz=30e3, confinement_db=12.0, extension_db=11.0, mac=0.95, band_khz=width
        )

    put(monkeypatch, banded)
    space = read_space(CASE, ["array.heights_mm=[6.0,6.0]", "array.rows=2"], ["array.heights_mm=5.6:6.6"])
    outcome = optimiser.search(space, Settings("widest"), RecordingLog())
    assert not outcome.by_fidelity[STRIP]
    assert outcome.gain is not None and 0.4 < outcome.gain < 0.6 and outcome.gain_error_db is None
    result = SearchResult.of_outcome(outcome)
    assert result.gain_db is None and result.gain_khz == outcome.gain
    assert result.best.band_khz == outcome.best.goal_value and result.pictures()[0].alt


def test_the_worst_case_is_the_least_of_three_plates_with_all_heights_off() -> None:
    """A level of 20 - 30 (h - 6.2)^2 dB, h in mm: at 6.3 +- 0.2 the worst lies at 6.5."""
    case = load_case(CASE, ["array.heights_mm=[6.3,6.3,6.0]"])

    def evaluated(case: Case) -> FidelityResult:
        first = case.design.row_pillars[0]
        assert case.design.pillar == first and case.design.row_pillars[2].height_m == pytest.approx(
            first.height_m - 0.3e-3
        )
        return FidelityResult(
            fidelity=COLUMN, frequency_hz=34e3, confinement_db=20.0 - 30.0 * (1e3 * first.height_m - 6.2) ** 2, mac=0.9
        )

    result = worst(case, 0.2e-3, evaluated)
    assert result.worst_db == pytest.approx(20.0 - 30.0 * 0.3**2)
    assert result.confinement_db == pytest.approx(20.0 - 30.0 * 0.1**2)
    assert result.worst_error_db is None

    def barred(
        case: Case,
    ) -> FidelityResult:  # 17.3 +- 0.1 dB at 6.5 mm, 19.7 +- 3 dB at 6.1 mm: the least may be 16.7 dB
        is_low = case.design.row_pillars[0].height_m < 6.2e-3
        return replace(evaluated(case), confinement_error_db=3.0 if is_low else 0.1)

    assert worst(case, 0.2e-3, barred).worst_error_db == pytest.approx(17.3 - 16.7)
    nothing = FidelityResult(fidelity=COLUMN)
    assert worst(case, 0.2e-3, lambda each: nothing).worst_db is None


@pytest.mark.parametrize(
    ("lines", "slack"), [(0, 0.26 / 1.5), (2, 0.26 / 1.5), (4, 0.26 / 3.5), (8, 0.26 / 7.5), (40, 0.02)]
)
def test_cheap_fidelities_may_be_off_by_what_the_free_ends_do(lines: int, slack: float) -> None:
    assert frequency_slack(COLUMN, lines) == pytest.approx(slack)
    assert frequency_slack(STRIP, lines) == pytest.approx(max(slack, 0.1))
    assert frequency_slack(PLATE, lines) == 0.0
    assert column_level_error_db(None, lines) is None
    assert column_level_error_db(-3.0, 4) == pytest.approx(1.0 + 3.0 / 3.5)


def test_limits() -> None:
    design, limits = load_case(CASE).design, Limits()
    assert limits.of_design(design) == [] and limits.of_mode(30e3, 0.9) == []
    assert "24.0 kHz" in limits.of_mode(24e3, 0.9)[0][0]
    assert limits.of_mode(24e3, 0.9, slack=0.1) == []
    assert "MAC" in limits.of_mode(30e3, 0.5)[0][0]
    assert "half-wavelength 33.0 mm" in limits.of_design(replace(design, nodal_lines=4))[0][0]
    assert "gap between pillars" in limits.of_design(replace(design, pitch_x_m=2.3e-3))[0][0]
    leaning = Pillar("tapered", 1e-3, 3.9e-3, 1.4e-3, design.material)
    assert any("lean" in text for text, _ in limits.of_design(replace(design, pillar=leaning)))
    assert not any(
        "lean" in text for text, _ in limits.of_design(replace(design, pillar=replace(leaning, height_m=2e-3)))
    )


def test_mass_of_plate_and_pillars() -> None:
    design = load_case(CASE).design
    plate, pillars = 115.5 * 2.0 * (10 + 10 + 25) * 2.0, 2 * 3 * 29 * 4.0 * 6.3  # mm3: two pitches and a foot a side
    assert mass_kg(design) == pytest.approx(2700e-9 * (plate + pillars), rel=1e-12)
    assert isnan(mass_kg(replace(design, pillar=replace(design.pillar, shape="step"))))
    assert mass_kg(replace(design, rows=0)) == pytest.approx(2700e-9 * 115.5 * 2.0 * 35.0 * 2.0, rel=1e-12)


@pytest.mark.slow
def test_cheap_models_lead_the_dear_one_to_the_top(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The strips' top is 0.4 mm off; columns and plates find the true one, within the step, and within the budget."""
    put(monkeypatch, fake)
    space = read_space(CASE, [], ["pillar.height_mm=5:8", "array.pitch_mm=4:8"])
    result = optimiser.search(space, Settings(evaluations=12), fidelity.WarningLog(), EvaluationCache(tmp_path))
    assert result.best.point[0] == pytest.approx(6.56, abs=0.03) and result.best.point[1] == pytest.approx(
        4.75, abs=0.1
    )
    assert result.best.goal_value == pytest.approx(20.0, abs=0.05)
    assert len(result.by_fidelity[PLATE]) <= 12 and len(result.by_fidelity[COLUMN]) <= 12 * 4
    assert len(result.by_fidelity[STRIP]) == 25 * 25
    assert result.gain == pytest.approx(result.best.goal_value - fake(space.case(), PLATE).confinement_db)


@pytest.mark.slow
def test_no_limit_is_traded_for_the_goal(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    put(monkeypatch, fake)
    space = read_space(CASE, [], ["pillar.height_mm=5:8", "array.pitch_mm=4:8"])
    settings = Settings(limits=Limits(lowest_hz=34.5e3), evaluations=12)
    result = optimiser.search(space, settings, fidelity.WarningLog(), EvaluationCache(tmp_path))
    assert result.best.frequency_hz >= 34.5e3 and result.best.point[0] == pytest.approx(6.9, abs=0.05)
    assert all(each.frequency_hz >= 34.5e3 for each in result.tradeoff)


@pytest.mark.parametrize(("target", "low_hz", "high_hz"), [("31kHz", 30.69e3, 31.31e3), ("34kHz:35kHz", 34e3, 35e3)])
def test_the_target_mode_is_kept_in_its_window(
    target: str, low_hz: float, high_hz: float, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Best of the goal among the designs there: the end of the window that is nearer to the top, at 32.8 kHz."""
    put(monkeypatch, fake)
    file = tmp_path / "s.json"
    words = ["--quiet", "--vary", "pillar.height_mm=5:8", "--evaluations", "8", "--json", str(file)]
    assert run(CASE, *words, "--target", target) == 0
    found = json.loads(file.read_text())
    top_hz = 32.8e3
    nearest = low_hz if low_hz > top_hz else high_hz
    assert low_hz <= found["best"]["frequency_hz"] <= high_hz
    assert found["best"]["frequency_hz"] == pytest.approx(nearest, abs=0.15e3)
    assert (found["limits"]["lowest_hz"], found["limits"]["highest_hz"]) == pytest.approx((low_hz, high_hz))


def test_where_nothing_keeps_the_limits_the_closest_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    put(monkeypatch, fake)
    assert run(CASE, "--quiet", "--vary", "pillar.height_mm=5:6", "--min-frequency", "90kHz", "--evaluations", "4") == 4
    text = capsys.readouterr().err
    assert "pillar.height_mm=6" in text and "at least 90" in text


def test_counts_are_tried_and_not_descended(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def by_rows(case, fidelity: str, near_hz: float | None = None, cache: object = None) -> FidelityResult:
        return replace(fake(case, fidelity), confinement_db=4.0 * case.design.rows)

    put(monkeypatch, by_rows)
    space = read_space(CASE, [], ["array.rows=1:4"])
    result = optimiser.search(space, Settings(evaluations=4), fidelity.WarningLog(), EvaluationCache(tmp_path))
    assert result.best.point == (4,) and len(result.by_fidelity[STRIP]) == 4


def test_pillars_that_hexahedra_do_not_follow_go_from_strips_to_plates(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    put(monkeypatch, fake)
    shape = ["pillar.shape=round", "pillar.diameter_mm=2"]
    evenly = Settings(evaluations=6)
    space = read_space(CASE, shape, ["pillar.height_mm=6:7"])
    assert optimiser.search(space, evenly, fidelity.WarningLog(), EvaluationCache(tmp_path)).by_fidelity[COLUMN]
    space = read_space(CASE, [*shape, "pillar.fillet_mm=0.5"], ["pillar.height_mm=6:7"])
    result = optimiser.search(space, evenly, fidelity.WarningLog(), EvaluationCache(tmp_path))
    assert not result.by_fidelity[COLUMN] and len(result.by_fidelity[PLATE]) <= 6
    assert result.best.point[0] == pytest.approx(6.56, abs=0.1)


def test_of_designs_that_no_other_beats() -> None:
    def one(goal: float, hertz: float, mass: float) -> FoundDesign:
        figures = {"frequency_hz": hertz, "confinement_db": goal, "mac": 0.9, "mass_kg": mass}
        return FoundDesign(fidelity=PLATE, set={}, violations=[], goal_value=goal, objective=goal, **figures)

    listed = [one(10, 30e3, 0.1), one(12, 29e3, 0.1), one(9, 29e3, 0.1), one(9, 29e3, 0.05)]
    assert front(listed) == [listed[1], listed[0], listed[3]]


def test_a_judgement_is_kept_by_question(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    query: list[str] = []

    def solved(case, fidelity: str, near_hz: float | None, banded: bool) -> FidelityResult:
        query.append(f"{1e3 * case.design.pillar.height_m:g} {fidelity} {near_hz}")
        return FidelityResult(fidelity=fidelity, frequency_hz=3e4, confinement_db=12.0, extension_db=13.0, mac=0.9)

    monkeypatch.setattr(fidelity, "_solved", solved)
    cache, case = EvaluationCache(tmp_path), load_case(CASE)
    first = evaluate(case, COLUMN, None, cache)
    assert evaluate(case, COLUMN, None, EvaluationCache(tmp_path)) == first and len(query) == 1
    evaluate(case, PLATE, None, cache)
    evaluate(case, PLATE, 3e4, cache)
    evaluate(load_case(CASE, ["pillar.height_mm=6.31"]), COLUMN, None, cache)
    assert query == ["6.3 column None", "6.3 plate None", "6.3 plate 30000.0", "6.31 column None"]
    for path in tmp_path.iterdir():
        path.write_text("{torn")
    evaluate(case, COLUMN, None, cache)
    assert len(query) == 5


@pytest.mark.parametrize("fidelity", [COLUMN, PLATE])
def test_what_cannot_be_solved_is_told_and_passed_over(fidelity: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from solvers.errors import SolverError

    def refuse(*_: object) -> None:
        raise SolverError("too soft")

    monkeypatch.setattr("solvers.plates.assembled.Reductions.cell", refuse)
    monkeypatch.setattr(
        "pipeline.search.fidelity.kept_cell", lambda case: None
    )  # an explorer's, where a study made one
    result = evaluate(load_case(CASE), fidelity)
    assert result.why_not == "too soft" and result.frequency_hz is None


def test_strips_are_calibrated_on_the_files_own_column(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A column as a strip with feet of 0.8 would answer: the search finds the 0.8."""
    case = load_case(CASE)
    target = by_strip(case, 0.8)
    monkeypatch.setattr(
        optimiser, "evaluate", lambda case, fidelity, near_hz=None, cache=None: replace(target, fidelity=fidelity)
    )
    space = read_space(CASE, [], ["pillar.height_mm=6:6.5"])
    result = optimiser.search(space, Settings(evaluations=1), fidelity.WarningLog(), EvaluationCache(tmp_path))
    assert result.softness == pytest.approx(0.8)


@pytest.fixture(scope="module")
def searched(coarsest_cells: None, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict, dict, Path]:
    """A small plate searched by all fidelities, and once more from the cache alone."""
    folder = tmp_path_factory.mktemp("search")
    documents = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fidelity.EvaluationCache.__init__, "__defaults__", (folder / "shelf",))
        for name in ("first", "second"):
            arguments = [CASE, *VARY, *small(), "--quiet", "--evaluations", "2", "--mac", "0.5"]
            arguments += ["--csv", str(folder / f"{name}.csv"), "--plot", str(folder / f"{name}.pdf")]
            assert run(*arguments, "--out", str(folder / name), "--json", str(folder / f"{name}.json")) == 0
            documents.append(json.loads((folder / f"{name}.json").read_text()))
            patch.setattr(fidelity, "_solved", lambda *_: pytest.fail("solved again"))
    return documents[0], documents[1], folder


@pytest.mark.slow
def test_a_search_ends_with_the_best_of_what_it_solved(searched: tuple[dict, dict, Path]) -> None:
    document, _, folder = searched
    assert document["schema"] == 2 and document["best"]["fidelity"] == PLATE
    plates = [e for e in document["evaluations"] if e["fidelity"] == PLATE and not e["violations"]]
    assert document["best"]["confinement_db"] >= document["base"]["confinement_db"] - 0.1
    assert document["best"]["confinement_db"] == pytest.approx(max(e["confinement_db"] for e in plates), abs=0.2)
    assert {fidelity["name"]: fidelity["designs"] for fidelity in document["fidelities"]}[PLATE] == 2
    names = {path.name for path in (folder / "first").iterdir()}
    assert {"search.json", "search.csv", "search.svg", "search.png"} <= names
    assert (folder / "first.pdf").read_bytes().startswith(b"%PDF")
    assert (folder / "first.csv").read_bytes() == (folder / "first" / "search.csv").read_bytes()
    assert document["solid"] is None and document["options"]["vary"] == [["pillar.height_mm", 5.6, 6.6]]


@pytest.mark.slow
def test_a_search_repeats_from_what_it_kept(searched: tuple[dict, dict, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, _ = searched
    assert {k: v for k, v in first.items() if k != "seconds"} == {k: v for k, v in second.items() if k != "seconds"}


@pytest.mark.slow
def test_the_command_that_it_names_gives_the_number_that_it_claims(
    searched: tuple[dict, dict, Path], tmp_path: Path
) -> None:
    best = searched[0]["best"]
    sets = [part for text in searched[0]["repeat"] for part in ("--set", text)]
    assert main(["modes", CASE, *sets, "--symmetry=AS", "--quiet", "--json", str(tmp_path / "m.json")]) == 0
    modes = json.loads((tmp_path / "m.json").read_text())["modes"]
    target = max(modes, key=lambda mode: (mode["mac"] or 0.0) * (mode["zone_share"] or 0.0))
    assert target["confinement_db"] == pytest.approx(best["confinement_db"], abs=1e-6)
    assert target["frequency_hz"] == pytest.approx(best["frequency_hz"], rel=1e-9)


WITHIN = """
name = "larger"
material = "aluminium"
[plate]
thickness_mm = 2.0
length_mm = 36.0
width_mm = 30.0
[zone]
length_mm = 20.0
width_mm = 14.0
nodal_lines = 0
centre_mm = [1.5, -1.0]
[pillar]
side_mm = 2.0
height_mm = 5.4
[array]
pitch_mm = 4.0
rows = 1
surround = true
[solve]
accuracy = 0.1
"""


@pytest.mark.slow
def test_a_larger_plate_is_searched_as_its_modes_are_solved(
    coarsest_here: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Height and place at once, the target mode in a window: the best design's figures are those of `modes`."""
    monkeypatch.setattr(fidelity.EvaluationCache.__init__, "__defaults__", (tmp_path / "shelf",))
    (path := tmp_path / "within.toml").write_text(WITHIN)
    vary = ["--vary", "pillar.height_mm=5:5.8", "--vary", "zone.centre_mm=-2:2", "--target", "35kHz:75kHz"]
    limits = ["--mac", "0.1", "--max-half-wavelength", "30", "--evaluations", "2"]
    assert run(str(path), *vary, *limits, "--quiet", "--json", str(tmp_path / "found.json")) == 0
    found = json.loads((tmp_path / "found.json").read_text())
    sets = [part for text in found["repeat"] for part in ("--set", text)]
    assert main(["modes", str(path), *sets, "--quiet", "--json", str(tmp_path / "m.json")]) == 0
    target, best = json.loads((tmp_path / "m.json").read_text())["target"], found["best"]
    for own in ("frequency_hz", "confinement_db", "mac"):
        assert target[own] == pytest.approx(best[own], rel=1e-6)
    assert len(found["evaluations"]) == 2 and {each["fidelity"] for each in found["evaluations"]} == {PLATE}


@pytest.mark.slow
def test_a_plate_on_screws_is_searched_as_its_modes_are_solved(
    coarsest_here: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Strips and columns know no screws, plates do: the best one's figures are those of `modes`, far from the free plate's."""
    monkeypatch.setattr(fidelity.EvaluationCache.__init__, "__defaults__", (tmp_path / "shelf",))
    arguments = [SCREWED, "--vary", "pillar.height_mm=5.6:6.6", "--set", "solve.accuracy=0.05", "--evaluations", "2"]
    assert run(*arguments, "--mac", "0.3", "--quiet", "--json", str(tmp_path / "found.json")) == 0
    found = json.loads((tmp_path / "found.json").read_text())
    sets = [part for text in found["repeat"] for part in ("--set", text)]
    assert main(["modes", SCREWED, *sets, "--quiet", "--json", str(tmp_path / "m.json")]) == 0
    document, best = json.loads((tmp_path / "m.json").read_text()), found["best"]
    for own in ("frequency_hz", "confinement_db", "mac"):
        assert document["target"][own] == pytest.approx(best[own], rel=1e-6)
        assert abs(document["without_supports"][own] / best[own] - 1.0) > 0.005
    assert "--set support" not in " ".join(found["repeat"]) and len(found["evaluations"]) > 5


@pytest.mark.slow
def test_the_thesis_design_is_beaten_at_equal_rows_by_plate_and_solid(tmp_path: Path) -> None:
    """Height and pitch free, three rows as before: better held by the assembled plate, and by the whole solid mesh too."""
    arguments = [
        CASE,
        "--vary",
        "pillar.height_mm=5:8",
        "--vary",
        "array.pitch_mm=4:8",
        "--quiet",
        "--verify-with",
        "solid",
    ]
    assert run(*arguments, "--evaluations", "8", "--json", str(tmp_path / "found.json")) == 0
    document = json.loads((tmp_path / "found.json").read_text())
    assert document["gain_db"] > 6.0  # twice as still beside the zone
    assert document["best"]["frequency_hz"] > 25e3 and document["best"]["mac"] >= 0.8
    assert document["solid"]["best"]["confinement_db"] > document["solid"]["base"]["confinement_db"] + 6.0


def test_columns_are_for_spaces_whose_every_end_leaves_room_about_the_feet() -> None:
    """Curved hexahedra need some plate beyond the foot: a flush last row, tetrahedra asked for, a wide foot at one end."""
    shape = ["pillar.shape=round", "pillar.diameter_mm=2"]
    heights, widths = ["pillar.height_mm=6:7"], ["pillar.diameter_mm=1.5:3.95"]
    for fixed, varied, target in (
        (shape, heights, True),
        (shape, widths, False),
        ([*shape, "array.extension_mm=0"], heights, False),
        ([*shape, "solve.mesh=tet"], heights, False),
        ([], ["pillar.side_mm=1.5:3.95"], True),
    ):
        assert optimiser._have_columns(read_space(CASE, fixed, varied)) == target, (fixed, varied)


def test_a_window_and_a_lowest_frequency_exclude_each_other() -> None:
    case = load_case(CASE)
    vary = (Range.read("pillar.height_mm=5:7"),)
    with pytest.raises(InputError, match=r"--min-frequency: must not be given with --target"):
        Search(vary=vary, target_kHz=(33.0, 36.0), min_frequency_kHz=35.5).check(case)
    Search(vary=vary, target_kHz=(33.0, 36.0)).check(case)
