"""Every frequency and level of a command's document has the field of its bar, and its bar in the printed line.

Fields are looked up in the results of all questions; one coarse case a command shows that bars are numbers there.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest
import tomli_w

from pipeline.cli.main import main
from pipeline.planning import mesh_rules
from pipeline.questions import known as every_question
from pipeline.records import part
from solvers.piezo import patch as piezo_patch
from tests.helpers.coarse_cells import COARSE as COARSE_MESH
from tests.helpers.coarse_cells import COARSEST_PATCH
from tests.helpers.scenes import STEEL_PILLARS

FIGURE = re.compile(r"(_hz|_db|_m_per_V|_per_um|db_per_row)$")
GIVEN, OTHERWISE = "asked for", "its bar stands under another name"
THEORY = OTHERWISE + ": expected_error"
ABSENT = "never a number: modes are those of the plate without patches"
EXACT = {
    "AttenuationPoint.frequency_hz": GIVEN,
    "BroadbandPoint.frequency_hz": GIVEN,
    "Limits.isolation_db": GIVEN,
    "Limits.highest_hz": GIVEN,
    "Limits.lowest_hz": GIVEN,
    "CountRecord.low_hz": GIVEN,
    "CountRecord.high_hz": GIVEN,
    "TargetRecord.window_hz": GIVEN,
    "TargetMode.window_hz": GIVEN,
    "PredictionResult.frequency_hz": OTHERWISE + ": that of the target mode",
    "ShapesResult.frequency_hz": OTHERWISE + ": that of the mode",
    "BoardResult.frequency_hz": "as the table has it, or the image found it",
    **{f"ZoneSizes.{name}_hz": THEORY for name in ("frequency", "formula", "pinned", "thin_clamped", "clamped")},
    **{f"PillarSizes.{name}_hz": THEORY for name in ("frequency", "given_euler", "given_timoshenko", "given_second")},
    "MeasuredSweepRecord.band_hz": GIVEN,
    **{f"SampleRecord.{name}": "samples have no bar of their resonances" for name in ("peak_hz", "confinement_db")},
    **{
        f"ToleranceResult.{name}": OTHERWISE + ": its deviation"
        for name in ("peak_hz", "peak_shift_hz", "confinement_db")
    },
    "MeasuredMapRecord.confinement_db": "a map does not tell its noise",
    "ComputedMap.confinement_at_points_db": "a map does not tell its noise",
    "ComputedMap.frequency_hz": OTHERWISE + ": that of the peak",
    "ComputedMap.confinement_db": OTHERWISE + ": that of the peak",
    "TargetRecord.driven_confinement_db": ABSENT,
    "TargetMode.driven_confinement_db": ABSENT,
}
PRINTED = re.compile(r"(?<![\d.])-?\d[\d.]* (?:[GMk]?Hz|dB)")
BARRED = re.compile(
    r" ± \d[\d.]* (?:[GMk]?Hz|dB)|(?<![\d.])0 dB|(?:by|,) 10 dB (?:or more|in \d+)"
)  # or exact, or given


def answers(kind: type[part.Part], known: list[type[part.Part]]) -> list[type[part.Part]]:
    """The class of an answer to a question and those of all its parts."""
    if kind not in known:
        known.append(kind)
        hints = get_type_hints(kind)
        waiting: list[Any] = [hints[name] for name in kind.declared]
        while waiting:
            held = waiting.pop()
            if isinstance(held, type) and issubclass(held, part.Part):
                answers(held, known)
            waiting += get_args(held)
    return known


def bar_of(name: str, fields: Any) -> str | None:
    """The field of a figure's bar among those of its record."""
    unit = FIGURE.search(name)
    assert unit is not None
    stem = name[: unit.start()]
    own = {"_hz": ["_error", "_error_hz"], "db_per_row": ["db_error"]}.get(unit[0], [f"_error{unit[0]}"])
    names = [stem + end for end in own] + (["error"] if stem in ("frequency", "frequencies", "computed") else [])
    return next((each for each in names if each in fields), None)


def figures(fields: Any) -> list[str]:
    return [name for name in fields if FIGURE.search(name) and not re.search("error|_bar_", name)]


def test_every_frequency_and_level_has_the_field_of_a_bar() -> None:
    seen: dict[str, str | None] = {}
    for question in every_question().values():
        if question.family:
            continue  # a formula, exact for what it states
        for kind in answers(question.result, []):
            asked = {name: each for name, each in kind.declared.items() if each.along != (name,)}  # not an axis itself
            seen |= {f"{kind.__name__}.{name}": asked[name].error or None for name in figures(asked)}
            assert {each.error for each in asked.values() if each.error} <= asked.keys()
    assert len(seen) > 40
    assert {name for name, bar in seen.items() if bar is None} == EXACT.keys()


SMALL: dict[str, Any] = {
    **STEEL_PILLARS,
    "zone": {**STEEL_PILLARS["zone"], "nodal_lines": 2},
    "solve": {"accuracy": 0.1},
    "damping": {"quality": 100.0},
    "patches": {
        "size_mm": [3.0, 2.0, 0.3],
        "face": "touch",
        "centres_mm": [[-5.0, 0.0], [5.0, 0.0], [0.0, 1.0]],
        "sensors": [2],
    },
}
COMMANDS = ["attenuation", "broadband", "response", "crosstalk", "hybrid", "travel", "touch"]
BAND = ["--band", "60kHz:80kHz"]
OPTIONS = {"travel": [], "touch": ["--no-map"]}


def answered(command: str, folder: Path, patch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The document of a coarse mesh that another one shows the error of."""
    patch.setattr(mesh_rules, "cell_mesh", lambda design, level: COARSE_MESH)
    patch.setattr(piezo_patch, "MESH", COARSEST_PATCH)
    case = (
        {**SMALL, "touch": {"at_mm": [3.0, 1.0], "radius_mm": 1.0, "impedance": "tissue"}}
        if command == "touch"
        else SMALL
    )
    (folder / "case.toml").write_text(tomli_w.dumps(case))
    assert tomllib.loads((folder / "case.toml").read_text()) == case
    options = [*BAND, *OPTIONS.get(command, ["--points", "3"])]
    assert main([command, str(folder / "case.toml"), *options, "--quiet", "--json", str(folder / "a.json")]) == 0
    return json.loads((folder / "a.json").read_text())


def unbarred(value: Any, place: str = "") -> Iterator[str]:
    """Figures of a document that are numbers and whose bars are not."""
    if isinstance(value, list):
        for each in value:
            yield from unbarred(each, place)
    elif isinstance(value, dict):
        for name in figures(value):
            bar = bar_of(name, value)
            if bar is not None and not alike(value[name], value[bar]):
                yield f"{place}/{name}"
        for name, each in value.items():
            if name not in ("with_defaults", "design"):
                yield from unbarred(each, f"{place}/{name}")


def alike(figure: Any, bar: Any) -> bool:
    """Whether there is a bar for every number of a figure: one each, or one for all."""
    if isinstance(figure, list):
        bars = bar if isinstance(bar, list) else [bar] * len(figure)
        return all(alike(*pair) for pair in zip(figure, bars, strict=False))
    return figure is None or bar is not None


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_bars_are_numbers_and_printed(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of waves across the rows the least attenuated flexural one alone has one."""
    document = answered(command, tmp_path, monkeypatch)
    assert not set(unbarred(document)) - {"/points/waves/db_per_row"}
    said = capsys.readouterr().out
    assert "±" in said
    for line in said.splitlines():
        assert len(PRINTED.findall(line)) <= len(BARRED.findall(line)), line
