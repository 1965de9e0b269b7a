"""Cold `antinode bands` at several accuracies: wall time, peak memory, and true errors at G, X and M next to the error bar.

`python -m studies.benchmarks.bands` compares with the finest accuracy, computed in the same run, and with the frequencies that
another program's converged meshes gave, printed to five digits. Each command is a process of its own, without cached cells.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import dataclass

import numpy as np

from geometry.elements import FloatArray
from studies.benchmarks import Ended, ran

CASE = "studies/three-rows.toml"
FINEST, ACCURACIES = 0.0005, (0.01, 0.003, 0.001, 0.0007)
SLOWEST = 1e-3  # of the highest frequency: slower waves are rigid-body modes
OTHERS_HIGH = 2e-4  # the other program's own error, from above
OTHERS_HZ = {("G", 4): 39.67e3, ("G", 6): 108.45e3, ("G", 7): 175.83e3, ("G", 9): 233.28e3,
             ("M", 1): 32.54e3, ("M", 3): 108.13e3, ("M", 4): 158.80e3, ("M", 6): 163.09e3}  # fmt: skip


@dataclass(frozen=True)
class Run:
    """Outcome of a command, and by corner its frequencies and their error bars (half-widths), Hz."""

    cold: Ended
    frequencies_hz: dict[str, FloatArray]
    bars: dict[str, FloatArray]


def run(accuracy: float) -> Run:
    """Measure a fresh process from an empty folder of results; read its figures from another one with the stored cell."""
    command = ("-m", "antinode", "bands", CASE, "--quiet", "--set", f"solve.accuracy={accuracy}")
    with tempfile.TemporaryDirectory(prefix="antinode-results-") as results:
        own = {"ANTINODE_RESULTS": results}
        cold = ran(*command, environment=own)
        document = json.loads(ran(*command, "--json", "-", environment=own).printed)
    corners = {point["label"]: point for point in document["points"] if point["label"]}
    frequencies, bars = (
        {label: np.array(point[name], dtype=float) for label, point in corners.items()}
        for name in ("frequencies_hz", "error")
    )
    return Run(cold, frequencies, bars)


def errors(own_run: Run, finest: Run) -> tuple[float, float, float]:
    """Largest relative differences from the finest run and from the other program, and the largest bar."""
    ours, theirs, bars = (
        np.concatenate(list(of.values())) for of in (own_run.frequencies_hz, finest.frequencies_hz, own_run.bars)
    )
    moving = theirs > SLOWEST * theirs.max()
    others = [
        own_run.frequencies_hz[label][band - 1] / (known * (1.0 - OTHERS_HIGH)) - 1.0
        for (label, band), known in OTHERS_HZ.items()
    ]
    return (
        float(np.abs(ours[moving] / theirs[moving] - 1.0).max()),
        float(np.abs(others).max()),
        float(bars[moving].max()),
    )


def main() -> None:
    """Print a Markdown table with one row per accuracy."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("accuracies", nargs="*", type=float, default=ACCURACIES)
    given = parser.parse_args()
    finest = run(FINEST)
    columns = ("accuracy", "wall time, s", "over the finest", "peak, MB", "largest difference from the finest")
    print(f"| {' | '.join((*columns, 'from another program', 'largest bar'))} |")
    print(f"|{'---|' * 7}", flush=True)
    for accuracy in (*given.accuracies, FINEST):
        one = finest if accuracy == FINEST else run(accuracy)
        own, others, bar = errors(one, finest)
        ratio = one.cold.wall / finest.cold.wall
        print(
            f"| {accuracy} | {one.cold.wall:.1f} | {ratio:.3f} | {one.cold.peak_bytes / 1e6:.0f} "
            f"| {own:.3%} | {others:.3%} | {bar:.3%} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
