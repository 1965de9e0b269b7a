"""Stated error bars against true errors on scenes drawn at random: `python -m studies.error_bars` writes docs/error-bars.md.

Plates and pillars of every library material and thicknesses from 0.5 to 5 mm: cells on the first mesh level against the
finest, both with the same reduction; lone pillars and zones at accuracy 0.01 against 0.0005.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from rich.progress import track

from geometry.elements import FloatArray
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS, Material
from pipeline.analysis.modes import Request, solve_modes
from pipeline.case.model import Case, load_case
from pipeline.logs import TerminalLog
from pipeline.paths import ROOT
from pipeline.planning import mesh_rules
from pipeline.records.store import write_atomic
from solvers.superelement.build import Reductions, ReductionSettings, lattice_panel
from solvers.superelement.interface import Interface
from solvers.superelement.lattice import Lattice
from solvers.superelement.lattice_error import mesh_error

PAGE, PICTURE = ROOT / "docs" / "error-bars.md", ROOT / "docs" / "pictures" / "error-bars.svg"
CASE = Path(__file__).with_name("three-rows.toml")
SEED, BANDS = 7, 10
TUNGSTEN = Material("tungsten", 400e9, 19300.0, 0.28)  # the hardest contrast, beside the library's materials
ROUGHLY, FINELY = 0.01, 0.0005  # accuracies of lone parts
QUIET = TerminalLog(True)


@dataclass(frozen=True)
class Compared:
    """Relative differences of a scene's frequencies from the finer computation, beside the sum of both bars, (k,) each."""

    part: str
    scene: str
    error: FloatArray
    bar: FloatArray

    @property
    def within(self) -> float:
        """Share of the frequencies within the bar."""
        return float((self.error <= self.bar).mean())


def designs(count: int, seed: int = SEED) -> Iterator[Design]:
    """Designs drawn at random, the same each time: materials, thickness 0.5 to 5 mm, stubby and slender pillars."""
    draw, base = np.random.default_rng(seed), load_case(CASE).design
    known = [*MATERIALS.values(), TUNGSTEN]
    for _ in range(count):
        plate, pillar = (known[int(draw.integers(len(known)))] for _ in range(2))
        thickness = draw.uniform(0.5e-3, 5e-3)
        side = thickness * draw.uniform(0.5, 1.5)
        pitch, height = side * draw.uniform(1.3, 4.0), side * draw.uniform(0.6, 5.0)
        yield replace(
            base,
            thickness_m=thickness,
            material=plate,
            pillar=Pillar("square", side, side, height, pillar),
            pitch_x_m=pitch,
            pitch_y_m=pitch,
            length_m=thickness * draw.uniform(40.0, 60.0),
            width_m=thickness * draw.uniform(8.0, 12.0),
            nodal_lines=int(draw.integers(3, 6)),
        )


def described(design: Design) -> str:
    """A scene in a line."""
    assert design.pillar
    sizes = (design.thickness_m, design.pillar.base_m, design.pillar.height_m, design.pitch_x_m)
    plate, side, height, pitch = (f"{1e3 * size:.2f}" for size in sizes)
    return f"{design.material.name} {plate} mm, {design.pillar.material.name} {side} x {height} mm, pitch {pitch} mm"


def of_cells(design: Design) -> Compared:
    """Ten bands at G, X, M and between, on the first mesh level and on the finest."""
    levels = list(mesh_rules.CELL_LEVELS.values())
    (rough, bar), (fine, own) = (_bands(design, level) for level in (levels[0], levels[-1]))
    return Compared("cell", described(design), np.abs(rough / fine - 1.0), bar + own)


def _bands(design: Design, level: mesh_rules.MeshLevel) -> tuple[FloatArray, FloatArray]:
    """Frequencies above those of rigid-body waves, and the half-widths of their bars by the mesh."""
    along = 4 if design.pitch_x_m <= 2.5 * design.thickness_m else 5
    top_hz = mesh_rules.lattice_reduction(design, 0.03).top_hz
    settings = ReductionSettings(Interface(along, 3), top_hz, mesh_rules.cell_mesh(design, level))
    lattice = Lattice(
        Reductions(design.thickness_m, design.material, design.pillar, settings).cell(lattice_panel(design))
    )
    edge, tones, bars = np.pi / design.pitch_x_m, [], []
    for k in ((0.0, 0.0), (edge, 0.0), (edge, edge), (0.37 * edge, 0.61 * edge)):
        waves = lattice.waves(np.array(k), BANDS)
        moving = waves.frequency_hz > 1e-3 * waves.frequency_hz[-1]
        tones.append(waves.frequency_hz[moving])
        bars.append(mesh_error(lattice.cell, waves).half_width[moving])
    return np.concatenate(tones), np.concatenate(bars)


