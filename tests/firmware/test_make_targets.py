"""What `make` would do for the firmware, without doing it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SINGLE, SIX = (
    "firmware.build --table firmware/generated/mode_table.bin",
    "firmware.build --table firmware/generated/six_table.bin",
)


@pytest.mark.parametrize(
    ("target", "does", "leaves"),
    [
        ("firmware", (SINGLE, f"{SIX} --variant six"), ("firmware.flash",)),
        ("flash", (SINGLE, "firmware.flash single"), ("six",)),
        ("release", (SINGLE, f"{SIX} --variant six", "antinode.svd antinode-six.elf"), ("firmware.flash",)),
        ("flash-six", (f"{SIX} --variant six", "firmware.flash six"), ("mode_table.bin", "antinode export")),
    ],
)
def test_a_target_builds_what_it_needs_and_no_more(target: str, does: tuple[str, ...], leaves: tuple[str, ...]) -> None:
    if not shutil.which("make"):
        pytest.skip("make is not installed")
    plan = subprocess.run(["make", "-n", target], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert [plan.index(step) for step in does] == sorted(plan.index(step) for step in does)
    assert not [word for word in leaves if word in plan]
