"""Plates of a batch whose pillars are all off by the same: the explorer's own answers, drawn and told as tolerances are."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pipeline.case.model import load_case
from pipeline.cli.main import main
from pipeline.errors import InputError
from pipeline.explore import answer
from pipeline.explore.answer import Explorer
from pipeline.questions.question import ask
from pipeline.questions.tolerance import AlikeTolerance, ToleranceResult
from solvers.variation.samples import Deviations
from tests.helpers.exploring import SMALL, small_explorer
from tests.helpers.recording_log import RecordingLog

SCATTER = ("tolerance.height_mm=0.04", "tolerance.side_mm=0.02", "tolerance.samples=3")


@pytest.fixture(scope="module")
def explorer(tmp_path_factory: pytest.TempPathFactory) -> Explorer:
    return small_explorer(tmp_path_factory.mktemp("cells"))


def solved(explorer: Explorer, *settings: str, log: RecordingLog | None = None) -> ToleranceResult:
    """The record of examples/small.toml with --set words, by the small explorer's bases."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(answer, "cell_model", lambda case, log: explorer.model)
        return ask(load_case(SMALL, list(settings)), AlikeTolerance(), log or RecordingLog())


@pytest.fixture(scope="module")
def scattered(explorer: Explorer) -> ToleranceResult:
    return solved(explorer, *SCATTER)


@pytest.mark.slow
def test_a_sample_is_the_design_that_the_page_would_show(explorer: Explorer, scattered: ToleranceResult) -> None:
    record = scattered
    changes = Deviations(0.04e-3, 0.02e-3, 0.0).draw(1, 3, 1)[:, 0, :2]
    own = explorer.scene.own()
    nominal = explorer.answer(own)["plate"]
    assert (record.nominal.peak_hz, record.frequency_error) == (nominal["frequency_hz"], nominal["frequency_error"])
    for sample, (height, side) in zip(record.samples, 1e3 * changes, strict=True):
        given = own | {"height": own["height"] + height, "side": own["side"] + side}
        plate = explorer.plate(explorer.scene.at(given))
        assert sample.peak_hz == pytest.approx(plate["frequency_hz"], rel=1e-9)
        assert sample.confinement_db == pytest.approx(plate["confinement_db"], rel=1e-6)
    peaks = np.array([one.peak_hz for one in record.samples])
    assert record.peak_hz is not None and record.peak_shift_hz is not None
    assert record.peak_hz.deviation == pytest.approx(np.std(peaks, ddof=1))
    assert record.peak_shift_hz.mean == pytest.approx(np.mean(peaks) - record.nominal.peak_hz)
    assert len(set(peaks)) == 3 and record.lost == 0


@pytest.mark.slow
def test_higher_pillars_alone_lower_the_mode_they_hold(explorer: Explorer) -> None:
    record = solved(explorer, "tolerance.height_mm=0.05", "tolerance.samples=4")
    heights = Deviations(0.05e-3, 0.0, 0.0).draw(1, 4, 1)[:, 0, 0]
    assert np.corrcoef(heights, [one.peak_hz for one in record.samples])[0, 1] < -0.9


@pytest.mark.parametrize(
    ("shape", "widths"),
    [("shape='round'\ndiameter_mm=2.0", (2.04, 2.04)), ("shape='tapered'\nbase_mm=2.0\ntip_mm=1.5", (2.04, 1.53))],
)
def test_pillars_of_other_shapes_grow_with_all_their_widths(
    shape: str, widths: tuple[float, float], tmp_path: Path
) -> None:
    path = tmp_path / "shaped.toml"
    path.write_text(SMALL.read_text().replace('shape = "square"\nside_mm = 2.0', shape))
    case = answer.printed(load_case(path, list(SCATTER)), np.array([0.1e-3, 0.04e-3]))
    pillar = case.design.pillar
    assert pillar is not None
    assert (1e3 * pillar.base_m, 1e3 * pillar.tip_m) == pytest.approx(widths)
    assert 1e3 * pillar.height_m == pytest.approx(6.4)


@pytest.mark.slow
def test_where_pillars_stand_changes_nothing_and_is_said_to_be_left_out(
    explorer: Explorer, scattered: ToleranceResult
) -> None:
    log = RecordingLog()
    record = solved(explorer, *SCATTER, "tolerance.position_mm=0.1", log=log)
    assert record.samples == scattered.samples
    assert any("where the pillars stand" in text for text in log.omitted)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ((), "[tolerance]"),
        (("tolerance.position_mm=0.1",), "tolerance.side_mm must be above 0"),
        (("tolerance.height_mm=0.05", "tolerance.young_percent=2"), "tolerance.young_percent must be 0"),
        (("tolerance.height_mm=0.3",), "3 standard deviations reach height"),
        (("tolerance.side_mm=0.1",), "3 standard deviations reach side"),
    ],
)
def test_what_cannot_be_drawn_is_one_line(explorer: Explorer, settings: tuple[str, ...], said: str) -> None:
    with pytest.raises(InputError) as fault:
        solved(explorer, *settings)
    assert any(said in line for line in fault.value.lines)


@pytest.mark.slow
def test_the_command_writes_document_rows_and_picture(
    explorer: Explorer,
    scattered: ToleranceResult,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(answer, "cell_model", lambda case, log: explorer.model)
    words = [word for text in SCATTER for word in ("--set", text)]
    command = ["tolerance", str(SMALL), "--alike", "--quiet", *words]
    assert main([*command, "--out", str(tmp_path)]) == 0
    document = json.loads((tmp_path / "tolerance.json").read_text())
    assert len(document["samples"]) == 3 and document["dofs"] is None and document["space_check"] == {}
    assert (tmp_path / "tolerance.csv").read_text().splitlines()[0] == "sample,peak_hz,confinement_db,tracking"
    assert (tmp_path / "tolerance.png").exists()
    assert "3 plates, each with one deviation of all its pillars" in scattered.pictures()[0].alt
    assert "one deviation shared by all of a plate" in capsys.readouterr().out
    assert main([*command, "--band", "30kHz:34kHz"]) == 2
    assert "cannot be combined with --alike" in capsys.readouterr().err
