"""Every figure of the commands' JSON documents beside those of an earlier commit of this repository.

    python -m studies.benchmarks.unmoved --commit COMMIT [COMMAND ...]

Each command runs here and in that commit's files, on a small case each, with caches of its own; what stands in both documents
is compared. A figure is unmoved within 1e-9 of the largest of its name. Exit code 4 where one has moved or is gone.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pipeline.paths import ROOT
from studies.benchmarks.before_after import checkout

CHECK_FAILED = 4
ALLOWED = 1e-9  # relative to the largest figure of the name
NOT_COMPARED = ("seconds", "version", "kind", "options", "warnings")
SMALL, ROUGH = "examples/small.toml", ("--set", "solve.accuracy=0.1")
PATCHED = (SMALL, *ROUGH, "--set", "patches.size_mm=[8.0,3.0,0.3]")
BAND = ("--band", "33kHz:36kHz")
VARY = ("--vary", "pillar.height_mm=6:6.6", "--evaluations", "2", "--mac", "0.1", "--min-frequency", "20kHz")
TOUCHED = (*PATCHED, *BAND, "--set", "touch.radius_mm=5.0")
TASKS: dict[str, tuple[str, ...]] = {
    "predesign": ("predesign", SMALL),
    "modes": ("modes", SMALL, *ROUGH),
    "modes of the pillar": ("modes", SMALL, *ROUGH, "--part", "pillar", "--count", "4"),
    "bands": ("bands", SMALL, *ROUGH, "--set", "bands.points=4", "--set", "bands.grid=4"),
    "bands of staggered rows": (
        "bands",
        SMALL,
        *ROUGH,
        "--set",
        "array.stagger=true",
        "--set",
        "array.pitch_x_mm=5",
        "--set",
        "array.pitch_y_mm=4",
        "--set",
        "bands.path=GXMYG",
        "--set",
        "bands.points=2",
    ),
    "attenuation": ("attenuation", SMALL, *ROUGH, *BAND, "--points", "7"),
    "broadband": ("broadband", SMALL, *ROUGH, *BAND, "--points", "7"),
    "response": ("response", *PATCHED, *BAND, "--points", "21"),
    "response, measured": (
        "response",
        "examples/measured/plate.toml",
        *ROUGH,
        "--points",
        "21",
        "--measured",
        "examples/measured/sweep.csv",
        "--map",
        "examples/measured/field.csv",
    ),
    "tolerance": ("tolerance", *PATCHED, *BAND, "--set", "tolerance.height_mm=0.05", "--samples", "3"),
    "touch": ("touch", *TOUCHED, "--no-map"),
    "crosstalk": ("crosstalk", "examples/small-zones.toml", *ROUGH, *BAND, "--points", "9"),
    "search": ("search", SMALL, *ROUGH, *VARY, "--vary", "pillar.faces=back:both", "--goal", "confinement"),
    "search of the widest band": ("search", SMALL, *ROUGH, *VARY, "--goal", "widest"),
    "search of two zones": (
        "search",
        "examples/small-zones.toml",
        *ROUGH,
        "--vary",
        "zone.shared_rows=1:3",
        "--goal",
        "closest",
        *VARY[2:],
    ),
    "hybrid": ("hybrid", *PATCHED, *BAND, "--points", "3"),
    "travel": (
        "travel",
        *PATCHED,
        "--set",
        "patches.sensors=[2]",
        "--band",
        "28kHz:36kHz",
        "--set",
        "touch.radius_mm=5.0",
    ),
    "touch with a map": ("touch", *TOUCHED),
    "check-gap": ("check-gap",),
}


def document(root: Path, command: tuple[str, ...]) -> dict[str, Any]:
    """The JSON document of a command of the checkout at `root`. CalledProcessError where it fails."""
    with tempfile.TemporaryDirectory(prefix="antinode-unmoved-") as folder:
        own = {"PYTHONPATH": str(root), "XDG_CACHE_HOME": folder, "ANTINODE_RESULTS": folder}
        words = [sys.executable, "-m", "antinode", *command, "--quiet", "--json", f"{folder}/a.json"]
        subprocess.run(words, cwd=root, env=os.environ | own, check=True, capture_output=True)
        found: dict[str, Any] = json.loads(Path(folder, "a.json").read_text())
        return found


def figures(value: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Every number and word of a document by its place; nothing for null."""
    if isinstance(value, dict):
        for name, each in value.items():
            if name not in NOT_COMPARED:
                yield from figures(each, f"{place}.{name}" if place else name)
    elif isinstance(value, list):
        for index, each in enumerate(value):
            yield from figures(each, f"{place}[{index}]")
    elif value is not None:
        yield place, value


def moved(before: dict[str, Any], after: dict[str, Any]) -> tuple[int, list[str]]:
    """How many figures both documents have, and a line for each that has moved or is gone."""
    one, two = dict(figures(before)), dict(figures(after))
    largest: dict[str, float] = {}
    for place, value in one.items():
        if isinstance(value, float):
            name = place.rpartition(".")[2].partition("[")[0]
            largest[name] = max(largest.get(name, 0.0), abs(value))
    lines = [f"{place}: {value} is gone" for place, value in one.items() if place not in two]
    for place in one.keys() & two.keys():
        old, new = one[place], two[place]
        name = place.rpartition(".")[2].partition("[")[0]
        numbers = isinstance(old, float) and isinstance(new, int | float)
        same = old == new or (numbers and abs(new - old) <= ALLOWED * largest[name])
        lines += [] if same else [f"{place}: {old} -> {new}"]
    return len(one.keys() & two.keys()), sorted(lines)


def main(words: list[str] | None = None) -> int:
    """A line a command, then what has moved."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--commit", required=True)
    parser.add_argument("tasks", nargs="*", metavar="COMMAND", help=", ".join(TASKS))
    given = parser.parse_args(words)
    if unknown := set(given.tasks) - TASKS.keys():
        parser.error(f"unknown: {', '.join(sorted(unknown))}: must be of {', '.join(TASKS)}")
    faults = 0
    with checkout(given.commit) as earlier:
        for name in given.tasks or TASKS:
            count, lines = moved(*(document(root, TASKS[name]) for root in (earlier, ROOT)))
            print(f"{name}: {count} figures, {len(lines)} moved or gone", flush=True)
            print("".join(f"  {line}\n" for line in lines[:20]), end="")
            faults += len(lines)
    return CHECK_FAILED if faults else 0


if __name__ == "__main__":
    raise SystemExit(main())
