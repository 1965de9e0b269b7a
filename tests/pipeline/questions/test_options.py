"""Options of questions as Python gives them: read as their type, refused in words."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.case.model import load_case
from pipeline.cli.main import main
from pipeline.errors import InputError
from pipeline.questions.modes import PRINTED, Modes, ModesResult
from pipeline.records import record
from pipeline.records.part import plain
from pipeline.records.record import Record
from tests.helpers import synthetic

SMALL = str(Path(__file__).resolve().parents[3] / "examples" / "small.toml")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"band_kHz": [34.0, 30.0]}, "two rising numbers"),
        ({"band_kHz": (30.0,)}, "two rising numbers"),
        ({"band_kHz": 30.0}, "two rising numbers"),
        ({"band_kHz": (float("nan"), 30.0)}, "finite"),
        ({"count": 2.5}, "a whole number"),
        ({"count": "3"}, "a whole number"),
        ({"count": np.int64(0)}, "1 or more"),
        ({"part": "lid"}, "must be plate, zone or pillar"),
        ({"symmetry": "SX"}, "must be SS, SA, AS or AA"),
    ],
)
def test_an_option_of_another_kind_is_refused(options: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        Modes(**options)


def test_equal_options_make_equal_questions() -> None:
    one, other = Modes([30.0, 34.0], count=np.int64(3)), Modes((30, 34), count=3, progress=True)  # type: ignore[arg-type]
    assert one == other and hash(one) == hash(other) and one.given()["band_kHz"] == [30.0, 34.0]


def test_a_band_in_hz_that_no_memory_holds_is_doubted_and_one_in_khz_is_not(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["modes", SMALL, "--band", "30MHz:34MHz", "--quiet"]) == 2
    assert "divide by 1000 if Hz were meant (30000 to 34000 kHz was requested)" in capsys.readouterr().err
    assert main(["modes", SMALL, "--band", "30kHz:34kHz", "--set", "solve.accuracy=1e-7", "--explain"]) in (0, 2)
    assert "if Hz were meant" not in "".join(capsys.readouterr())


def test_a_long_table_is_printed_around_the_target_mode() -> None:
    listed = [synthetic.mode(30e3 + 100.0 * place) for place in range(60)]
    _, said, table, *_ = synthetic.modes(synthetic.target(12.0, 34e3, index=40), listed).lines()
    _, *printed = table.splitlines()
    assert said == f"28 modes below and {60 - 28 - PRINTED} above these: --csv and --json list all"
    assert len(printed) == PRINTED and "32.8" in printed[0] and "35.1" in printed[-1]
    assert [line for line in printed if line.startswith("*")] == [printed[40 - 28]] and "34.0" in printed[40 - 28]
    _, table, *_ = synthetic.modes(synthetic.NO_MODE, listed[:PRINTED]).lines()
    assert len(table.splitlines()) == 1 + PRINTED


def test_a_plan_of_what_plans_little_has_no_empty_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mesh = tmp_path / "block.inp"
    mesh.write_text("*NODE\n")
    for words in (("predesign", SMALL), ("modes", SMALL, "--mesh-file", str(mesh))):
        assert main([*words, "--explain"]) == 0
        lines = capsys.readouterr().out.splitlines()
        assert not [line for line in lines if line.endswith(":") or "the study asks" in line]
    assert main(["modes", SMALL, "--mesh-file", str(mesh), "--symmetry", "SS", "--explain"]) == 2
    assert "--symmetry = SS: cannot be combined with --mesh-file" in capsys.readouterr().err


def test_patches_that_modes_leave_out_are_said(capsys: pytest.CaptureFixture[str]) -> None:
    case = load_case(SMALL, ["patches.size_mm=[8.0,3.0,0.3]"])
    (step,) = Modes().plan(case).steps
    assert "no_patches" in {each.rule for each in step.left_out}


@pytest.mark.parametrize("target", [synthetic.target(12.0), synthetic.NO_MODE, None])
def test_modes_go_through_a_record_and_back(target: Any) -> None:
    modes = synthetic.modes(target, [synthetic.mode(31e3), synthetic.mode(32e3)])
    whole = Record(case_id="one", status="OK", modes=modes)
    assert Record.model_validate(whole.to_dict()) == whole and whole.of(ModesResult) == modes
    assert type(Record.model_validate(whole.to_dict()).modes.target) is type(target)


def test_a_record_of_the_version_before_is_read() -> None:
    """Its sizes held the number of their document's form."""
    sizes = {"schema": 2, "zone": None, "pillar": None, "limits": []}
    assert record.answer_of("predesign", sizes).limits == []  # type: ignore[attr-defined]


def test_numbers_that_are_none_are_null() -> None:
    assert plain([float("nan"), complex(float("nan"), 1.0), np.array([1.0, np.inf])]) == [
        None,
        [None, 1.0],
        [1.0, None],
    ]


@pytest.mark.slow
def test_what_was_not_computed_is_missing_in_tables_and_arrays() -> None:
    bands = synthetic.bands(0.004)
    from dataclasses import replace

    bare = replace(bands, points=[replace(point, error=[], computed_hz=[]) for point in bands.points])
    assert np.isnan(bare.error).all() and bare.error.shape == bare.frequencies_hz.shape
    assert {row["error"] for row in bare.to_rows()} == {None}
    nothing = synthetic.modes(synthetic.NO_MODE)
    assert list(nothing.to_dataframe().columns) == nothing.heading() and nothing.heading()[0] == "mode"
