"""Cost of layers and of loss: three layers against one on a plate of three rows, complex bands with loss against without.

    python -m studies.benchmarks.materials [--repeats N] [PAIR ...]

Both commands of a pair run in turn, each in a process of its own with an empty results folder; figures are medians. Exit code 4
where processor seconds or memory exceed what is allowed.
"""

from __future__ import annotations

import argparse
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from pipeline.paths import ROOT
from studies.benchmarks import Ended, ran

CASE = ROOT / "studies" / "three-rows.toml"
CHECK_FAILED = 4
LAYERS = (("aluminosilicate", 0.7), ("optically-clear-adhesive", 0.15), ("glass", 1.15))  # as thick as the case's plate
BAND = ("--band", "30kHz:34kHz")


@dataclass(frozen=True)
class Pair:
    """Two commands on the case file, its text before and after, and how many times as much the second may take."""

    words: tuple[str, ...]
    change: tuple[str, str]
    allowed: float


def layered() -> str:
    """The plate's table as layers."""
    tables = (f'[[plate.layer]]\nmaterial = "{name}"\nthickness_mm = {thick}\n' for name, thick in LAYERS)
    return "\n".join(tables)


PAIRS = {
    "layers": Pair(("modes", *BAND), ("[plate]\nthickness_mm = 2.0\n", layered()), 3.0),
    "layers, target mode": Pair(("modes",), ("[plate]\nthickness_mm = 2.0\n", layered()), 3.0),
    "loss": Pair(("attenuation", *BAND), ("quality = 300.0", 'quality = "materials"'), 2.0),
}


def texts(pair: Pair) -> tuple[str, str]:
    """Both case files of a pair."""
    text = CASE.read_text("utf-8")
    before, after = pair.change
    assert text.count(before) == 1
    changed = text.replace(before, after)
    tomllib.loads(changed)
    return text, changed


def measured(pair: Pair, repeats: int) -> list[list[Ended]]:
    """Runs of both commands, in turn."""
    with tempfile.TemporaryDirectory(prefix="antinode-materials-") as folder:
        files = [Path(folder, name) for name in ("one.toml", "other.toml")]
        for file, text in zip(files, texts(pair), strict=True):
            file.write_text(text, "utf-8")
        first, *rest = pair.words
        pairs = [[ran("-m", "antinode", first, str(file), *rest, "--quiet") for file in files] for _ in range(repeats)]
    return [list(side) for side in zip(*pairs, strict=True)]


def main(words: list[str] | None = None) -> int:
    """Print a row for each pair."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("pairs", nargs="*", metavar="PAIR", help=", ".join(PAIRS))
    given = parser.parse_args(words)
    if unknown := set(given.pairs) - PAIRS.keys():
        parser.error(f"unknown pair {', '.join(sorted(unknown))}: must be of {', '.join(PAIRS)}")
    columns = ("pair", "without, s", "with, s", "ratio", "without, MB", "with, MB", "ratio", "allowed")
    print(f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}", flush=True)
    kept = True
    for name in given.pairs or PAIRS:
        sides = measured(PAIRS[name], given.repeats)
        seconds = [median(each.seconds for each in side) for side in sides]
        peaks = [median(each.peak_bytes for each in side) / 1e6 for side in sides]
        ratios = seconds[1] / seconds[0], peaks[1] / peaks[0]
        cells = [f"{seconds[0]:.1f}", f"{seconds[1]:.1f}", f"{ratios[0]:.2f}", *(f"{each:.0f}" for each in peaks)]
        print(f"| {' | '.join((name, *cells, f'{ratios[1]:.2f}', f'{PAIRS[name].allowed:g}'))} |", flush=True)
        kept &= max(ratios) <= PAIRS[name].allowed
    return 0 if kept else CHECK_FAILED


if __name__ == "__main__":
    raise SystemExit(main())
