"""The solver that an exported page holds, run by node: its numbers, its refusals and its texts are Python's."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.explore import offline
from pipeline.explore.answer import LIMITS, Explorer, read_design
from pipeline.models.live_column import boundary_error, end_layer
from pipeline.models.parametric import sizes_of
from pipeline.paths import STUDIES
from solvers.parametric.affine import CLEARANCE_M, DesignBox
from solvers.parametric.bands import FLAT
from tests.helpers.exploring import OFFLINE, small_explorer

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="needs node, which runs the page's own model")
# Relative, and in dB. Page and Python solve the same stored matrices in double precision: plates agree to 1e-9, and bands,
# whose bases the page rounds to single precision, to 1e-7. A band's bar is the relative distance of two frequencies: it is
# held to what they are held to.
SAME = 1e-6
SEED, DRAWN, PARTS, QUICK = 52, 200, 8, 20
FEW = 2  # rows of the quick draw: a plate of eight takes the page four times as long
ROWS_DB = 5e-5 + SAME  # an answer rounds the decay per row
ROUNDED_HZ = 0.05 + 1e-6  # and its frequencies to tenths of a hertz
NUMBERS = "frequency_hz", "frequency_error", "near_hz", "mac", "zone_share", "half_width_mm", "half_span_mm"
LEVELS = "confinement_db", "confinement_error_db", "extension_db", "extension_error_db"
ASK = """
(async () => {
  const out = [], one = (path, body) => { try { return answered(path, body); } catch (fault) { return fault.message; } };
  for (const { document, numbers, asked } of JSON.parse(require("fs").readFileSync(0, "utf8"))) {
    model = placed(document, await unpacked(numbers));
    out.push(asked.map(([path, body]) => one(path, body)));
  }
  console.log(JSON.stringify(out));
})();
"""
Design = dict[str, float]
Asked = list[tuple[str, dict[str, Any]]]


def answers(questions: Sequence[tuple[Explorer, Asked]], script: Path) -> list[list[Any]]:
    """The worker's own text answers all questions in one process, without a browser; a refusal by its text."""
    assert NODE
    given = []
    for explorer, asked in questions:
        numbers = offline._Numbers()
        document = offline.model_document(explorer, numbers)
        given.append({"document": document, "numbers": numbers.text(), "asked": asked})
    script.write_text(offline.worker() + ASK, encoding="utf-8")
    words = [NODE, str(script)]
    done = subprocess.run(words, input=json.dumps(given), capture_output=True, text=True, check=True)
    answered: list[list[Any]] = json.loads(done.stdout)
    return answered


@pytest.fixture(scope="module")
def explorer(tmp_path_factory: pytest.TempPathFactory) -> Explorer:
    """Round pillars, whose square blocks the edges of the zone and of the rows cut."""
    return small_explorer(tmp_path_factory.mktemp("round"), "pillar.shape=round", "pillar.diameter_mm=2")


@pytest.fixture(scope="module")
def whole_boxes(tmp_path_factory: pytest.TempPathFactory) -> list[Explorer]:
    """Staggered rows, aluminium throughout, and aluminium pillars on PMMA along an odd shape: over the whole box of the
    sliders.
    """
    wide = replace(OFFLINE, box=DesignBox())
    pmma = STUDIES / "data" / "live-pmma.toml"
    staggered = ("array.stagger=true", "array.pitch_x_mm=6", "array.pitch_y_mm=4")
    return [
        small_explorer(tmp_path_factory.mktemp("staggered"), *staggered, offline=wide),
        small_explorer(tmp_path_factory.mktemp("aluminium"), offline=wide),
        small_explorer(tmp_path_factory.mktemp("pmma"), path=pmma, offline=wide),
    ]


