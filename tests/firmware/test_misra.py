"""The table of deviations from MISRA C against what cppcheck reports."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from firmware.host import CORE, PLACES
from tests.firmware.test_static import CPPCHECK

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "misra.md"
REPORTED = re.compile(r"\[misra-c2012-([0-9.]+)\]")


def listed() -> set[str]:
    """Rules in the first column of the page's table."""
    rows = [line.split("|")[1] for line in PAGE.read_text().splitlines() if line.startswith("| ")]
    return {rule.strip() for row in rows[1:] for rule in row.split(",")}


@pytest.mark.slow
def test_the_table_lists_the_rules_from_which_the_core_deviates() -> None:
    sources = [str(path) for path in sorted(CORE.rglob("*.c"))]
    command = [CPPCHECK, "--addon=misra", "--enable=style", "--language=c", "--std=c11", "-q", *PLACES, *sources]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    assert set(REPORTED.findall(done.stderr)) == listed()
