"""The benchmark of layers and loss compares cases that differ in these alone, and fails where one costs too much."""

from __future__ import annotations

from typing import Any

import pytest

from pipeline.case.model import load_case
from studies.benchmarks import Ended, materials
from studies.benchmarks.materials import CHECK_FAILED, PAIRS, texts


@pytest.mark.parametrize("name", PAIRS)
def test_the_cases_of_a_pair_differ_in_what_it_is_named_after(name: str, tmp_path: Any) -> None:
    files = [tmp_path / "one.toml", tmp_path / "other.toml"]
    for file, text in zip(files, texts(PAIRS[name]), strict=True):
        file.write_text(text, "utf-8")
    one, other = (load_case(file) for file in files)
    assert one.design.pillar == other.design.pillar and one.design.thickness_m == pytest.approx(
        other.design.thickness_m
    )
    assert (len(one.design.stack.layers), one.is_lossy) == (1, False)
    assert (len(other.design.stack.layers), other.is_lossy) == ((1, True) if name == "loss" else (3, False))


@pytest.mark.parametrize(
    ("seconds", "peak", "code"), [(1.9, 2.0, 0), (2.1, 1.0, CHECK_FAILED), (1.0, 2.1, CHECK_FAILED)]
)
def test_a_pair_that_costs_more_than_allowed_fails(
    seconds: float, peak: float, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(*words: str) -> Ended:
        size = (seconds, peak) if any("other" in word for word in words) else (1.0, 1.0)
        return Ended("", "", size[0], size[0], int(1e9 * size[1]))

    monkeypatch.setattr(materials, "ran", run)
    assert materials.main(["loss"]) == code
    assert f"| loss | 1.0 | {seconds:.1f} | {seconds:.2f} |" in capsys.readouterr().out
