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
from collections.abc import Collection
from pathlib import Path

from pipeline.planning.resources import GIB
from solvers.machine import STATED
from tests.fuzz.run import CORPUS, SHARES, run

BYTES = 3_000_000_000  # beyond what the process holds when it starts


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument(
        "--count", type=int, default=4000, help="files to draw; one command that solves for 500 of them"
    )
    parser.add_argument("--seed", type=int, default=int(time.time()) * 1000, help="of the first; printed")
    every = [*SHARES, "solve"]
    parser.add_argument("--kinds", nargs="*", default=every, choices=every, help="of inputs; all if left out")
    given = parser.parse_args()
    print(f"seed {given.seed}", flush=True)
    with tempfile.TemporaryDirectory() as folder:

        def drawn(names: Collection[str]) -> dict[str, Counter[str]]:
            return run(Path(folder), given.count, given.seed, CORPUS, lambda line: print(line, flush=True), names)

        held = int(re.findall(r"VmSize:\s+(\d+)", Path("/proc/self/status").read_text())[0]) * 1024
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (held + BYTES, hard))
        result = drawn({*given.kinds} - {"solve"})
        # solvers reserve addresses that they do not use: their commands are held to the same by their own estimates
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        os.environ[STATED] = f"{BYTES / GIB:.3f}"
        result |= drawn({*given.kinds} & {"solve"})
    print(f"{'kind':12s}{'read':>9s}{'refused':>9s}{'failed':>9s}")
    for name, counts in result.items():
        print(f"{name:12s}{counts['read']:9d}{counts['refused']:9d}{counts['failed']:9d}")
    return int(any(counts["failed"] for counts in result.values()))


if __name__ == "__main__":
    sys.exit(main())
