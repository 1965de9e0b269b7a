"""One table a question: the CSV of its command, `to_dataframe()` and what a record holds.

That every frequency and level there has its error bar is held in tests/verification/test_bars_of_commands.py.
"""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest

import antinode
from pipeline.cli.main import main
from pipeline.questions import registered
from pipeline.records.record import Record

ROOT = Path(__file__).resolve().parents[3]
SMALL = "examples/small.toml"
SHORT = {"zone__length_mm": 28.0, "zone__nodal_lines": 2, "array__rows": 1}
ASKED: dict[str, tuple[str, dict[str, Any], dict[str, Any]]] = {  # case, its overrides, the question's options
    "predesign": (SMALL, {}, {}),
    "modes": (SMALL, {"accuracy": 0.1}, {"part": "pillar", "count": 3}),
    "bands": (SMALL, {"accuracy": 0.1, "bands__points": 2, "bands__count": 4}, {}),
    "attenuation": (SMALL, {"accuracy": 0.1}, {"band_kHz": (33.0, 36.0), "points": 3}),
    "broadband": (SMALL, {"accuracy": 0.1}, {"band_kHz": (33.0, 36.0), "points": 3}),
    "search": (SMALL, {"accuracy": 0.1}, {"vary": "pillar.height_mm=6:6.6", "evaluations": 1, "mac": 0.3}),
    "response": (
        SMALL,
        {"accuracy": 0.1, "patches__size_mm": [8.0, 3.0, 0.3]},
        {"band_kHz": (33.0, 36.0), "points": 3},
    ),
    "tolerance": (
        SMALL,
        {"accuracy": 0.1, "tolerance__height_mm": 0.05},
        {"band_kHz": (30.0, 40.0), "samples": 2},
    ),
    "drift": (SMALL, {"accuracy": 0.1}, {"points": 3}),
    "crosstalk": ("examples/39-rows-between-zones.toml", {"accuracy": 0.1}, {"band_kHz": (33.0, 36.0), "points": 3}),
    "hybrid": (
        SMALL,
        {"accuracy": 0.1, **SHORT, "patches__size_mm": [4.0, 3.0, 0.3]},
        {"band_kHz": (33.0, 36.0), "points": 3},
    ),
    "touch": (
        SMALL,
        {"accuracy": 0.1, "patches__size_mm": [8.0, 3.0, 0.3], "touch__radius_mm": 5.0},
        {"band_kHz": (33.0, 36.0)},
    ),
    "travel": (
        SMALL,
        {"accuracy": 0.1, "patches__size_mm": [8.0, 3.0, 0.3], "patches__sensors": [2]},
        {"band_kHz": (28.0, 36.0)},
    ),
}
SLOW = {
    "search",
    "tolerance",
    "crosstalk",
    "hybrid",
    "touch",
    "travel",
    "active_beam",
    "active_shaping",
}  # theirs are quick
ASKED |= {f"active_{model}": (SMALL, {}, {}) for model in ("mason", "pillar", "beam", "dq", "shaping")}


def flags(options: dict[str, Any]) -> list[str]:
    words = []
    for name, value in options.items():
        text = f"{value[0]}kHz:{value[1]}kHz" if name == "band_kHz" else str(value)
        words += [f"--{name.removesuffix('_kHz')}", text]
    return words


def test_every_question_is_asked_here() -> None:
    assert ASKED.keys() == registered().keys()


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name for name in ASKED]
)
@pytest.mark.filterwarnings("ignore::antinode.AntinodeWarning")
def test_command_frame_and_record_hold_one_table(
    name: str, tmp_path: Path, coarsest_here: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pandas")
    monkeypatch.chdir(ROOT)
    path, overrides, options = ASKED[name]
    plate = antinode.load(path, **overrides)
    asked = {key: value for key, value in options.items() if key != "vary"}
    result = plate.search(height_mm=(6.0, 6.6), **asked) if name == "search" else getattr(plate, name)(**asked)
    frame = result.to_dataframe()
    (tmp_path / "case.json").write_text(json.dumps(Record(case_id="one", status="OK", **{name: result}).to_dict()))
    stored = Record.model_validate(json.loads((tmp_path / "case.json").read_text())).of(type(result))
    assert stored == result and stored.to_rows() == result.to_rows() == frame.astype(object).where(
        frame.notna(), None
    ).to_dict("records")
    words = [f"{key.replace('__', '.') if '__' in key else f'solve.{key}'}={value}" for key, value in overrides.items()]
    given = [each for word in words for each in ("--set", word)]
    assert (
        main(
            [
                *registered()[name].command().split(),
                path,
                *given,
                *flags(options),
                "-q",
                "--csv",
                str(tmp_path / "t.csv"),
            ]
        )
        == 0
    )
    with (tmp_path / "t.csv").open() as file:
        head, *lines = list(csv.reader(file))
    assert head == list(frame.columns) and len(lines) == len(frame)
    for line, row in zip(lines, result.to_rows(), strict=True):
        unlike = {
            name: (cell, row[name]) for name, cell in zip(head, line, strict=True) if not _alike(name, cell, row[name])
        }
        assert not unlike


def _alike(name: str, cell: str, value: Any) -> bool:
    """Whether a cell of a second run holds a value: figures to 1e-9, error bars, differences of such, to 1e-6."""
    if isinstance(value, float):
        return float(cell) == pytest.approx(value, rel=1e-6 if "error" in name else 1e-9, abs=1e-12)
    return cell.removeprefix("'") == ("" if value is None else str(value))  # the guard of a cell that is no formula
