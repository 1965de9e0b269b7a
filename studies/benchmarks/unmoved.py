"""Comparison of every figure of the commands' JSON documents with an earlier commit of this repository.

    python -m studies.benchmarks.unmoved --commit COMMIT [--renamed OLD=NEW ...] [COMMAND ...]

Each command runs here and in that commit's files, on a small case each, with caches of its own; the figures in both documents
are compared. A figure is unmoved within 1e-9 of the largest of its name. Exit code 4 where one has moved or is gone.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pipeline.paths import ROOT
from studies.benchmarks import ran
from studies.benchmarks.before_after import checkout

CHECK_FAILED = 4
ALLOWED = 1e-9  # relative to the largest figure of the name
NOT_COMPARED = ("seconds", "version", "kind", "options", "warnings")
SMALL, ROUGH = "examples/small.toml", "--set solve.accuracy=0.1"
ZONES, MEASURED = "examples/39-rows-between-zones.toml", "examples/measured"
PATCHED = f"{SMALL} {ROUGH} --set patches.size_mm=[8.0,3.0,0.3]"
BAND = "--band 33kHz:36kHz"
FEW = "--evaluations 2 --mac 0.1 --min-frequency 20kHz"
VARY = f"--vary pillar.height_mm=6:6.6 {FEW}"
SHIFTED = "--set array.stagger=true --set array.pitch_x_mm=5 --set array.pitch_y_mm=4"
TASKS = {
    "predesign": f"predesign {SMALL}",
    "modes": f"modes {SMALL} {ROUGH}",
    "modes of the pillar": f"modes {SMALL} {ROUGH} --part pillar --count 4",
    "bands": f"bands {SMALL} {ROUGH} --set bands.points=4 --set bands.grid=4",
    "bands of staggered rows": f"bands {SMALL} {ROUGH} {SHIFTED} --set bands.points=2",
    "attenuation": f"attenuation {SMALL} {ROUGH} {BAND} --points 7",
    "broadband": f"broadband {SMALL} {ROUGH} {BAND} --points 7",
    "response": f"response {PATCHED} {BAND} --points 21",
    "response, measured": f"response examples/33-measured.toml {ROUGH} --points 21 --measured {MEASURED}/sweep.csv "
    f"--map {MEASURED}/field.csv",
    "tolerance": f"tolerance {PATCHED} {BAND} --set tolerance.height_mm=0.05 --samples 3",
    "touch": f"touch {PATCHED} {BAND} --set touch.radius_mm=5.0 --no-map",
    "crosstalk": f"crosstalk {ZONES} {ROUGH} {BAND} --points 9",
    "search": f"search {SMALL} {ROUGH} {VARY} --vary pillar.faces=back:both --goal confinement",
    "search of the widest band": f"search {SMALL} {ROUGH} {VARY} --goal widest",
    "search of two zones": f"search {ZONES} {ROUGH} --vary zone.shared_rows=1:3 --goal closest {FEW}",
    "hybrid": f"hybrid {PATCHED} {BAND} --points 3",
    "travel": f"travel {PATCHED} --set patches.sensors=[2] --band 28kHz:36kHz --set touch.radius_mm=5.0",
    "touch with a map": f"touch {PATCHED} {BAND} --set touch.radius_mm=5.0",
    "check-gap": "check-gap",
    "active mason": "active mason --frequency 20kHz",
    "active pillar": "active pillar --cell",
    "active beam": "active beam --gain 1e7 --gain 1e8",
    "active shaping": "active shaping",
    "active dq": "active dq --settling-time 2ms",
}


def document(root: Path, command: str) -> dict[str, Any]:
    """The JSON document of a command of the checkout at `root`. RuntimeError where it fails."""
    with tempfile.TemporaryDirectory(prefix="antinode-unmoved-") as folder:
        place = f"{folder}/a.json"
        ran(
            "-m",
            "antinode",
            *command.split(),
            "--quiet",
            "--json",
            place,
            root=root,
            environment={"XDG_CACHE_HOME": folder},
        )
        found: dict[str, Any] = json.loads(Path(place).read_text())
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


def moved(before: dict[str, Any], after: dict[str, Any], names: Mapping[str, str]) -> tuple[int, list[str]]:
    """Number of figures in both documents, and a line for each that has moved or is gone.

    names: parts of the earlier document's keys, and what they are called since.
    """
    one, two = {_renamed(place, names): value for place, value in figures(before)}, dict(figures(after))
    name_of = {place: place.rpartition(".")[2].partition("[")[0] for place in one}
    largest = dict.fromkeys(name_of.values(), 0.0)
    for place, value in one.items():
        if isinstance(value, float):
            largest[name_of[place]] = max(largest[name_of[place]], abs(value))
    lines = [f"{place}: {value} is gone" for place, value in one.items() if place not in two]
    for place in one.keys() & two.keys():
        old, new = one[place], two[place]
        numbers = isinstance(old, float) and isinstance(new, int | float)
        same = old == new or (numbers and abs(new - old) <= ALLOWED * largest[name_of[place]])
        lines += [] if same else [f"{place}: {old} -> {new}"]
    return len(one.keys() & two.keys()), sorted(lines)


def _renamed(place: str, names: Mapping[str, str]) -> str:
    for old, new in names.items():
        place = place.replace(old, new)
    return place


def main(words: list[str] | None = None) -> int:
    """Print one line per command, then the figures that have moved."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--commit", required=True)
    parser.add_argument(
        "--renamed", action="append", default=[], metavar="OLD=NEW", help="part of a key, renamed since"
    )
    parser.add_argument("tasks", nargs="*", metavar="COMMAND", help=", ".join(TASKS))
    given = parser.parse_args(words)
    if unknown := set(given.tasks) - TASKS.keys():
        parser.error(f"unknown: {', '.join(sorted(unknown))}: must be of {', '.join(TASKS)}")
    names = dict(each.split("=", 1) for each in given.renamed)
    faults = 0
    with checkout(given.commit) as earlier:
        for name in given.tasks or TASKS:
            before, after = (document(root, TASKS[name]) for root in (earlier, ROOT))
            count, lines = moved(before, after, names)
            print(f"{name}: {count} figures, {len(lines)} moved or gone", flush=True)
            print("".join(f"  {line}\n" for line in lines[:20]), end="")
            faults += len(lines)
    return CHECK_FAILED if faults else 0


if __name__ == "__main__":
    raise SystemExit(main())
