"""Coarse modes: they choose mesh and numbers of modes, and change nothing that is told."""

from dataclasses import replace

import pytest

from pipeline.case.model import load_case
from pipeline.logs import TerminalLog
from pipeline.models import modes
from pipeline.models.parts import OFF, CoarseModes, coarse_modes
from pipeline.paths import ROOT
from pipeline.planning.model_choice import ModelChoice, Request, model_choice_of
from tests.helpers.recording_log import RecordingLog

CASE = load_case(ROOT / "examples" / "small.toml", ["solve.accuracy=0.02"])
ZONE, PILLAR = Request("zone", near_hz=0.0, count=24, search=False), Request("pillar", near_hz=0.0, count=5)


def choice(query: Request) -> ModelChoice:
    """As the command chooses it, before it knows how high the modes lie."""
    return model_choice_of(CASE, query.part, 40e3)


def modes_of(query: Request, log: RecordingLog | None = None) -> list[tuple[str | None, float]]:
    """Symmetry class and frequency on the finest mesh of every mode that is told, in ascending order."""
    result = modes.solve_modes(CASE, query, log or TerminalLog(True))
    assert result.count.expected == result.count.found == len(result.rows)
    return [(row.symmetry, row.computed_hz or 0.0) for row in result.rows]


@pytest.mark.slow
def test_the_mesh_is_made_for_the_highest_mode_at_once_and_each_class_is_solved_once() -> None:
    log, coarse = RecordingLog(), coarse_modes(CASE, ZONE, choice(ZONE))
    highest = modes_of(ZONE, log)[-1][1]
    assert coarse and 0.999 * highest <= coarse.highest_hz <= 1.02 * (1.0 + OFF) * highest
    assert sum(coarse.counts.values()) < 2 * (ZONE.count or 0)
    assert any("from the calibration" in fact for fact in log.facts)
    assert len([fact for fact in log.facts if fact.startswith("class ")]) == 4


@pytest.mark.slow
def test_modes_asked_class_by_class_are_those_of_asking_every_class_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    few = modes_of(PILLAR)
    monkeypatch.setattr(modes, "coarse_modes", lambda *_: None)
    every = modes_of(PILLAR)
    assert [symmetry for symmetry, _ in few] == [symmetry for symmetry, _ in every]
    assert [tone for _, tone in few] == pytest.approx([tone for _, tone in every], rel=1e-7)


@pytest.mark.slow
def test_a_class_asked_for_too_few_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    truth, log, coarse = modes_of(PILLAR), RecordingLog(), coarse_modes(CASE, PILLAR, choice(PILLAR))
    assert coarse
    few = CoarseModes(coarse.highest_hz, dict.fromkeys(coarse.counts, 1))
    monkeypatch.setattr(modes, "coarse_modes", lambda *_: few)
    again = modes_of(PILLAR, log)
    assert [tone for _, tone in again] == pytest.approx([tone for _, tone in truth], rel=1e-7)
    assert any("1 mode" in fact for fact in log.facts) and any("5 modes" in fact for fact in log.facts)


def test_about_a_frequency_every_class_is_asked_for_all() -> None:
    coarse = coarse_modes(CASE, replace(PILLAR, near_hz=100e3), choice(PILLAR))
    assert coarse and set(coarse.counts.values()) == {5}


@pytest.mark.parametrize(
    "query", [Request("zone", (20e3, 30e3)), Request("plate", near_hz=30e3, count=2)], ids=["band", "plate"]
)
def test_nothing_is_foreseen_for_a_band_or_a_reduced_plate(query: Request) -> None:
    assert coarse_modes(CASE, query, choice(query)) is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("band_hz", "within"),
    [((10e3, 39.12e3), 2), ((10e3, 39.1e3), 0), ((39.12e3, 60e3), 0), ((39.1e3, 39.12e3), 2), ((10e3, 150e3), 3)],
)
def test_a_band_of_a_body_meshed_whole_ends_where_the_corrected_frequencies_do(
    band_hz: tuple[float, float], within: int
) -> None:
    """The pillar's first pair lies at 39.11 kHz, and on the mesh above 39.12 kHz."""
    case = load_case("examples/small.toml", ["solve.accuracy=0.1"])
    solved = modes.solve_modes(case, Request("pillar", band_hz=band_hz), RecordingLog())
    assert len(solved.rows) == solved.count.expected == solved.count.found == within
    assert solved.count.high_hz == band_hz[1]
    assert within or solved.nearest_hz == pytest.approx(39.11e3, rel=1e-3)
