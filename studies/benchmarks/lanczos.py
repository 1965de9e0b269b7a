"""Block against single-vector Lanczos on the pencils that Antinode solves: `python -m studies.benchmarks.lanczos`.

The same modes of a band, counted, by `solvers.fem.block_lanczos` and by ARPACK (scipy's `eigsh`), both with the same factor;
then all modes of wide windows of a plate of six rows, at most so many from one shift.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from pipeline.case.model import Case, load_case
from pipeline.logs import TerminalLog
from pipeline.models import parts
from pipeline.paths import STUDIES
from pipeline.quantity import KHZ
from solvers.fem import block_lanczos
from solvers.fem.eigen import PlainPencil, modes_in_band
from studies.benchmarks import timed

CASE = STUDIES / "three-rows.toml"
BAND_HZ = (25e3, 45e3)
REPEATS = 3
WIDE_HZ, WIDEST = ((20e3, 60e3), (10e3, 110e3)), (120, 300)


def _case(*overrides: str) -> Case:
    return load_case(CASE, overrides)


def _pencil(part: str, symmetry: str, *overrides: str) -> PlainPencil:
    model = parts.build(_case(*overrides), part, BAND_HZ[1], TerminalLog(quiet=True), [])
    return model.pencil(symmetry)


PROBLEMS: dict[str, tuple[Callable[[], PlainPencil], tuple[float, float]]] = {
    "lone pillar": (lambda: _pencil("pillar", "SS", "solve.accuracy=0.003"), (0.0, 900e3)),
    "bare zone": (lambda: _pencil("zone", "SS", "solve.accuracy=0.003"), (0.0, 250e3)),
    "assembled plate": (lambda: _pencil("plate", "SS", "solve.accuracy=0.01"), BAND_HZ),
    "solid plate": (
        lambda: _pencil(
            "plate", "SS", "solve.model=solid", "solve.accuracy=0.03", "array.rows=1", "array.extension_mm=0"
        ),
        BAND_HZ,
    ),
}


def slices() -> None:
    """Print a line a window and a width of slices."""
    print(f"{'window, kHz':>14} {'dofs':>8} {'modes':>5} {'a shift':>8} {'factorisations':>14} {'time':>8}")
    pencil = _pencil("plate", "SS", "solve.accuracy=0.003", "array.rows=6")
    most_before = block_lanczos.MAX_SLICE
    for low, high in WIDE_HZ:
        for block_lanczos.MAX_SLICE in WIDEST:
            solve = partial(modes_in_band, pencil, low, high)
            modes, taken = solve(), timed(solve, 1)
            window = f"{low / KHZ:g} to {high / KHZ:g}"
            figures = f"{block_lanczos.MAX_SLICE:8} {modes.factorisations:14} {taken:6.1f} s"
            print(f"{window:>14} {pencil.dof:8} {len(modes.frequency_hz):5} {figures}", flush=True)
    block_lanczos.MAX_SLICE = most_before


def main() -> None:
    """Print a line a problem."""
    print(f"{'problem':14} {'dofs':>8} {'modes':>5} {'block':>8} {'single':>8} {'ratio':>6} {'largest difference':>19}")
    bytes_before = block_lanczos.BYTES
    for name, (make, band_hz) in PROBLEMS.items():
        pencil = make()
        solve = partial(modes_in_band, pencil, *band_hz)
        ours, block = solve(), timed(solve, REPEATS)
        block_lanczos.BYTES = 0.0
        theirs, single = solve(), timed(solve, REPEATS)
        block_lanczos.BYTES = bytes_before
        apart = float(np.abs(ours.frequency_hz / theirs.frequency_hz - 1.0).max())
        count = len(ours.frequency_hz)
        print(f"{name:14} {pencil.dof:8} {count:5} {block:6.2f} s {single:6.2f} s {single / block:6.2f} {apart:19.1e}")
    slices()


if __name__ == "__main__":
    main()
