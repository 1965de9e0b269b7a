"""All benchmarks in turn, each in a process of its own: `make bench` ends with them."""

from __future__ import annotations

import subprocess
import sys

NAMES = ("cold_start", "linear_algebra", "bands", "own_cell")

if __name__ == "__main__":
    for name in NAMES:
        print(f"\n== {name}", flush=True)
        subprocess.run([sys.executable, "-m", f"studies.benchmarks.{name}"], check=True)
