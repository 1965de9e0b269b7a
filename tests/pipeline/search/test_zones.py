"""antinode search on a plate of several zones: goals, limits, steps by one row, and the answer against direct cross-talk."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pipeline.case.model import Case, case_from_dict
from pipeline.cli.main import main
from pipeline.errors import CheckFailed, InputError
from pipeline.logs import WarningLog
from pipeline.questions.search import SearchResult
from pipeline.search import fidelity, optimiser
from pipeline.search.fidelity import COLUMN, PLATE, STRIP, EvaluationCache, FidelityResult
from pipeline.search.optimiser import Settings
from pipeline.search.space import Space, space_of
from pipeline.search.terms import Limits, Range
from tests.helpers.asked import crosstalk_of
from tests.helpers.recording_log import RecordingLog
from tests.helpers.searching import read_space

ZONE = {"length_mm": 40.0, "width_mm": 18.0, "nodal_lines": 3}
RAW = {
    "material": "aluminium",
    "plate": {"thickness_mm": 2.0},
    "zone": [ZONE, {"shared_rows": 1}],
    "pillar": {"shape": "square", "side_mm": 2.0, "height_mm": 6.3},
    "array": {"pitch_mm": 4.0, "rows": 1},
    "solve": {"accuracy": 0.1},
    "damping": {"quality": 60.0},
    "patches": {"size_mm": [4.0, 3.0, 0.3]},
}
MIN_DB = 15.0
LIMITS = Limits(mac=0.5, isolation_db=MIN_DB)
FILE = Path(__file__).resolve().parents[3] / "examples" / "37-two-zones.toml"


def space_of_rows(*more: str) -> Space:
    return space_of(case_from_dict(RAW), [Range.read(text) for text in ("zone.shared_rows=1:4", *more)])


def faked(monkeypatch: pytest.MonkeyPatch, db_a_row: dict[str, float]) -> None:
    """So many dB a row between two zones, by each model its own."""

    def evaluated(case: Case, fidelity: str, near_hz: Any = None, cache: Any = None) -> FidelityResult:
        rows = case.design.shared_rows
        return FidelityResult(
            fidelity=fidelity,
            frequency_hz=30e3,
            confinement_db=15.0,
            mac=0.9,
            isolation_db=db_a_row[fidelity] * rows,
            gap_mm=1e3 * case.design.zone_gap_m,
        )

    monkeypatch.setattr(optimiser, "evaluate", evaluated)
    monkeypatch.setattr(optimiser, "by_strip", lambda case, softness: evaluated(case, STRIP))


def test_a_file_of_several_zones_is_its_own_first_design() -> None:
    space = read_space(str(FILE), [], ["zone.gap_mm=10:40", "zone.shared_rows=2:8", "zone.width_mm=15:25"])
    assert space.own_values() == (10.0, 3, 20.0)
    assert space.case(space.own_values() or ()).to_dict() == space.case().to_dict()
    assert space.case((30.0, 4, 18.0)).design.zone_gap_m == pytest.approx(30e-3)


def test_the_closest_zones_are_found_row_by_row(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Cheap models see 4 and 3 dB a row, plates 1.5: 14 rows for 20 dB, beyond what the column sends to the plates."""
    faked(monkeypatch, {STRIP: 4.0, COLUMN: 3.0, PLATE: 1.5})
    space = read_space(str(FILE), [], ["zone.shared_rows=2:20"])
    settings = Settings("closest", Limits(isolation_db=20.0), evaluations=12)
    outcome = optimiser.search(space, settings, WarningLog(), EvaluationCache(tmp_path))
    assert outcome.best.point == (14,) and outcome.best.gap_mm == pytest.approx(54.0)
    assert outcome.base.violations == ["isolation 4.5 dB, at least 20"]
    result = SearchResult.of_outcome(outcome)
    assert result.gain_mm == pytest.approx(10.0 - 54.0) and result.gain_db is result.gain_khz is None
    assert result.best.gap_mm == pytest.approx(54.0) and result.limits.isolation_db == 20.0
    assert "best 54.0 gap between zones (mm)" in result.pictures()[0].alt
    settings = replace(settings, limits=Limits(isolation_db=31.0))
    with pytest.raises(CheckFailed, match=r"zone.shared_rows=20: isolation 30.0 dB, at least 31"):
        optimiser.search(space, settings, WarningLog(), EvaluationCache(tmp_path))


