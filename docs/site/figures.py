"""Figures of the explanations: `python docs/site/figures.py NAME [ENDING]` writes NAME.svg or NAME.ENDING into this folder."""

from __future__ import annotations

import sys
import warnings
from typing import Any

import numpy as np
from matplotlib.patches import Rectangle

import antinode
from geometry.hex.scenes import HexSettings
from geometry.tiling import lattice_panel
from pipeline.plots import style
from pipeline.report.text import band_of_rows
from solvers.measures.confinement import CONFINED_DB
from solvers.plates.assembled import Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.lattice import ReducedLattice

PLATE = "examples/small.toml"
ON_A_PHONE_IN = 4.2  # width of the home page's figure, whose letters stay readable on 390 pixels


def superelement(figure: Any) -> None:
    """From one cell to the lattice and to the plate."""
    axes = figure.subplots(1, 3)
    _cell(axes[0], 0.0, 0.0, marked=True)
    axes[0].set_title("one cell, reduced once")
    for x in range(4):
        for y in range(4):
            _cell(axes[1], x, y)
    axes[1].annotate("", (4.4, 2.0), (3.6, 2.0), arrowprops={"arrowstyle": "->", "color": style.VERMILION})
    axes[1].text(4.5, 2.0, r"$e^{-\mathrm{i}k_xa}$", color=style.VERMILION, va="center")
    axes[1].set_title("infinite array: a phase")
    for x in range(6):
        axes[2].add_patch(Rectangle((x, 2), 1, 2, facecolor=style.GREEN, alpha=0.25, edgecolor=style.GREY))
        for y in (0, 1, 4, 5):
            _cell(axes[2], x, y)
    axes[2].set_title("plate: shared sides")
    for each, size in zip(axes, (1.0, 5.3, 6.0), strict=True):
        each.set(xlim=(-0.1 * size, 1.1 * size), ylim=(-0.1 * size, 1.1 * size), aspect="equal")
        each.axis("off")


def _cell(axes: Any, x: float, y: float, marked: bool = False) -> None:
    axes.add_patch(Rectangle((x, y), 1, 1, facecolor="none", edgecolor=style.BLUE, lw=2.2 if marked else 0.8))
    axes.add_patch(Rectangle((x + 0.25, y + 0.25), 0.5, 0.5, facecolor=style.ORANGE, edgecolor="none"))
    if marked:
        for grid in np.linspace(0.125, 0.875, 7):
            axes.plot([x + grid, x + grid], [y, y + 1], color=style.GREY, lw=0.4)
            axes.plot([x, x + 1], [y + grid, y + grid], color=style.GREY, lw=0.4)


def superelement_convergence(figure: Any) -> None:
    """Error of the bands at X over the degrees along a side, against the highest degree of the same mesh."""
    design = antinode.load(PLATE).case.design
    at_x = np.array([np.pi / design.pitch_x_m, 0.0])
    mesh = HexSettings(3, 2e-3, 0, pillar_size_m=3.15e-3)
    degrees = (1, 2, 3, 4, 5, 7)
    tones = []
    for degree in degrees:
        settings = ReductionSettings(Interface(degree, 3), 1.5e6, mesh)
        cell = Reductions(design.stack, design.pillar, settings).cell(lattice_panel(design))
        tones.append(ReducedLattice(cell).frequencies(at_x, 5))
    error = np.array(tones[:-1]) / tones[-1] - 1.0
    axes = figure.subplots()
    for band in range(5):
        axes.semilogy(degrees[:-1], np.maximum(error[:, band], 1e-7), "o-", ms=4, label=f"band {band + 1}")
    axes.set(
        xlabel="degree of the polynomials along a side", ylabel="overestimate at X (relative)", xticks=degrees[:-1]
    )
    axes.legend()


