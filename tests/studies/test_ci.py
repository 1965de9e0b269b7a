"""What continuous integration runs: programs that it installs, the share that it chooses, and how a failure ends it."""

from __future__ import annotations

import json
import os
import subprocess
import time
from pathlib import Path

import pytest

from studies import ci
from tests import conftest

TOOL = ci.Tool("rare", ("rare-program",), "tests of rare")
QUICK_S = 15 * 60.0  # `make test` on two cores, with room for the environment


def program(folder: Path, name: str, script: str) -> None:
    path = folder / name
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that is searched before all others, for one who is root."""
    (tmp_path / "bin").mkdir()
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    return tmp_path / "bin"


def test_a_missing_program_is_installed(path: Path) -> None:
    program(path, "apt-get", f'if [ "$1" = install ]; then for last; do :; done; cp "$0" {path}/$last-program; fi')
    assert ci.install((TOOL,)) == [] and TOOL.is_there


@pytest.mark.parametrize(
    ("script", "reason"),
    [("exit 1", "apt-get update failed"), ('[ "$1" = update ]', "apt could not install it")],
)
def test_what_cannot_be_installed_is_a_line_and_no_failure(path: Path, script: str, reason: str) -> None:
    program(path, "apt-get", script)
    assert ci.install((TOOL,)) == [f"skipped: tests of rare (rare: {reason})"]


def test_nothing_is_installed_by_one_who_is_not_root(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    program(path, "apt-get", f"touch {path}/called")
    assert ci.install((TOOL,)) == ["skipped: tests of rare (rare: not root, or no apt)"]
    assert not (path / "called").exists()


def git(folder: Path, *words: str) -> None:
    named = ["-c", "user.name=one", "-c", "user.email=one@example.org"]
    subprocess.run(["git", "-C", str(folder), *named, *words], check=True, capture_output=True)


def test_a_shallow_history_is_fetched_or_named(tmp_path: Path) -> None:
    (tmp_path / "whole").mkdir()
    git(tmp_path / "whole", "init", "-q")
    for _ in range(5):
        git(tmp_path / "whole", "commit", "-q", "--allow-empty", "-m", "one")
    assert ci.commits(tmp_path / "whole") == (5, "")
    for name in ("near", "far"):
        git(tmp_path, "clone", "-q", "--depth=2", f"file://{tmp_path}/whole", name)
    assert ci.commits(tmp_path / "near") == (5, "")
    git(tmp_path / "far", "remote", "remove", "origin")
    number, note = ci.commits(tmp_path / "far")
    assert number - 2 in (day := int(time.time() // 86400), day - 1) and "2 commits and the day" in note
    assert "no history" in ci.commits(tmp_path / "nowhere")[1]


def test_every_number_of_commits_between_runs_has_all_shares_in_turn() -> None:
    durations = {"a": 20 * ci.SHARE_S, "b": 9 * ci.SHARE_S}
    n = int(ci.share(0, durations).partition("/")[2])
    assert n == 17
    for step in range(1, n):
        assert len({ci.share(7 + step * run, durations) for run in range(n)}) == n
    assert ci.share(0, durations) == "1/17" and ci.share(16, durations) == "17/17"
    assert ci.share(0, {}) == f"1/{ci.LEAST}"


def test_no_share_of_the_stored_durations_is_too_long() -> None:
    """pytest-split cuts the list of proofs where sums of durations reach a share; one proof may lie across a cut."""
    durations = json.loads(ci.DURATIONS.read_text())
    longest = max(durations.values())
    assert longest < ci.LONGEST_S
    part = sum(durations.values()) / ci.shares(sum(durations.values()))
    assert QUICK_S + (part + longest) / ci.WORKERS + longest < ci.RUN_S


@pytest.mark.parametrize(
    ("failing", "code", "called"),
    [
        ("none", 0, ["lint", "test", "slow"]),
        ("lint", 2, ["lint"]),
        ("test", 2, ["lint", "test"]),
        ("slow", 2, ["lint", "test", "slow"]),
    ],
)
def test_a_proof_that_falls_fails_the_run(
    path: Path, monkeypatch: pytest.MonkeyPatch, failing: str, code: int, called: list[str]
) -> None:
    program(path, "make", f'echo "$@" >> {path}/called; [ "$1" != {failing} ] || exit 2')
    monkeypatch.setattr(ci, "TOOLS", ())
    monkeypatch.setattr(ci, "install", lambda: ["skipped: tests/browser (chromium: not root, or no apt)"])
    monkeypatch.setenv("CI_BEGIN", "1000")
    assert ci.main() == code
    lines = (path / "called").read_text().splitlines()
    assert [line.split()[0] for line in lines] == called
    if called[-1] == "slow":
        until = 1000 + ci.RUN_S - ci.LONGEST_S
        assert (
            lines[-1]
            == f"slow SHARD={ci.share(ci.commits()[0], json.loads(ci.DURATIONS.read_text()))} UNTIL={until:.0f}"
        )


def test_no_proof_is_begun_after_the_time_of_its_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(conftest, "UNTIL", time.time() + 1000.0)
    conftest.pytest_runtest_setup()
    monkeypatch.setattr(conftest, "UNTIL", time.time() - 1.0)
    with pytest.raises(pytest.skip.Exception, match="time of this run was up"):
        conftest.pytest_runtest_setup()
