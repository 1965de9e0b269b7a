"""Cells of a pillar from a STEP file are known by the file's contents: an edited file is reduced anew."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from geometry.layout import Pillar
from pipeline.case.model import load_case
from pipeline.logs import TerminalLog
from pipeline.models import parts
from pipeline.planning.model_choice import model_choice_of

CASE = Path(__file__).resolve().parents[3] / "studies" / "three-rows.toml"


def key_of(file: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """What the first piece with a pillar would be kept under."""
    heard: list[Any] = []

    class Joined:
        def __init__(self, design: Any, reductions: Any, bytes_each: float) -> None:
            heard.append(reductions)
            raise StopIteration

    monkeypatch.setattr(parts, "PlateModel", Joined)
    case = load_case(CASE)
    more = (("extent_m", 2e-3), ("volume_m3", 25.2e-9))  # as a file of that bar would tell
    pillar = Pillar("step", 2e-3, 2e-3, 6.3e-3, case.design.material, file=str(file), more_m=more)
    case = replace(case, design=replace(case.design, pillar=pillar))
    with pytest.raises(StopIteration):
        parts.built(case, model_choice_of(case, "plate", 45e3), TerminalLog(True), [])
    return str(heard[0].mesher_name)


def test_an_edited_file_is_another_pillar(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "post.step"
    file.write_text("one")
    first = key_of(file, monkeypatch)
    assert key_of(file, monkeypatch) == first
    file.write_text("two")
    assert key_of(file, monkeypatch) != first
