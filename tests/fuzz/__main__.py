"""`make fuzz`: exit code 1 if an input failed."""

from __future__ import annotations

import argparse
import os
import re
import resource
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from pipeline.planning.resources import GIB
from solvers.machine import STATED
from tests.fuzz.run import CORPUS, SHARES, run

BYTES = 3_000_000_000  # beyond what the process holds when it starts
HARD = resource.getrlimit(resource.RLIMIT_AS)[1]


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument(
        "--count", type=int, default=4000, help="files to draw; one command that solves for 500 of them"
    )
    parser.add_argument("--seed", type=int, default=int(time.time()) * 1000, help="of the first; printed")
    parser.add_argument("--kinds", nargs="*", default=(), choices=[*SHARES, "solve"], help="of inputs; all if left out")
    given = parser.parse_args()
    print(f"seed {given.seed}", flush=True)
    chosen = given.kinds or [*SHARES, "solve"]
    result: dict[str, Counter[str]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for share in ([name for name in chosen if name != "solve"], [name for name in chosen if name == "solve"]):
            if share:
                # a solver reserves addresses that it does not use: it is held to what a command takes by its own estimate
                _limit(None if share == ["solve"] else BYTES)
                result |= run(
                    Path(folder), given.count, given.seed, CORPUS, lambda line: print(line, flush=True), share
                )
    print(f"{'kind':12s}{'read':>9s}{'refused':>9s}{'failed':>9s}")
    for name, counts in result.items():
        print(f"{name:12s}{counts['read']:9d}{counts['refused']:9d}{counts['failed']:9d}")
    return int(any(counts["failed"] for counts in result.values()))


def _limit(beyond: int | None) -> None:
    """Let the process reserve so many bytes beyond what it holds; without a limit, let commands foresee as many at most."""
    held = int(re.findall(r"VmSize:\s+(\d+)", Path("/proc/self/status").read_text())[0]) * 1024
    resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY if beyond is None else held + beyond, HARD))
    os.environ[STATED] = f"{BYTES / GIB:.3f}"


if __name__ == "__main__":
    sys.exit(main())
