"""Benchmarks: each module measures within one run, in processes of its own, and prints ratios."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil


def peak_bytes() -> int:
    """Largest resident size of this process so far.

    The kernel's figure for this program alone where it is told; getrusage's would begin with the parent's.
    """
    status = Path("/proc/self/status")
    if status.exists():
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) * 1024
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def resident_bytes() -> int:
    """Resident size of this process now."""
    return int(psutil.Process().memory_info().rss)


def timed(action: Callable[[], Any], repeats: int) -> float:
    """Shortest wall time of several runs, s: what other programs on the machine add is left out."""
    best = float("inf")
    for _ in range(repeats):
        start = time.perf_counter()
        action()
        best = min(best, time.perf_counter() - start)
    return best


def in_a_process(module: str, *arguments: str) -> dict[str, Any]:
    """The JSON object that `python -m module arguments` prints last. Raises RuntimeError with its last words."""
    done = subprocess.run([sys.executable, "-m", module, *arguments], capture_output=True, text=True)
    lines = done.stdout.splitlines()
    if done.returncode or not lines:
        words = (done.stderr or done.stdout).strip().splitlines()
        raise RuntimeError(f"{module} {' '.join(arguments)}: {words[-1] if words else 'said nothing'}")
    result: dict[str, Any] = json.loads(lines[-1])
    return result