def error_bars(figure: Any) -> None:
    """Error of a coarse result, with its error bars."""
    plate = antinode.load(PLATE, bands__points=6, bands__count=4)
    coarse, fine = (plate.with_(accuracy=accuracy).bands() for accuracy in (0.1, 0.003))
    axes, moving = figure.subplots(), fine.frequencies_hz[1:-1] > 1e3
    points = np.arange(1, len(fine.labels) - 1)
    for band, colour in enumerate((style.BLUE, style.ORANGE, style.GREEN, style.VERMILION)):
        at = points[moving[:, band]]
        off = 100.0 * (coarse.frequencies_hz[at, band] / fine.frequencies_hz[at, band] - 1.0)
        bar = 100.0 * coarse.error[at, band]
        axes.errorbar(at + 0.12 * band, off, bar, fmt="o", ms=3, lw=0.8, color=colour, label=f"band {band + 1}")
    axes.axhline(0.0, color=style.GREY, lw=0.8)
    corners = [(at, label) for at, label in enumerate(fine.labels) if label]
    axes.set_xticks([at for at, _ in corners], ["Γ" if label == "G" else str(label) for _, label in corners])
    axes.set(xlabel="wavevector", ylabel="accuracy 0.1 over accuracy 0.003 (%)")
    axes.legend()


def before_and_after(figure: Any) -> None:
    """The same plate without rows and with three: the touch face in the mode that carries most of the target shape."""
    plate = antinode.load("studies/three-rows.toml", accuracy=0.03)
    design = plate.case.design
    bare = plate.with_(rows=0, extension_mm=1e3 * (design.half_span_m - design.width_m / 2.0))
    sides = figure.subplots(1, 2, sharey=True)
    for axes, each, words in zip(sides, (bare, plate), ("no pillars", "three rows on each side"), strict=True):
        modes = each.modes(symmetry=plate.case.target_symmetry)
        number = max(range(len(modes)), key=lambda i: modes[i].strength or 0.0)
        surface = modes.to_pyvista(number)
        face = np.abs(surface.points[:, 2]) < 1e-9
        motion = surface["displacement"][face, 2]
        x, y, _ = 1e3 * surface.points[face].T
        axes.tricontourf(x, y, motion / np.abs(motion).max(), np.linspace(-1.0, 1.0, 41), cmap=style.SIGNED)
        for px, py in 1e3 * each.case.design.pillar_centres():
            axes.add_patch(Rectangle((px - 1.0, py - 1.0), 2.0, 2.0, fill=False, lw=0.5))
        for border in (-500.0 * design.width_m, 500.0 * design.width_m):
            axes.axhline(border, color="black", lw=0.9, ls="--")
        title = f"{words}: {modes[number].confinement_db:.1f} dB at {modes[number].frequency_hz / 1e3:.1f} kHz"
        axes.set(aspect="equal", xlabel="x (mm)", title=title)
    sides[0].set_ylabel("y (mm), the zone between dashes")


def decay_band(figure: Any) -> None:
    """The band around the target mode in which the rows of the reference plate attenuate the zone's flexural waves."""
    plate = antinode.load("studies/three-rows.toml")
    decay, target = plate.attenuation(), plate.modes(symmetry=plate.case.target_symmetry).target
    tone, per_row = decay.decay.T
    axes = figure.subplots()
    axes.plot(tone / 1e3, decay.rows * per_row, color=style.BLUE)
    axes.axhline(CONFINED_DB, color=style.GREY, lw=0.8, ls="--")
    low, high = np.array(band_of_rows(decay, target.frequency_hz)) / 1e3
    axes.axvspan(
        low,
        high,
        color=style.GREEN,
        alpha=0.2,
        lw=0,
        label=f"{decay.rows} rows take at least {CONFINED_DB:g} dB: {low:.1f} to {high:.1f} kHz",
    )
    mode = f"target mode: {target.frequency_hz / 1e3:.1f} kHz"
    axes.axvline(target.frequency_hz / 1e3, color=style.VERMILION, label=mode)
    axes.set(
        xlabel="frequency (kHz)", ylabel=f"attenuation by {decay.rows} rows (dB)", xlim=(tone[0] / 1e3, tone[-1] / 1e3)
    )
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)


def main(name: str, ending: str = "svg") -> None:
    """Draw a figure into NAME.svg, or a file of another ending."""
    warnings.simplefilter("ignore", antinode.AntinodeWarning)
    with style.style():
        low = name in ("superelement", "decay-band")
        figure = style.new_figure(ON_A_PHONE_IN if name == "decay-band" else style.WIDTH_IN, 2.6 if low else 3.6)
        globals()[name.replace("-", "_")](figure)
        figure.savefig(f"{name}.{ending}", bbox_inches="tight", dpi=150)


if __name__ == "__main__":
    main(*sys.argv[1:])
