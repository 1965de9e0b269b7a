"""Rows and patches together on a small plate: each method against the response, the best voltages, and what is refused."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models import hybrid
from pipeline.models.forced import forced_plate
from pipeline.planning.plan import response_step
from pipeline.questions.hybrid import Hybrid, HybridResult
from pipeline.questions.question import ask
from tests.helpers.coarse_cells import mesh_coarsest
from tests.helpers.recording_log import RecordingLog
from tests.helpers.scenes import STEEL_PILLARS

QUIET = TerminalLog(quiet=True)
PATCHES = {
    "size_mm": [3.0, 2.0, 0.3],
    "face": "touch",
    "centres_mm": [[-5.0, 0.0], [5.0, 0.0], [0.0, -11.0], [0.0, 11.0]],
}


def case_of(**more: Any) -> Case:
    case = {**STEEL_PILLARS, "patches": PATCHES, "solve": {"accuracy": 0.1, "band_kHz": [30.0, 60.0]}}
    case["array"] = {**case["array"], "extension_mm": 8.0}
    return case_from_dict(case, overrides=[(key.replace("__", "."), value) for key, value in more.items()])


@pytest.fixture(scope="module")
def coarse() -> Iterator[pytest.MonkeyPatch]:
    with pytest.MonkeyPatch.context() as patch:
        mesh_coarsest(patch)
        yield patch


@pytest.fixture(scope="module")
def log() -> RecordingLog:
    return RecordingLog()


@pytest.fixture(scope="module")
def solved(coarse: pytest.MonkeyPatch) -> list[hybrid.Plates]:
    """The plates of every hybrid, as they are solved."""
    known, plates = [], hybrid._plates
    coarse.setattr(hybrid, "_plates", lambda *about: known.append(plates(*about)) or known[-1])
    return known


@pytest.fixture(scope="module")
def record(coarse: pytest.MonkeyPatch, log: RecordingLog, solved: list[hybrid.Plates]) -> HybridResult:
    return ask(case_of(), Hybrid(points=4, alpha=0.0), log)


@pytest.mark.slow
def test_no_plate_holds_matrices_or_factors_while_others_are_solved(
    record: HybridResult, solved: list[hybrid.Plates]
) -> None:
    plates = solved[0]
    for plate in (plates.rows, plates.bare, *plates.detuned):
        assert not any({"pencil", "factorise"} & set(vars(group)) for group in plate.forced.plate.everything)
        assert all(shared.near is None for shared in plate.forced._kept.values())


@pytest.mark.slow
def test_four_plates_are_foreseen_at_once_and_named_as_they_come(record: HybridResult, log: RecordingLog) -> None:
    whole, one = Hybrid(points=4).plan(case_of()).steps[0].demand, response_step(case_of(), None, 4).demand
    assert whole and one and whole.cost.operations == pytest.approx(4.0 * one.cost.operations)
    assert [fact for fact in log.facts if fact.startswith("estimate")] == [whole.text()]
    assert [fact for fact in log.facts if fact.startswith("plate ")] == [
        "plate 2 of 4: without rows", "plate 3 of 4: with pillars detuned by -2%", "plate 4 of 4: with pillars detuned by +2%"
    ]  # fmt: skip


@pytest.mark.slow
def test_each_way_is_what_the_response_says(record: HybridResult, coarse: pytest.MonkeyPatch) -> None:
    """Rows: the patches inside alone, others at rest, as a case has it whose others only listen but for their open circuit."""
    forced = forced_plate(case_of(), QUIET)
    tones = np.array(record.frequency_hz)
    curve = forced.driven_by(forced.signs * np.array([1.0, 1.0, 0.0, 0.0])).curve(tones)
    assert curve.passive_rms_m_per_v is not None
    level = 20.0 * np.log10(curve.zone_rms_m_per_v / curve.passive_rms_m_per_v)
    rows = record.method("rows")
    assert rows.confinement_db == pytest.approx(level, abs=1e-9)
    assert rows.volts_per_um == pytest.approx(1e-6 / curve.zone_rms_m_per_v, rel=1e-9)
    off = [forced.driven_by(forced.signs * np.array([1.0, 1.0, 0.0, 0.0])).curve(tones / f) for f in (0.98, 1.02)]
    worst = np.min([20.0 * np.log10(c.zone_rms_m_per_v / c.passive_rms_m_per_v) for c in off], axis=0)  # type: ignore[operator]
    assert rows.off_db == pytest.approx(worst, abs=1e-9)
    assert (record.inside, record.behind) == (2, 2)


@pytest.mark.slow
def test_shaped_patches_confine_at_least_as_well_and_without_rows_there_are_none_to_detune(
    record: HybridResult,
) -> None:
    for plain, shaped in (("neither", "patches"), ("rows", "both")):
        more = np.array(record.method(shaped).confinement_db) - np.array(record.method(plain).confinement_db)
        assert more.min() >= -1e-9 and more.max() > 1.0
    assert [method.rows_off_db is None for method in record.methods] == [True, False, True, False]


@pytest.mark.slow
def test_pillars_off_by_two_percent_are_stiffer_or_softer_pillars(
    record: HybridResult, coarse: pytest.MonkeyPatch
) -> None:
    """A plate whose pillars have (1 +- 0.02)^2 of Young's modulus, driven with the voltages of the plate as computed."""
    forced, levels = forced_plate(case_of(), QUIET), []
    for factor in (0.98, 1.02):
        steel = {"young_GPa": 210.0 * factor**2, "density_kg_m3": 7850.0, "poisson": 0.3}
        other = forced_plate(case_of(pillar__material=steel), QUIET)
        curve = other.driven_by(forced.signs * np.array([1.0, 1.0, 0.0, 0.0])).curve(np.array(record.frequency_hz))
        assert curve.passive_rms_m_per_v is not None
        levels.append(20.0 * np.log10(curve.zone_rms_m_per_v / curve.passive_rms_m_per_v))
    assert record.method("rows").rows_off_db == pytest.approx(np.min(levels, axis=0), abs=1e-6)


