"""What continuous integration runs: style and types, the quick tests, and one share of the slow proofs."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from pipeline.paths import ROOT

DURATIONS = ROOT / "tests" / "durations.json"
WORKERS = 2
SHARE_S = 15 * 60.0  # of two workers; the rest of 45 minutes is for environment, quick tests and a slower machine
LEAST = 11  # shares: proofs that come later have no stored duration yet
RUN_S = 45 * 60.0
LONGEST_S = 9 * 60.0  # of one proof: none is begun later than this before the end of the run
INSTALL_S, FETCH_S = 420.0, 120.0  # at most


@dataclass(frozen=True)
class Tool:
    """A program that some tests need and pip does not install, and its packages."""

    package: str
    commands: tuple[str, ...]
    tests: str

    @property
    def is_there(self) -> bool:
        """Whether one of its commands is on PATH."""
        return any(shutil.which(name) for name in self.commands)


TOOLS = (
    Tool("chromium", ("chromium", "chromium-browser", "google-chrome"), "tests/browser"),
    Tool("gcc-arm-none-eabi", ("arm-none-eabi-gcc",), "the firmware's tests of code that gcc compiles"),
    Tool("calculix-ccx", ("ccx",), "the frequencies of the meshes written for CalculiX"),
    Tool("frama-c-base", ("frama-c",), "the proofs of the firmware's core for every input"),
    Tool("clang-19 llvm-19 libclang-rt-19-dev", ("llvm-cov-19",), "the conditions of the firmware's core (MC/DC)"),
    Tool("xvfb", ("Xvfb",), "the window of antinode view"),
)


def install(tools: tuple[Tool, ...] = TOOLS) -> list[str]:
    """Install the programs that are missing, where apt and root allow it.

    Parameters
    ----------
    tools : tuple of Tool
        Programs that some tests need.

    Returns
    -------
    list of str
        One line for each program that is still missing: the tests that are skipped, and why.
    """
    missing = [tool for tool in tools if not tool.is_there]
    if not missing:
        return []
    why = "not root, or no apt"
    if os.geteuid() == 0 and shutil.which("apt-get"):
        done = _called(["apt-get", "update", "-qq"], INSTALL_S)
        for tool in missing if done else ():
            _called(["apt-get", "install", "-y", "-qq", "--no-install-recommends", *tool.package.split()], INSTALL_S)
        why = "apt could not install it" if done else "apt-get update failed"
    return [f"skipped: {tool.tests} ({tool.package}: {why})" for tool in missing if not tool.is_there]


def _called(command: list[str], seconds: float) -> bool:
    """Run a command that may fail; whether it succeeded within its time."""
    quiet = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    try:
        return subprocess.run(command, timeout=seconds, env=quiet, stdout=subprocess.DEVNULL).returncode == 0
    except (OSError, subprocess.TimeoutExpired):
        return False


def commits(folder: Path = ROOT) -> tuple[int, str]:
    """Count the commits, with those of a shallow clone fetched where possible.

    Parameters
    ----------
    folder : Path
        The checkout.

    Returns
    -------
    tuple of int and str
        The number that chooses the share, and a line if it is not the number of commits.
    """
    git = ["git", "-C", str(folder)]

    def answer(*words: str) -> str:
        try:
            return subprocess.run([*git, *words], capture_output=True, text=True).stdout.strip()
        except OSError:
            return ""

    if answer("rev-parse", "--is-shallow-repository") == "true":
        _called([*git, "fetch", "--quiet", "--unshallow"], FETCH_S)
    counted = answer("rev-list", "--count", "HEAD")
    if counted and answer("rev-parse", "--is-shallow-repository") == "false":
        return int(counted), ""
    day = int(time.time() // 86400)
    if counted:  # a clone of fixed depth always has as many
        return int(counted) + day, f"the history is shallow: {counted} commits and the day choose the share"
    return day, "no history: the day chooses the share"


def shares(seconds: float) -> int:
    """Number of shares into which slow proofs are split.

    A prime, so that changes of any fixed number of commits have every share in turn.

    Parameters
    ----------
    seconds : float
        Duration of all slow proofs, one after the other.

    Returns
    -------
    int
        The smallest prime above `seconds` over the time of one share, at least LEAST.
    """
    least = max(LEAST, int(seconds / (WORKERS * SHARE_S)) + 1)
    return next(n for n in count(least) if all(n % d for d in range(2, int(n**0.5) + 1)))


def share(number: int, durations: dict[str, float]) -> str:
    """Name the share of slow proofs that a run takes.

    Parameters
    ----------
    number : int
        Number of commits.
    durations : dict of str to float
        Seconds of each slow proof.

    Returns
    -------
    str
        "k/n", as `make slow SHARD=` takes it.
    """
    n = shares(sum(durations.values()))
    return f"{number % n + 1}/{n}"


def main() -> int:
    """Run everything; returns the exit code."""
    begin = float(os.environ.get("CI_BEGIN", time.time()))
    chosen, note = commits()
    for line in (*install(), *([note] if note else [])):
        print(line, flush=True)
    slow = [
        "slow",
        f"SHARD={share(chosen, json.loads(DURATIONS.read_text()))}",
        f"UNTIL={begin + RUN_S - LONGEST_S:.0f}",
    ]
    for words in (["lint"], ["test"], slow):
        print("make", *words, flush=True)
        code = subprocess.run(["make", *words], cwd=ROOT).returncode
        if code:
            return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
