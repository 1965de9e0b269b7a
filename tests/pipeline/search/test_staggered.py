"""antinode search on staggered rows: chosen for the widest band; that band against the bands of their lattice."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.case.model import load_case
from pipeline.errors import InputError
from pipeline.logs import WarningLog
from pipeline.models.bands import row_cell
from pipeline.models.broadband import broadband
from pipeline.paths import STUDIES
from pipeline.planning.mesh_rules import target_window_hz
from pipeline.planning.model_choice import cell_model_choice
from pipeline.questions.search import SearchResult
from pipeline.search import fidelity, optimiser
from pipeline.search.fidelity import COLUMN, EvaluationCache, FidelityResult, evaluate
from pipeline.search.optimiser import Outcome, Settings
from tests.helpers.recording_log import RecordingLog
from tests.helpers.searching import read_space

CASE = str(STUDIES / "three-rows.toml")
SMALL = (
    "zone.length_mm=40", "zone.nodal_lines=3", "zone.width_mm=18", "array.extension_mm=5", "solve.accuracy=0.1",
    "patches.centres_mm=[[0.0,0.0]]", "patches.sensors=[]", "patches.size_mm=[4.0,3.0,0.3]", "array.pitch_mm=5",
)  # fmt: skip


def test_staggered_rows_are_chosen_where_they_stop_the_wider_band(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def banded(case, fidelity: str, near_hz=None, cache=None, banded: bool = False) -> FidelityResult:
        width = 5.0 if case.design.is_staggered else 3.0
        return FidelityResult(fidelity=fidelity, frequency_hz=30e3, confinement_db=12.0, mac=0.95, band_khz=width)

    monkeypatch.setattr(optimiser, "evaluate", banded)
    space = read_space(CASE, SMALL, ["array.stagger=false:true"])
    outcome = optimiser.search(space, Settings("widest"), RecordingLog(), EvaluationCache(tmp_path))
    assert outcome.best.set == {"array.stagger": "true"} and outcome.gain == 2.0 and outcome.by_fidelity[COLUMN]
    assert outcome.repeat[-1] == "array.stagger=true"


def test_a_shape_that_was_chosen_repeats_without_the_sizes_of_the_others() -> None:
    space = read_space(
        CASE, SMALL, ["pillar.side_mm=1.8:2.2", "pillar.diameter_mm=1.8:2.2", "pillar.shape=square:round"]
    )
    best = SimpleNamespace(point=(2.0, 2.1, 1), set=space.written((2.0, 2.1, 1)))
    outcome = SimpleNamespace(space=space, best=best, window=None)
    repeat = Outcome.repeat.fget(outcome)
    assert not [text for text in repeat if text.startswith("pillar.side_mm")]
    pillar = load_case(CASE, repeat).design.pillar
    assert pillar and pillar.shape == "round" and pillar.base_m == pytest.approx(2.1e-3)
    assert SearchResult.changes.fget(outcome) == {"pillar__diameter_mm": 2.1, "pillar__shape": "round"}


def test_shifted_rows_of_pillars_wider_than_half_a_pitch_are_refused_at_once() -> None:
    wide = (*SMALL, "array.stagger=true", "array.pitch_mm=3.5", "solve.mesh=hex")
    with pytest.raises(InputError, match=r"cells half a pitch wide need array\.pitch_x_mm above 4"):
        optimiser.check(read_space(CASE, wide, ["pillar.height_mm=6:7"]), Settings("widest"))


@pytest.mark.slow
def test_their_band_begins_where_the_lattice_has_no_more_flexural_waves(coarsest_here: None) -> None:
    """At the target wavenumber; three rows take 10 dB over the lower part of the lattice's gap, about the target mode."""
    case = load_case(CASE, [*SMALL, "array.stagger=true"])
    found = evaluate(case, COLUMN, banded=True)
    stopped = broadband(case, WarningLog(), target_window_hz(case.design), 101, 0.1, with_bars=False)["stopped"]
    (low, high) = next(ends for ends in stopped if ends[0] < found.frequency_hz < ends[1])
    assert found.band_khz == pytest.approx((high - low) / 1e3)
    reduction = cell_model_choice(case).reduction
    assert reduction
    row = row_cell(case.design, reduction)
    across = np.linspace(0.0, np.pi / case.design.pitch_y_m, 5)
    bands = np.array([row.frequencies(np.array([case.target_kx_per_m, ky]), 3) for ky in across])
    assert low == pytest.approx(bands[:, 0].max(), rel=0.02)
    assert (
        bands[:, 1].max() < high < bands[:, 2].min()
    )  # the second band is the pillars' own, which no row lets through


def test_what_cannot_be_told_a_band_of_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> dict:
        raise InputError("no rows that hexahedra follow")

    mode = FidelityResult(fidelity=COLUMN, frequency_hz=30e3, confinement_db=12.0, mac=0.95)
    monkeypatch.setattr(fidelity, "_by_column", lambda *_: mode)
    monkeypatch.setattr(fidelity, "broadband", refused)
    found = evaluate(load_case(CASE, SMALL), COLUMN, banded=True)
    assert found.band_khz is None and found.why_not == "no rows that hexahedra follow"


def test_pillars_wider_than_half_a_pitch_are_no_column_of_staggered_rows() -> None:
    found = evaluate(load_case(CASE, [*SMALL, "array.pitch_mm=3.5", "array.stagger=true"]), COLUMN)
    assert found.frequency_hz is None and "array.pitch_x_mm above" in str(found.why_not)
