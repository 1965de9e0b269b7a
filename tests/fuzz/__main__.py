"""`make fuzz`: exit code 1 if an input failed."""

from __future__ import annotations

import argparse
import re
import resource
import sys
import tempfile
import time
from pathlib import Path

from tests.fuzz.run import CORPUS, SHARES, run

BYTES = 3_000_000_000  # beyond what the process holds when it starts


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument(
        "--count", type=int, default=4000, help="files to draw; one command that solves for 500 of them"
    )
    parser.add_argument("--seed", type=int, default=int(time.time()) * 1000, help="of the first; printed")
    parser.add_argument("--kinds", nargs="*", default=(), choices=[*SHARES, "solve"], help="of inputs; all if left out")
    given = parser.parse_args()
    held = int(re.findall(r"VmSize:\s+(\d+)", Path("/proc/self/status").read_text())[0]) * 1024
    resource.setrlimit(resource.RLIMIT_AS, (held + BYTES, held + BYTES))
    print(f"seed {given.seed}", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        result = run(Path(folder), given.count, given.seed, CORPUS, lambda line: print(line, flush=True), given.kinds)
    print(f"{'kind':12s}{'read':>9s}{'refused':>9s}{'failed':>9s}")
    for name, counts in result.items():
        print(f"{name:12s}{counts['read']:9d}{counts['refused']:9d}{counts['failed']:9d}")
    return int(any(counts["failed"] for counts in result.values()))


if __name__ == "__main__":
    sys.exit(main())
