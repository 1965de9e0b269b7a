"""Cost of a command before it computes: wall time of a fresh process, and the modules that take longest to import.

`python -m studies.benchmarks.cold_start` prints both for the commands that people type while they think.
"""

from __future__ import annotations

import re
from statistics import median

from studies.benchmarks import ran

CASE = "studies/three-rows.toml"
COMMANDS = (
    ("--help",),
    ("predesign", CASE),
    ("doctor",),
    ("modes", CASE, "--explain"),
    ("run", "rows", "--dry-run"),
    ("search", CASE, "--vary", "pillar.height_mm=8:5"),
)
REPEATS = 5
SHOWN = 4
LINE = re.compile(r"import time:\s*(\d+) \|\s*(\d+) \| ( *)(\S+)")


def slowest(arguments: tuple[str, ...]) -> list[tuple[str, float]]:
    """The packages whose import took longest, with their own imports, ms (the interpreter's own accounting)."""
    entry = ran("-X", "importtime", "-m", "pipeline.cli.main", *arguments, check=False).complaints
    measured: dict[str, float] = {}
    for match in LINE.finditer(entry):
        name = match.group(4)
        if "." not in name:
            measured[name] = float(match.group(2)) / 1e3
    return sorted(measured.items(), key=lambda pair: -pair[1])[:SHOWN]


def main() -> None:
    """Print one line per command."""
    for arguments in COMMANDS:
        parts = ", ".join(f"{name} {spent:.0f} ms" for name, spent in slowest(arguments))
        seconds = median(ran("-m", "pipeline.cli.main", *arguments, check=False).wall for _ in range(REPEATS))
        print(f"antinode {' '.join(arguments)}: {seconds:.2f} s ({parts})", flush=True)


if __name__ == "__main__":
    main()
