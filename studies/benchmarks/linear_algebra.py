"""Factorisations and Lanczos on matrices of real problems: `python -m studies.benchmarks.linear_algebra`.

K - sigma M of the quarter plate with pillars (hexahedra of order 3, 32 kHz) in four sizes, and of a cube of quadratic
tetrahedra, the bulkiest solid there is.

The same modes of a band, counted, by `solvers.fem.block_lanczos` and by ARPACK (scipy's `eigsh`), both with the same factor;
then all modes of wide windows of a plate of six rows, with a limited number from one shift.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from geometry.hex.boxes import hex_mesh, plate_boxes
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS
from geometry.mesh import split_hexahedra
from pipeline.case.model import load_case
from pipeline.logs import TerminalLog
from pipeline.models import parts
from pipeline.paths import STUDIES
from pipeline.quantity import KHZ
from solvers.fem import block_lanczos
from solvers.fem.eigen import PlainPencil, modes_in_band
from solvers.fem.factor import Factoriser
from solvers.fem.solid import SolidModel
from solvers.machine import factorisations, peak_bytes, resident_bytes
from studies.benchmarks import ran, timed
from studies.extremes import box

MODULE = "studies.benchmarks.linear_algebra"
ALUMINIUM = MATERIALS["aluminium"]
PILLAR = Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM)
SHIFT_HZ = 32e3
LONG = 30_000  # degrees of freedom above which a run is repeated less

CASE = STUDIES / "three-rows.toml"
BAND_HZ = (25e3, 45e3)
REPEATS = 3
WIDE_HZ, WIDEST = ((20e3, 60e3), (10e3, 110e3)), (120, 300)


def plate(length_m: float, rows: int, order: int, size_m: float) -> sp.csc_array:
    """One symmetry class of a plate 20 mm wide with rows of pillars on both sides."""
    design = Design(length_m, 20e-3, 2e-3, 8, ALUMINIUM, PILLAR, 4e-3, 4e-3, rows, 0.0)
    settings = HexSettings(order, size_m, 0, pillar_size_m=1.6 * size_m)
    mesh = hex_mesh(plate_boxes(design, settings), order)
    return _shifted(SolidModel(mesh, {"plate": ALUMINIUM, "pillar": ALUMINIUM}, (), True), "SS")


def cube(cuts: int) -> sp.csc_array:
    """A free cube of quadratic tetrahedra."""
    mesh = split_hexahedra(box((1e-2,) * 3, (cuts,) * 3, 2))
    return _shifted(SolidModel(mesh, {"body": ALUMINIUM}, (), False), None)


def _shifted(model: SolidModel, symmetry: str | None) -> sp.csc_array:
    pencil = model.pencil(symmetry)
    return sp.csc_array(pencil.stiffness - pencil.scale.eigenvalue(SHIFT_HZ) * pencil.mass)


MATRICES: dict[str, Callable[[], sp.csc_array]] = {
    "plate 1k": lambda: plate(20e-3, 1, 2, 4e-3),
    "plate 10k": lambda: plate(60e-3, 1, 3, 4e-3),
    "plate 60k": lambda: plate(115.5e-3, 3, 3, 2e-3),
    "plate 200k": lambda: plate(115.5e-3, 3, 3, 1.25e-3),
    "cube 50k": lambda: cube(12),
}


def one(path: Path, backend: str) -> dict[str, Any]:
    """Times, memory and inertia of one factorisation in this process, each factor probed as a solve does it."""
    matrix = sp.csc_array(sp.load_npz(path))
    right = np.cos(np.arange(matrix.shape[0], dtype=float))
    repeats = 2 if matrix.shape[0] > LONG else 5
    before = resident_bytes()
    factoriser = Factoriser(backend)
    factor = factoriser(matrix)
    negative, peak = factor.negative, peak_bytes() - before
    solves = timed(lambda: [factor.solve(right) for _ in range(10)], repeats)
    many = timed(lambda: factor.solve(np.tile(right[:, None], 10)), repeats)
    solution = factor.solve(right)
    entry = {"foreseen_bytes": factor.foreseen_bytes, "held_bytes": factor.memory_bytes}
    factor.free()
    return entry | {
        "first_s": timed(lambda: Factoriser(backend)(matrix).free(), repeats),
        "next_s": timed(lambda: factoriser(matrix).free(), repeats),
        "ten_solves_s": solves,
        "block_of_ten_s": many,
        "peak_bytes": peak,
        "negative": negative,
        "residual": float(np.linalg.norm(matrix @ solution - right) / np.linalg.norm(right)),
    }


def compare_factorisations() -> None:
    """Print the table; times in s, memory in MB over interpreter and matrix."""
    print(
        "first: analysis, factor and its check; next: the same pattern again; ten: ten solves, one by one and at once"
    )
    print(
        f"{'problem':11} {'DOFs':>8} {'with':8} {'first':>8} {'next':>8} {'ten':>7} {'at once':>7} "
        f"{'estimate':>8} {'peak':>7} {'held':>7} {'negative':>8}"
    )
    with tempfile.TemporaryDirectory() as folder:
        for name, problem in MATRICES.items():
            matrix, path = problem(), Path(folder, "matrix.npz")
            sp.save_npz(path, matrix, compressed=False)
            for backend in factorisations():
                print(f"{name:11} {matrix.shape[0]:8d} {backend:8} {_figures(path, backend)}", flush=True)


def _pencil(part: str, symmetry: str, *overrides: str) -> PlainPencil:
    model = parts.build(load_case(CASE, overrides), part, BAND_HZ[1], TerminalLog(quiet=True), [])
    return model.pencil(symmetry)


PENCILS: dict[str, tuple[Callable[[], PlainPencil], tuple[float, float]]] = {
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
    """Print one line per window and width of slices."""
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


def compare_lanczos() -> None:
    """Print one line per problem."""
    print(f"{'problem':14} {'dofs':>8} {'modes':>5} {'block':>8} {'single':>8} {'ratio':>6} {'largest difference':>19}")
    bytes_before = block_lanczos.BYTES
    for name, (make, band_hz) in PENCILS.items():
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


def _figures(path: Path, backend: str) -> str:
    """The rest of a line, or the reason why it is missing."""
    try:
        run = json.loads(ran("-m", MODULE, str(path), backend).printed.splitlines()[-1])
    except RuntimeError as fault:
        return str(fault)
    megabytes = [run[key] / 1e6 for key in ("foreseen_bytes", "peak_bytes", "held_bytes")]
    return (
        f"{run['first_s']:8.3f} {run['next_s']:8.3f} {run['ten_solves_s']:7.3f} {run['block_of_ten_s']:7.3f} "
        f"{megabytes[0]:8.0f} {megabytes[1]:7.0f} {megabytes[2]:7.0f} {run['negative']:8d}"
    )


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(json.dumps(one(Path(sys.argv[1]), sys.argv[2])))
    else:
        compare_factorisations()
        compare_lanczos()