def of_part(part: str, design: Design) -> Compared:
    """The lowest modes of a lone part at two accuracies."""
    (rough, bar), (fine, own) = (_modes(part, design, accuracy) for accuracy in (ROUGHLY, FINELY))
    return Compared(part, described(design), np.abs(rough / fine - 1.0), bar + own)


def _modes(part: str, design: Design, accuracy: float) -> tuple[FloatArray, FloatArray]:
    case: Case = load_case(CASE, [f"solve.accuracy={accuracy}"])
    result = solve_modes(replace(case, design=design), Request(part, near_hz=0.0, count=6), QUIET)
    return (
        np.array([row.frequency_hz for row in result.rows[:6]]),
        np.array([row.error if row.error is not None else np.nan for row in result.rows[:6]]),
    )


def compare(cells: int, pillars: int, zones: int) -> list[Compared]:
    """Every scene of every part, a progress bar meanwhile."""
    wanted = [("cell", d) for d in designs(cells)] + [("pillar", d) for d in designs(pillars)]
    wanted += [("zone", d) for d in designs(zones)]
    return [
        of_cells(design) if part == "cell" else of_part(part, design)
        for part, design in track(wanted, description="scenes")
    ]


def page(results: list[Compared]) -> str:
    """The page: what holds, part by part, and every scene."""
    lines = [
        "# Error bars against true errors",
        "",
        "Written by `python -m studies.error_bars`. Scenes are drawn at random over all library materials, thicknesses from",
        "0.5 to 5 mm, stubby and slender pillars. Each frequency is compared with a finer computation; the bar is the sum of",
        "both stated ones. A bar too wide is a fault, too: the last column tells how many times the true error it is.",
        "",
        "![Stated bar over true error of every frequency](pictures/error-bars.svg)",
        "",
        "| part | frequencies | within the bar | largest error over bar | median bar over error |",
        "|---|---|---|---|---|",
    ]
    for part in dict.fromkeys(result.part for result in results):
        lines.append(_row(part, [result for result in results if result.part == part]))
    lines += ["", "| part | scene | largest error | largest bar | within |", "|---|---|---|---|---|"]
    lines += [f"| {r.part} | {r.scene} | {r.error.max():.3%} | {r.bar.max():.3%} | {r.within:.0%} |" for r in results]
    return "\n".join(lines) + "\n"


def _row(part: str, results: list[Compared]) -> str:
    error, bar = (np.concatenate([getattr(result, name) for result in results]) for name in ("error", "bar"))
    return (
        f"| {part} | {len(error)} | {(error <= bar).mean():.1%} | {(error / bar).max():.2f} | "
        f"{np.median(bar / np.maximum(error, 1e-9)):.1f} |"
    )


def draw(results: list[Compared], path: Path) -> None:
    """Stated bar over true error; what lies below the line is outside its bar."""
    figure, axes = plt.subplots(figsize=(6.0, 4.5), layout="constrained")
    for part, mark in zip(dict.fromkeys(result.part for result in results), "o^s", strict=False):
        own = [result for result in results if result.part == part]
        error, bar = (np.concatenate([getattr(result, name) for result in own]) for name in ("error", "bar"))
        axes.loglog(100.0 * np.maximum(error, 1e-7), 100.0 * bar, mark, markersize=3, alpha=0.5, label=part)
    ends = np.array([1e-5, 3.0])
    axes.loglog(ends, ends, "k-", linewidth=0.8, label="bar = error")
    axes.set(xlabel="true error (%)", ylabel="stated half-width of the bar (%)")
    axes.legend()
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


def main() -> int:
    """Compute, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, count in (("cells", 12), ("pillars", 34), ("zones", 6)):
        parser.add_argument(f"--{name}", type=int, default=count, help=f"scenes of {name} (default {count})")
    arguments = parser.parse_args()
    results = compare(arguments.cells, arguments.pillars, arguments.zones)
    text = page(results)
    write_atomic(PAGE, text.encode())
    draw(results, PICTURE)
    print(text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