def drawn(explorer: Explorer, count: int, most_rows: int) -> list[Design]:
    """Designs anywhere between the ends of the sliders, extension among them, and of so many rows at most."""
    limits, rng, designs = explorer.scene.limits, np.random.default_rng(SEED), list[Design]()
    while len(designs) < count:
        given = {name: float(rng.uniform(limit.low, limit.high)) for name, limit in limits.items()}
        given["rows"] = float(rng.integers(0, most_rows + 1))
        with suppress(InputError):
            if not explorer.model.cell.box.faults(sizes_of(explorer.scene.at(given).design)):
                designs.append(given)
    return designs


def python_answer(explorer: Explorer, given: Design) -> dict[str, Any] | str:
    """Python's answer, or why it refuses."""
    try:
        return explorer.answer(read_design(given, explorer.scene.limits))
    except InputError as fault:
        return "; ".join(fault.lines)


def require_same(explorer: Explorer, given: Design, theirs: dict[str, Any]) -> None:
    """Warnings, bands, bars, decay and plate of a design; of a plate that the page has no answer for, why."""
    ours = explorer.answer(given)
    require_same_bands(explorer, given, ours["bands"], theirs["bands"])
    assert theirs["rows"]["frequency_hz"] == pytest.approx(ours["rows"]["frequency_hz"], abs=ROUNDED_HZ)
    for one, other in zip(ours["rows"]["db_per_row"], theirs["rows"]["db_per_row"], strict=True):
        assert other == (one if one is None else pytest.approx(one, rel=SAME, abs=ROWS_DB))
    plate, other = ours["plate"], theirs["plate"]
    if is_cut(explorer, given):
        assert "cuts through the last rows' cells" in other["why_not"] or "zone's middle" in other["why_not"]
        return
    assert theirs["warnings"] == ours["warnings"]
    if "why_not" in plate:
        assert other["why_not"] == plate["why_not"]
        return
    assert [other[name] for name in ("status", "rivals")] == [plate[name] for name in ("status", "rivals")]
    for name in NUMBERS:
        assert other[name] == (plate[name] if plate[name] is None else pytest.approx(plate[name], rel=SAME)), name
    for name in LEVELS:
        assert other[name] == (
            plate[name] if plate[name] is None else pytest.approx(plate[name], rel=SAME, abs=SAME)
        ), name
    for mine, mode in zip(plate["others"], other["others"], strict=True):
        assert mode == {
            name: value if value is None else pytest.approx(value, rel=SAME) for name, value in mine.items()
        }
    assert other["profile"]["level"] == pytest.approx(plate["profile"]["level"], abs=2e-5)


def is_cut(explorer: Explorer, given: Design) -> bool:
    """Whether the plate's edge cuts the last rows' cells, which the page has no panels for."""
    box = explorer.model.cell.box
    room = (box.panel[1] * given["pitch"] - box.foot.footprint * given["side"]) / 2.0
    return bool(given["rows"]) and given["extension"] < room - 1e-6


def require_same_bands(explorer: Explorer, given: Design, ours: dict[str, Any], theirs: dict[str, Any]) -> None:
    """Every frequency that no rounding blurs, as the model has it: an answer is rounded to tenths of a hertz."""
    solved = explorer.model.bands(sizes_of(explorer.scene.at(given).design))
    hz, exact = np.array(theirs["frequency_hz"]), solved.frequency_hz
    moving = exact > FLAT * exact[:, -1:]
    assert hz[moving] == pytest.approx(exact[moving], rel=SAME)
    assert hz[~moving] == pytest.approx(exact[~moving], abs=FLAT * exact.max())
    for name in ("error", "mesh_error"):
        assert theirs[name] == pytest.approx(ours[name], abs=SAME), name
    assert theirs["gaps"] == [pytest.approx(gap, rel=SAME, abs=SAME) for gap in ours["gaps"]]
    assert theirs["labels"] == ours["labels"]
    apart = np.diff(exact, axis=1, prepend=-np.inf, append=np.inf) / np.maximum(exact[:, -1:], 1.0)
    gap = np.minimum(apart[:, 1:], apart[:, :-1])
    alone = moving & (gap > 10.0 * SAME)  # closer waves may be any mixture of both
    assert (np.array(theirs["sector"]) == solved.sector)[alone].all() and alone.mean() > 0.5
    for name in ("pillar", "flexural"):  # a matrix off by SAME turns a wave by SAME over its distance from the next
        shares, own = np.array(theirs[name], dtype=float), getattr(solved, name)
        assert (np.isnan(shares) == ~moving).all()
        assert (np.abs(shares - own)[alone] <= 4.0 * SAME / gap[alone]).all(), name


