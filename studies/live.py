"""How far the parametric cell's bands lie from plain reductions of random designs, and the ratio of times.

    python -m studies.live [DESIGNS] [CASE]

Each design is solved once from the bases and once as `antinode bands` would at accuracy 0.001, in one process, one after
the other. The bar counted is that of the bases and the mesh's together.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, replace

import numpy as np

from geometry.elements import FloatArray
from pipeline.case.model import Case, load_case
from pipeline.explore.answer import Explorer, Scene
from pipeline.explore.cell_model import BANDS, MESH_ERROR, CellModel, cell_model
from pipeline.logs import TerminalLog
from pipeline.models.unit_cell import lattice_model
from pipeline.paths import STUDIES
from pipeline.planning.model_choice import cell_model_choice
from pipeline.search.fidelity import WarningLog
from solvers.parametric.affine import Sizes, as_sizes
from solvers.parametric.bands import FLAT, bands

ACCURACY, GOAL = 0.001, 0.003
EVERY = 5  # wavevectors that the plain reduction solves


@dataclass(frozen=True)
class Compared:
    """One design: relative differences (k, bands) from the plain reduction, the bar (bands,), seconds of each."""

    sizes: Sizes
    difference: FloatArray
    bar: FloatArray
    live_s: float
    plain_s: float


def at(case: Case, sizes: Sizes) -> Case:
    """The case with another cell, its bands to be had within ACCURACY."""
    design, (t, h, a, p) = case.design, sizes
    assert design.pillar is not None
    pillar = replace(design.pillar, base_m=a, tip_m=a, height_m=h)
    design = replace(design, thickness_m=t, pillar=pillar, pitch_x_m=p, pitch_y_m=p)
    return replace(
        case, design=design, solve=replace(case.solve, accuracy=ACCURACY), bands=replace(case.bands, count=BANDS)
    )


def compare(case: Case, model: CellModel, sizes: Sizes) -> Compared:
    """Both models of one design."""
    begin = time.perf_counter()
    found = bands(model.cell, model.bases, sizes)
    live_s = time.perf_counter() - begin
    chosen = model.bases.fractions[::EVERY] * np.pi / sizes[3]
    begin = time.perf_counter()
    varied = at(case, sizes)
    lattice = lattice_model(varied, cell_model_choice(varied), chosen[[0, 5, 10]], WarningLog(), []).lattice
    reduced_s = time.perf_counter() - begin
    wanted = np.array([lattice.frequencies(k, BANDS) for k in chosen])
    plain_s = reduced_s + EVERY * (time.perf_counter() - begin - reduced_s)
    moving = wanted > FLAT * wanted.max()
    difference = np.where(moving, found.frequency_hz[::EVERY] / np.where(moving, wanted, 1.0) - 1.0, 0.0)
    return Compared(sizes, difference, found.error + MESH_ERROR, live_s, plain_s)


def main(count: int, path: str) -> int:
    """Print a line a design, then what holds."""
    case = load_case(path)
    model = cell_model(case, TerminalLog())
    rng = np.random.default_rng(7)
    all_of_them = []
    for sizes in as_sizes(model.cell.box.sample(rng.random((count, 4)))):
        one = compare(case, model, sizes)
        all_of_them.append(one)
        worst = np.abs(one.difference).max()
        text = ", ".join(f"{1e3 * size:.2f}" for size in sizes)
        outside = int((np.abs(one.difference) > one.bar + ACCURACY).sum())
        print(f"{text} mm: {worst:.3%} at most, bar {one.bar.max():.3%}, {outside} of {one.difference.size} outside, "
              f"{one.plain_s / one.live_s:.0f} times as fast", flush=True)  # fmt: skip
    good = sum(np.abs(one.difference).max() <= GOAL for one in all_of_them)
    outside = sum(int((np.abs(one.difference) > one.bar + ACCURACY).sum()) for one in all_of_them)
    values = sum(one.difference.size for one in all_of_them)
    ratio, live_s = (
        np.median(column) for column in zip(*((o.plain_s / o.live_s, o.live_s) for o in all_of_them), strict=True)
    )
    print(f"{good} of {count} designs within {GOAL:.1%}")
    print(f"{outside} of {values} values beyond bar and accuracy together")
    print(f"{ratio:.0f} times as fast as a plain reduction, {live_s:.3f} s (medians)")
    _whole(Explorer(Scene(case, {}, ()), model), case)
    return 0


def _whole(explorer: Explorer, case: Case) -> None:
    """The page's whole answer of the case itself, after one to warm up."""
    assert case.design.pillar is not None
    explorer.document(case, {})
    begin = time.perf_counter()
    explorer.document(case, {})
    print(f"bands, decay and column together: {time.perf_counter() - begin:.3f} s")


if __name__ == "__main__":
    words = sys.argv[1:]
    raise SystemExit(
        main(int(words[0]) if words else 100, words[1] if len(words) > 1 else str(STUDIES / "three-rows.toml"))
    )
