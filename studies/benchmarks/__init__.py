"""Benchmarks: each module measures within one run, in processes of its own, and prints ratios."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any


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
