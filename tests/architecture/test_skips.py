"""What the run says at its end of the tests that this machine cannot run."""

from __future__ import annotations

from types import SimpleNamespace

from tests import conftest


def test_skipped_tests_are_told_in_one_line() -> None:
    lines: list[str] = []
    reports = [
        SimpleNamespace(
            nodeid=f"tests/browser/test_study_page.py::{name}", longrepr=("f.py", 3, "Skipped: no Chromium")
        )
        for name in "ab"
    ]
    other = SimpleNamespace(nodeid="tests/firmware/test_six.py::c", longrepr=("f.py", 3, "Skipped: no unicorn"))
    reporter = SimpleNamespace(stats={"skipped": [*reports, other]}, write_line=lines.append)
    conftest.pytest_terminal_summary(reporter)
    assert lines == ["3 tests were skipped: 2 (no Chromium); 1 (no unicorn)"]
    reporter.stats = {"passed": reports}
    conftest.pytest_terminal_summary(reporter)
    assert len(lines) == 1