def require_same_answers(
    whole_boxes: list[Explorer], count: int, most_rows: int, script: Path, part: slice = slice(None)
) -> None:
    questions = [(one, drawn(one, count // len(whole_boxes), most_rows)[part]) for one in whole_boxes]
    told = answers([(one, [("answer", given) for given in designs]) for one, designs in questions], script)
    for (one, designs), theirs in zip(questions, told, strict=True):
        for given, other in zip(designs, theirs, strict=True):
            require_same(one, given, other)


@pytest.mark.slow
@needs_node
def test_drawn_designs_have_pythons_numbers(whole_boxes: list[Explorer], tmp_path: Path) -> None:
    """Every frequency, level and bar, to a millionth: both solve the same stored matrices in double precision."""
    require_same_answers(whole_boxes, QUICK, FEW, tmp_path / "worker.js")


@needs_node
@pytest.mark.slow
@pytest.mark.parametrize("part", range(PARTS))
def test_many_drawn_designs_have_pythons_numbers(whole_boxes: list[Explorer], part: int, tmp_path: Path) -> None:
    require_same_answers(whole_boxes, DRAWN, int(LIMITS["rows"].high), tmp_path / "worker.js", slice(part, None, PARTS))


@pytest.mark.slow
@needs_node
def test_a_thin_plate_has_sliders_about_it_and_the_bands_of_one_a_thousand_times_larger(tmp_path: Path) -> None:
    """Lengths times a thousand, frequencies by a thousand: two boxes of other proportions, each within its bases' error."""
    wide, thin = replace(OFFLINE, box=DesignBox()), ("plate.thickness_mm=0.7", "pillar.height_mm=7.1")
    own = {"plate.thickness_mm": 0.7, "pillar.height_mm": 7.1, "pillar.side_mm": 2.0, "array.pitch_mm": 4.0}
    zone = {"zone.length_mm": 20.0, "zone.width_mm": 16.0, "array.extension_mm": 10.0}
    micro = tuple(f"{key}={value / 1e3:g}" for key, value in (own | zone).items())
    one = small_explorer(tmp_path / "thin", *thin, offline=wide)
    other = small_explorer(tmp_path / "micro", *micro, offline=wide)
    limit = one.scene.limits["thickness"]
    assert (limit.low, limit.high, limit.step) == (0.4, 1.2, 0.02)
    assert other.scene.limits["height"].high == pytest.approx(0.009) and one.scene.limits["height"].high == 9.0
    large, small = (each.answer(each.scene.own())["bands"] for each in (one, other))
    bars = np.add(large["error"], small["error"])
    parted = np.abs(np.array(small["frequency_hz"]) / 1e3 - large["frequency_hz"])
    assert (parted <= bars * np.array(large["frequency_hz"]) + 0.1).all() and bars.min() < 0.05  # Hz: they are rounded
    designs = drawn(one, 6, FEW)
    (told,) = answers([(one, [("answer", given) for given in designs])], tmp_path / "worker.js")
    for given, theirs in zip(designs, told, strict=True):
        require_same(one, given, theirs)


@pytest.mark.slow
@needs_node
def test_the_ends_of_every_slider_have_pythons_answer(whole_boxes: list[Explorer], tmp_path: Path) -> None:
    """Beyond them, and between them what does not fit, is refused in Python's words."""
    one, own = whole_boxes[1], whole_boxes[1].scene.own()
    limits = one.scene.limits.items()
    ends = [own | {name: end} for name, limit in limits for end in (limit.low, limit.high)]
    beyond = [own | {name: limit.high + 1.0} for name, limit in limits]
    beyond += [own | {"side": 2.6, "pitch": 3.0}, own | {"rows": 1.5}]
    (told,) = answers([(one, [("answer", given) for given in (*ends, *beyond)])], tmp_path / "worker.js")
    for given, theirs in zip(ends, told, strict=False):
        if given["pitch"] - given["side"] < 1e3 * CLEARANCE_M:
            assert theirs == python_answer(one, given)
        else:
            require_same(one, given, theirs)
    assert told[len(ends) :] == [python_answer(one, given) for given in beyond]
    assert all(isinstance(text, str) for text in told[len(ends) :])


@pytest.mark.slow
@needs_node
def test_designs_of_the_cloud_have_pythons_numbers(whole_boxes: list[Explorer], tmp_path: Path) -> None:
    first = 400
    told = answers([(one, [("cloud", {"first": first})]) for one in whole_boxes], tmp_path / "worker.js")
    for one, (designs,) in zip(whole_boxes, told, strict=True):
        ours = one.cloud(first, len(designs))
        assert [each["design"] for each in designs] == [each["design"] for each in ours]
        for name in ("mass_g", "frequency_hz", "confinement_db"):
            for each, own in zip(designs, ours, strict=True):
                assert each[name] == (own[name] if own[name] is None else pytest.approx(own[name], rel=SAME)), name


@pytest.mark.slow
@needs_node
def test_a_page_of_round_pillars_has_pythons_numbers(explorer: Explorer, tmp_path: Path) -> None:
    """Designs with and without a mode of the passive plate near the target mode, without rows, and cut by the plate's edge."""
    own = explorer.scene.own()
    designs = [own | {"extension": float(extension)} for extension in (0, 12)] + [own | {"rows": 0.0}]
    (told,) = answers([(explorer, [("answer", given) for given in designs])], tmp_path / "worker.js")
    for given, theirs in zip(designs, told, strict=True):
        require_same(explorer, given, theirs)
    assert told[0]["plate"]["why_not"].startswith("an extension below 1.00 mm cuts through the last rows' cells")
    assert {theirs["plate"]["near_hz"] is None for theirs in told[1:]} == {True, False}


def require_areas(plate: dict[str, Any], explorer: Explorer, given: Design, rel: float) -> None:
    """10^(dB/10) (1 - s) / s = A_passive / A_zone of every motion, s the zone's share of the square."""
    design = explorer.scene.at(given).design
    share, active = plate["zone_share"], design.width_m / 2.0
    ratio = 10.0 ** (plate["confinement_db"] / 10.0) * (1.0 - share) / share
    assert ratio == pytest.approx((design.half_span_m - active) / active, rel=rel)


@pytest.mark.slow
@pytest.mark.parametrize("change", [{}, {"side": 2.15, "extension": 9.0}, {"pitch": 4.35}])
def test_levels_are_of_the_zone_itself(explorer: Explorer, change: Design) -> None:
    """Whole columns of cells, and plates that reach beyond them or cut them."""
    given = explorer.scene.own() | change
    require_areas(explorer.plate(explorer.scene.at(given)), explorer, given, 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("extension", [0.0, 0.5])
def test_round_feet_at_the_plates_edge_have_an_answer(explorer: Explorer, extension: float) -> None:
    """An edge that touches the feet leaves elements no room: it is moved, and the bar holds what that may change."""
    given = explorer.scene.own() | {"extension": extension}
    design = explorer.scene.at(given).design
    plate, wider = (explorer.plate(explorer.scene.at(given | {"extension": e})) for e in (extension, extension + 0.5))
    moved_mm = plate["half_span_mm"] - 1e3 * design.half_span_m
    assert 0.0 <= moved_mm < 0.03 and (moved_mm > 0.0) == (extension == 0.0)
    assert (plate["extension_db"] is None) == (plate["extension_error_db"] is None) == (extension == 0.0)
    change = moved_mm / 0.5 * abs(plate["frequency_hz"] / wider["frequency_hz"] - 1.0)
    assert plate["frequency_error"] >= boundary_error(design) + end_layer(design) / 2.0 + change