def test_the_largest_isolation_is_that_of_most_rows(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    faked(monkeypatch, dict.fromkeys((STRIP, COLUMN, PLATE), 2.0))
    space = read_space(str(FILE), [], ["zone.shared_rows=2:7"])
    outcome = optimiser.search(space, Settings("isolation", evaluations=3), WarningLog(), EvaluationCache(tmp_path))
    assert outcome.best.point == (7,) and outcome.gain == pytest.approx(8.0)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--vary", "zone.count=2:3"), "--vary zone.count: cannot vary, one zone has no other"),
        (
            ("--goal", "extension"),
            "--goal extension: applies to a single zone, must be confinement, worst, isolation or closest",
        ),
        (("--goal", "widest"), "--goal widest: applies to a single zone"),
        (("--min-isolation", "-3"), "must be 0.001 or more"),
        (("--verify-with", "solid"), "--verify-with solid: zone.count = 2: must be plate"),
        (
            ("--set", "zone.count=1", "--set", "zone.shared_rows=0", "--goal", "closest"),
            "set zone.count to 2 or more",
        ),
        (
            ("--set", "zone.count=1", "--set", "zone.shared_rows=0", "--min-isolation", "20"),
            "--min-isolation: needs several zones",
        ),
        (("--set", "patches.circuit='open'"), "must be 'short'"),
        (("--vary", "array.heights_mm=5:6"), "applies to a single zone only"),
        (("--vary", "array.stagger=false:true"), "applies to a single zone only"),
    ],
)
def test_what_zones_refuse_is_one_line(
    arguments: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    vary = () if "zone.count" in arguments[-1] else ("--vary", "pillar.height_mm=6:6.5")
    with suppress(SystemExit):  # of what the parser refuses by itself, with exit code 2
        assert main(["search", str(FILE), "--quiet", *vary, *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


@pytest.fixture(scope="module")
def searched(coarsest_cells: None, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("zones")
    outcome = optimiser.search(
        space_of_rows(), Settings("closest", LIMITS, evaluations=4), RecordingLog(), EvaluationCache(folder)
    )
    return SearchResult.of_outcome(outcome).to_dict()


@pytest.mark.slow
def test_how_far_zones_must_lie_apart_is_what_cross_talk_tells_of_the_same_plates(searched: dict[str, Any]) -> None:
    """Every plate from one row to the answer computed directly: none before it keeps the limit, and it does."""
    best = searched["best"]
    direct = {}
    for rows in range(1, best["set"]["zone.shared_rows"] + 1):
        record = crosstalk_of(case_from_dict(RAW, overrides=[("zone.shared_rows", rows)]), RecordingLog(), points=2)
        assert record.worst_db is not None
        direct[rows] = -record.worst_db
    assert max(direct) > 1 and direct.pop(max(direct)) == pytest.approx(best["isolation_db"], abs=1e-6)
    assert best["isolation_db"] >= MIN_DB > max(direct.values())
    assert best["gap_mm"] == pytest.approx(4.0 * (best["set"]["zone.shared_rows"] - 1) + 2.0)


@pytest.mark.slow
def test_every_model_tells_the_same_of_zones(searched: dict[str, Any]) -> None:
    listed = {(each["fidelity"], each["set"]["zone.shared_rows"]): each for each in searched["evaluations"]}
    assert {name for name, _ in listed} == {STRIP, COLUMN, PLATE}
    for each in listed.values():
        assert each["why_not"] is None and each["extension_db"] is None
        assert each["isolation_db"] > 0.0 and each["gap_mm"] > 0.0 and 0.0 < each["mac"] <= 1.0


@pytest.mark.slow
def test_a_level_is_kept_by_its_question(coarsest_here: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case, cache = case_from_dict(RAW), EvaluationCache(tmp_path)
    first = fidelity.evaluate(case, COLUMN, None, cache)
    monkeypatch.setattr(fidelity, "_solved", lambda *_: pytest.fail("solved again"))
    assert fidelity.evaluate(case, COLUMN, None, cache) == first and first.isolation_db is not None
    assert first.gap_mm == pytest.approx(2.0) and len(list(tmp_path.iterdir())) == 1


def test_one_zone_has_no_cross_talk_to_ask_for() -> None:
    one = {**RAW, "zone": ZONE}
    space = space_of(case_from_dict(one), [Range("pillar.height_mm", 5, 7)])
    with pytest.raises(InputError, match="--goal isolation: needs several zones"):
        optimiser.search(space, Settings("isolation"), RecordingLog())
