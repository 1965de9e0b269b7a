"""The ordinary commands on a machine that has numpy and scipy and none of the optional factorisations."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from pipeline.case.model import load_case
from pipeline.cli import main
from pipeline.models import cross_check
from pipeline.models.cell_cache import CellCache
from pipeline.planning import mesh_rules
from pipeline.questions.question import Run
from pipeline.questions.study import answer as kept
from pipeline.questions.tetrahedra import TetBands, TetModes
from solvers import machine
from solvers.errors import TooLarge
from solvers.fem import eigen, factor
from tests.helpers import coarse_cells, synthetic
from tests.helpers.recording_log import RecordingLog
from tests.helpers.scenes import three_patches

pytestmark = pytest.mark.usefixtures("coarsest_cells")
SMALL = str(Path(__file__).resolve().parents[3] / "examples" / "small.toml")
COARSE = ("--set", "solve.accuracy=0.1", "--set", "zone.length_mm=28", "--set", "zone.nodal_lines=2")
BANDS = (*COARSE, "--set", "bands.points=1", "--set", "bands.count=8")
SLOW = {"zone", "solid", "pillar", "nearest to a frequency far below the first"}
MODES = {
    "lowest of the free plate": (SMALL, *COARSE, "--count", "3"),
    "nearest to a frequency far below the first": (
        SMALL,
        *COARSE,
        "--near",
        "40Hz",
        "--count",
        "1",
        "--symmetry",
        "SS",
    ),
    "zone": (SMALL, *COARSE, "--part", "zone", "--count", "4"),
    "pillar": (SMALL, *COARSE, "--part", "pillar", "--count", "4"),
    "solid": (SMALL, *COARSE, "--set", "solve.model=solid", "--set", "array.rows=0", "--count", "3"),
}


REDUCED: dict[str, Any] = {}


@pytest.fixture(autouse=True)
def scipy_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """No other factorisation, and only cells that were reduced here."""

    def absent(*_: Any) -> None:
        raise AssertionError("a factorisation that is not installed was asked for")

    monkeypatch.delenv("ANTINODE_FACTOR", raising=False)
    monkeypatch.setattr(machine, "factorisations", lambda: ("superlu",))
    monkeypatch.setattr(factor, "Rslab", absent)
    monkeypatch.setattr(CellCache, "get", lambda self, key: REDUCED.get(key))
    monkeypatch.setattr(CellCache, "put", lambda self, key, cell: REDUCED.setdefault(key, cell))
    monkeypatch.setattr(mesh_rules, "cell_settings", lambda design, accuracy: coarse_cells.COARSE)


def answer(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    """The JSON of a command that must end well."""
    code = main.main([*arguments, "--json", "-", "--quiet"])
    text = capsys.readouterr()
    assert code == 0, text.err
    result: dict[str, Any] = json.loads(text.out)
    return result


@pytest.mark.parametrize(
    "what", [pytest.param(what, marks=[pytest.mark.slow] if what in SLOW else []) for what in MODES]
)
def test_modes_are_found_counted_and_clean(what: str, capsys: pytest.CaptureFixture[str]) -> None:
    result = answer(capsys, "modes", *MODES[what])
    count = result["count_check"]
    assert count["expected"] == count["found"] >= 1
    assert max(mode["residual"] for mode in result["modes"]) <= eigen.CLEAN_RESIDUAL


@pytest.mark.slow
def test_bands_and_attenuation_are_found(capsys: pytest.CaptureFixture[str]) -> None:
    assert len(answer(capsys, "bands", SMALL, *BANDS)["points"]) == 4
    points = answer(capsys, "attenuation", SMALL, *COARSE, "--band", "30kHz:30.5kHz", "--points", "9")["points"]
    assert all(point["db_per_row"] is not None for point in points)


@pytest.mark.slow
def test_a_response_is_found(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    case = tmp_path / "patched.toml"
    case.write_text(three_patches((20.0, 30.0), 0.1))
    one = ("--set", "patches.centres_mm=[[0.0, 0.0]]", "--set", "patches.sensors=[]")  # which couples no classes
    result = answer(capsys, "response", str(case), *one)
    assert max(result["zone_rms_m_per_V"]) > 0.0


def test_a_cross_check_that_memory_cannot_hold_is_left_out_and_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def too_large(*_: Any) -> None:
        raise TooLarge("factorising 314396 degrees of freedom needs about 7.5 GiB, 4.0 GiB are free")

    part_modes = SimpleNamespace(target_row=SimpleNamespace(error=None))
    monkeypatch.setattr(cross_check.modes, "solve_modes", lambda *_: part_modes)
    monkeypatch.setattr(cross_check, "compared", too_large)
    monkeypatch.setattr(TetBands, "compute", lambda *_: synthetic.bands(0.004))
    log = RecordingLog()
    run = Run(log)
    kept(TetModes(), load_case(SMALL), run)
    assert [*run.found] == ["tet_bands"]
    assert "is left out: factorising 314396 degrees of freedom needs about 7.5 GiB" in log.warnings["TOO_LARGE"]
