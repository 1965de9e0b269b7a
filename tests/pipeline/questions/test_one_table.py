"""One table a question: the CSV of its command, `to_dataframe()` and what a record holds; every frequency has its error bar."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest

import antinode
from pipeline.cli.main import main
from pipeline.questions import registered
from pipeline.records import part
from pipeline.records.record import Record

ROOT = Path(__file__).resolve().parents[3]
SMALL = "examples/small.toml"
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
    "crosstalk": ("examples/small-zones.toml", {"accuracy": 0.1}, {"band_kHz": (33.0, 36.0), "points": 3}),
    "hybrid": (SMALL, {"accuracy": 0.1, "patches__size_mm": [8.0, 3.0, 0.3]}, {"band_kHz": (33.0, 36.0), "points": 3}),
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
ASKED |= {f"active_{model}": (SMALL, {}, {}) for model in ("mason", "pillar", "beam", "dq", "shaping")}
NOT_COMPUTED = {  # frequencies without an error bar: what was asked for, not computed
    "CountRecord.low_hz", "CountRecord.high_hz", "WantedRecord.window_hz", "WantedMode.window_hz",
    "AttenuationPoint.frequency_hz", "BroadbandPoint.frequency_hz", "Limits.lowest_hz",
    "MeasuredSweepRecord.band_hz",
    "SampleRecord.peak_hz",  # samples have no error bar of their resonances
    "ComputedMap.frequency_hz",  # the peak's, whose error bar stands there
}  # fmt: skip


def flags(options: dict[str, Any]) -> list[str]:
    words = []
    for name, value in options.items():
        text = f"{value[0]}kHz:{value[1]}kHz" if name == "band_kHz" else str(value)
        words += [f"--{name.removesuffix('_kHz')}", text]
    return words


def test_every_question_is_asked_here() -> None:
    assert ASKED.keys() == registered().keys()


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name == "active_shaping" else name for name in ASKED]
)
@pytest.mark.filterwarnings("ignore::antinode.Caution")
def test_command_frame_and_record_hold_one_table(
    name: str, tmp_path: Path, coarsest_cells: None, monkeypatch: pytest.MonkeyPatch
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
        assert all(_alike(cell, value) for cell, value in zip(line, row.values(), strict=True)), line


def _alike(cell: str, value: Any) -> bool:
    """Whether a cell of a second run holds a value, to 1e-9."""
    if isinstance(value, float):
        return float(cell) == pytest.approx(value, rel=1e-9, abs=1e-12)
    return cell.removeprefix("'") == ("" if value is None else str(value))  # the guard of a cell that is no formula


def parts(kind: type[part.Part], known: dict[str, type[part.Part]]) -> dict[str, type[part.Part]]:
    """A result's class and those of all its parts, by name."""
    known[kind.__name__] = kind
    hints = get_type_hints(kind)
    waiting: list[Any] = [hints[name] for name in kind.declared]
    while waiting:
        held = waiting.pop()
        if isinstance(held, type) and issubclass(held, part.Part) and held.__name__ not in known:
            parts(held, known)
        waiting += get_args(held)
    return known


@pytest.mark.parametrize("name", sorted(name for name, each in registered().items() if not each.family))
def test_every_frequency_has_an_error_bar(name: str) -> None:
    """Of what is computed of a plate; a model of `active` is a formula, exact for what it states."""
    bare = {
        f"{kind.__name__}.{column}"
        for kind in parts(registered()[name].result, {}).values()
        for column, about in kind.declared.items()
        if about.unit == "Hz"
        and about.along != (column,)
        and about.error not in kind.declared
        and column not in {each.error for each in kind.declared.values()}
    }
    assert bare <= NOT_COMPUTED | (THEORIES if name == "predesign" else set())


THEORIES = {  # of a theory beside whose frequencies `expected_error` stands, by their names
    *(f"ZoneSizes.{name}_hz" for name in ("frequency", "formula", "pinned", "thin_clamped", "clamped")),
    *(f"PillarSizes.{name}_hz" for name in ("frequency", "given_euler", "given_timoshenko", "given_second")),
}