def test_rows_and_pictures_come_from_the_record_alone(record: HybridResult, tmp_path: Path) -> None:
    assert HybridResult.from_document(record.to_dict()) == record
    rows = record.to_rows()
    assert len(rows) == len(record.frequency_hz) and rows[0]["both_db"] == record.method("both").confinement_db[0]
    assert "bare_rows_off_db" not in rows[0] and "rows_rows_off_db" in rows[0]
    (picture,) = record.pictures()
    assert len(picture.figure.axes) == 3 and "both" in picture.alt
    record.as_figure().savefig(tmp_path / "hybrid.svg")
    assert (tmp_path / "hybrid.svg").stat().st_size > 1000


def test_patches_behind_the_rows_stand_beside_every_antinode() -> None:
    case = case_of(patches={"size_mm": [2.0, 2.0, 0.3], "behind_mm": 3.0, "sensors": [1]})
    assert case.patches is not None
    x, y = np.array(case.patches.centres_m).T
    each = len(x) // 3
    end = case.design.half_span_m - case.design.extension_m
    assert np.array_equal(x[:each], x[each : 2 * each]) and not y[:each].any()
    assert y[each:] == pytest.approx(np.repeat([-1.0, 1.0], each) * (end + 3e-3))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"array__rows": 0}, "array.rows = 0: must be 1 or more"),
        ({"patches__circuit": "open"}, "must be 'short'"),
        ({"patches__centres_mm": [[0.0, -11.0], [0.0, 11.0]]}, "no driving patch lies inside the zone"),
        ({"patches__sensors": [1, 2, 3]}, "only one drives"),
        ({"patches__behind_mm": 3.0}, "cannot be combined with centres_mm"),
        ({"patches": {"size_mm": [2.0, 2.0, 0.3], "behind_mm": 30.0}}, "extends beyond the plate"),
    ],
)
def test_what_cannot_be_is_one_line(change: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said.replace(".", r"\.")) as refused:
        case = case_of(**change)
        ask(case, Hybrid(), QUIET)
    assert all("patches" in line or "array" in line for line in refused.value.lines)
