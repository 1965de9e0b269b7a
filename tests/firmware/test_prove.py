"""What Frama-C's Eva shows of the core for every input, and that it sees a fault in each part."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from firmware import prove

FAULTS = {
    "fast": ("single/an_fast.c", "#define AN_LEVEL_MAX 2047.4f", "#define AN_LEVEL_MAX 2049.6f"),
    "fault": ("single/an_fast.c", "if (fast->faults != 0u) {", "if (fast->faults == 1u) {"),
    "six": ("six/an_six_fast.c", "fast->growing <= AN_SIX_GAP_BANK ?", "fast->growing <= AN_SIX_GAP_BANK + 1u ?"),
    "capture": ("an_capture.c", "(uint32_t)AN_CAPTURE_ROOM - capture->row", "(uint32_t)AN_CAPTURE_ROOM"),
    "texture": (
        "an_texture.c",
        "texture->samples[texture->taken % AN_TEXTURE_ROOM]",
        "texture->samples[texture->taken]",
    ),
}

pytestmark = pytest.mark.skipif(not prove.is_installed(), reason="frama-c is not installed (Debian: frama-c-base)")


@pytest.mark.parametrize("name", prove.SOURCES)
def test_it_holds_for_every_input(name: str) -> None:
    assert prove.unproven(name) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", prove.SOURCES)
def test_a_fault_is_seen(name: str, tmp_path: Path) -> None:
    source, was, becomes = FAULTS[name]
    core = tmp_path / "core"
    shutil.copytree(prove.CORE, core)
    text = (core / source).read_text()
    assert text.count(was) == 1
    (core / source).write_text(text.replace(was, becomes))
    assert prove.unproven(name, core)


def test_a_broken_source_is_not_taken_for_proven(tmp_path: Path) -> None:
    core = tmp_path / "core"
    shutil.copytree(prove.CORE, core)
    (core / "an_sine.c").write_text("nonsense")
    with pytest.raises(RuntimeError, match="fast"):
        prove.unproven("fast", core)
