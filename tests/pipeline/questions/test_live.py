"""The measure `live`: the explorer's own numbers for a case, and a case that the bases do not hold left out by name."""

from __future__ import annotations

import fcntl
import multiprocessing
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.case.model import load_case
from pipeline.explore.answer import Explorer
from pipeline.logs import TerminalLog, WarningLog
from pipeline.models import parametric
from pipeline.models.parametric import CellModelCache
from pipeline.questions.live import Live, LiveResult
from pipeline.questions.question import ask
from pipeline.records.record import Record
from pipeline.records.study import StoredCase, StoredStudy
from pipeline.report import gallery
from tests.helpers.exploring import SMALL, small_explorer
from tests.helpers.recording_log import RecordingLog


@pytest.fixture(scope="module")
def explorer(tmp_path_factory: pytest.TempPathFactory) -> Explorer:
    return small_explorer(tmp_path_factory.mktemp("cells"))


def live_of(explorer: Explorer, log: RecordingLog, *settings: str) -> LiveResult:
    """What a study keeps of examples/small.toml with --set words."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parametric, "cell_model", lambda case, log: explorer.model)
        return ask(load_case(SMALL, list(settings)), Live(), log)


def test_a_case_has_the_numbers_of_the_page(explorer: Explorer) -> None:
    log = RecordingLog()
    live = live_of(explorer, log)
    page = explorer.answer(explorer.scene.own())
    plate, rows = page["plate"], page["rows"]
    assert live.frequency_hz == plate["frequency_hz"] and live.frequency_error == plate["frequency_error"]
    assert live.confinement_db == plate["confinement_db"] and live.zone_to_extension_db == plate["extension_db"]
    assert live.zone_to_extension_error_db == plate["extension_error_db"] is not None
    near = int(np.argmin(np.abs(np.array(rows["frequency_hz"]) - live.frequency_hz)))
    around = [level for level in rows["db_per_row"][max(near - 1, 0) : near + 2] if level is not None]
    assert min(around) <= live.db_per_row <= max(around)  # type: ignore[operator]
    known = np.array(
        [(hz, db) for hz, db in zip(rows["frequency_hz"], rows["db_per_row"], strict=True) if db is not None]
    )
    for end in (1.0 - live.frequency_error, 1.0 + live.frequency_error):
        assert abs(np.interp(end * live.frequency_hz, *known.T) - live.db_per_row) <= live.db_error * (1.0 + 1e-9)
    widest = max(page["bands"]["gaps"], key=lambda gap: gap["upper_hz"] - gap["lower_hz"], default=None)
    assert live.gap_hz == (widest and [widest["lower_hz"], widest["upper_hz"]])
    assert not log.warnings and live.warnings == []


def test_what_a_column_cannot_tell_is_a_warning(explorer: Explorer) -> None:
    log = RecordingLog()
    live = live_of(explorer, log, "array.rows=5", "array.extension_mm=45")
    assert "wide passive part" in log.warnings["LIVE"] and live.warnings == [log.warnings["LIVE"]]


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ((), None),
        (("pillar.height_mm=3.5",), "height = 3.5 mm: must lie between 4 and 9 mm"),
        (("array.pitch_mm=9",), "pitch = 9 mm"),
        (("pillar.fillet_mm=0.2",), "without fillet"),
    ],
)
def test_a_case_that_the_bases_do_not_hold_is_left_out_by_name(settings: tuple[str, ...], said: str | None) -> None:
    spared = Live.spared(load_case(SMALL, list(settings)))
    if said is None:
        assert spared is None
    else:
        assert spared and spared.what == "live" and said in spared.why


def test_live_answers_are_drawn_without_plates_and_beside_them(tmp_path: Path) -> None:
    def case(height: float, hz: float) -> StoredCase:
        live = LiveResult(
            frequency_hz=hz, confinement_db=12.0, gap_hz=None, gap_error=None, db_per_row=None, warnings=[]
        )
        own = {"case_id": f"height_mm={height:g}", "status": "OK", "sweep": {"pillar.height_mm": height}}
        return StoredCase(tmp_path, Record.model_validate({**own, "live": live}))

    cases = [case(5.0, 40e3), case(6.0, 36e3), case(7.0, 31e3)]
    study = StoredStudy(tmp_path, {"name": "heights"}, tuple(cases))
    figure = gallery.against_sweep(study)
    assert figure is not None
    _, tone = figure.figure.axes
    (crosses,) = [line for line in tone.lines if line.get_marker() == "x"]
    assert crosses.get_xdata().tolist() == [5.0, 6.0, 7.0] and crosses.get_ydata().tolist() == [40.0, 36.0, 31.0]
    assert [text.get_text() for text in figure.figure.legends[0].get_texts()] == ["explorer"]


def _waits(folder: Path, order: Any) -> None:
    with CellModelCache(folder).alone(TerminalLog()):
        order.put("second")


def test_a_process_that_waits_for_the_bases_of_another_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cache = CellModelCache(tmp_path)
    with (tmp_path / ".making").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        free = threading.Timer(0.2, fcntl.flock, (file, fcntl.LOCK_UN))
        free.start()
        begin = time.perf_counter()
        with cache.alone(TerminalLog()):
            assert time.perf_counter() - begin >= 0.1
        free.join()
    assert "waiting for it" in capsys.readouterr().err
    with cache.alone(TerminalLog()):
        pass
    assert capsys.readouterr().err == ""


@pytest.mark.slow
def test_one_process_at_a_time_makes_a_model(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    order = context.Queue()
    with CellModelCache(tmp_path).alone(WarningLog()):
        other = context.Process(target=_waits, args=(tmp_path, order))
        other.start()
        time.sleep(2.0)
        order.put("first")
    other.join(60)
    assert [order.get(timeout=10), order.get(timeout=10)] == ["first", "second"]
