"""Benchmarks: each module measures within one run, in processes of its own, and prints ratios."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.paths import ROOT


def timed(action: Callable[[], Any], repeats: int) -> float:
    """Shortest wall time of several runs, s, which excludes the load of other programs."""
    best = float("inf")
    for _ in range(repeats):
        start = time.perf_counter()
        action()
        best = min(best, time.perf_counter() - start)
    return best


@dataclass(frozen=True)
class Ended:
    """Result of a process: its output and errors; its processor time and that of every process that it waited for, s; the time
    until it ended, s; the memory of the largest of them, bytes.
    """

    printed: str
    complaints: str
    seconds: float
    wall: float
    peak_bytes: int


def ran(
    *words: str,
    root: Path = ROOT,
    python: str = sys.executable,
    check: bool = True,
    environment: dict[str, str] | None = None,
) -> Ended:
    """Run Python with these arguments in the checkout at `root`, with an empty results folder by default.

    RuntimeError with its last words where it fails, unless not to be checked.
    """
    with tempfile.TemporaryDirectory(prefix="antinode-results-") as results:
        outputs = Path(results, "stdout"), Path(results, "stderr")
        own = os.environ | {"PYTHONPATH": str(root), "ANTINODE_RESULTS": f"{results}/results"} | (environment or {})
        own.pop("PYTHONDONTWRITEBYTECODE", None)
        with outputs[0].open("w") as out, outputs[1].open("w") as err:
            begin = time.perf_counter()
            with subprocess.Popen([python, *words], cwd=root, env=own, stdout=out, stderr=err) as process:
                _, status, usage = os.wait4(process.pid, 0)
                process.returncode = os.waitstatus_to_exitcode(status)
            wall = time.perf_counter() - begin
        printed, complaints = (output.read_text() for output in outputs)
    if check and process.returncode:
        last = (complaints or printed).split()[-30:]
        raise RuntimeError(f"{' '.join(words)}: exit code {process.returncode}: {' '.join(last) or 'no message'}")
    peak_bytes = usage.ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    return Ended(printed, complaints, usage.ru_utime + usage.ru_stime, wall, peak_bytes)
