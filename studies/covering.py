"""Lines of the project that each test runs, as a plugin of pytest: `-p studies.covering`, with COVERING = folder and file."""

from __future__ import annotations

import json
import os
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

FOLDER, TARGET = os.environ.get("COVERING", os.pathsep).split(os.pathsep)
lines: dict[str, set[int]] = defaultdict(set)
known: dict[str, dict[str, Any]] = {}


def _called(frame: FrameType, event: str, argument: object) -> Any:
    """Trace the lines of the folder's functions; other functions cost one call."""
    return _line if frame.f_code.co_filename.startswith(FOLDER) else None


def _line(frame: FrameType, event: str, argument: object) -> Any:
    lines[frame.f_code.co_filename].add(frame.f_lineno)
    return _line


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Record what a test runs, its fixtures included: those shared by several tests count for the first of them."""
    lines.clear()
    begin = time.process_time()
    sys.settrace(_called)
    try:
        return (yield)
    finally:
        sys.settrace(None)
        ran = {str(Path(name).relative_to(FOLDER)): sorted(numbers) for name, numbers in lines.items()}
        known.setdefault(item.nodeid, {}).update(seconds=time.process_time() - begin, lines=ran)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Leave out tests that fail without any fault planted."""
    if report.failed:
        known.setdefault(report.nodeid, {})["failed"] = True


def pytest_sessionfinish() -> None:
    """Write what every test that passed runs."""
    Path(TARGET).write_text(json.dumps({name: each for name, each in known.items() if "failed" not in each}))
