"""Factorisations of this machine on matrices of real problems: `python -m studies.benchmarks.factorisations`.

K - sigma M of the quarter plate with pillars (hexahedra of order 3, 32 kHz) in four sizes, and of a cube of quadratic
tetrahedra, the bulkiest solid there is.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from geometry.hex.boxes import hex_mesh, plate_boxes
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS
from geometry.mesh import split_hexahedra
from solvers.fem.factor import Factoriser
from solvers.fem.solid import SolidModel
from solvers.machine import factorisations, peak_bytes, resident_bytes
from studies.benchmarks import ran, timed
from studies.extremes import box

MODULE = "studies.benchmarks.factorisations"
ALUMINIUM = MATERIALS["aluminium"]
PILLAR = Pillar("square", 2e-3, 2e-3, 6.3e-3, ALUMINIUM)
SHIFT_HZ = 32e3
LONG = 30_000  # degrees of freedom above which a run is repeated less


def _shifted(model: SolidModel, symmetry: str | None) -> sp.csc_array:
    pencil = model.pencil(symmetry)
    return sp.csc_array(pencil.stiffness - pencil.scale.eigenvalue(SHIFT_HZ) * pencil.mass)


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


PROBLEMS: dict[str, Callable[[], sp.csc_array]] = {
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


def main() -> None:
    """Print the table; times in s, memory in MB over interpreter and matrix."""
    print(
        "first: analysis, factor and its check; next: the same pattern again; ten: ten solves, one by one and at once"
    )
    print(
        f"{'problem':11} {'DOFs':>8} {'with':8} {'first':>8} {'next':>8} {'ten':>7} {'at once':>7} "
        f"{'foreseen':>8} {'peak':>7} {'held':>7} {'negative':>8}"
    )
    with tempfile.TemporaryDirectory() as folder:
        for name, problem in PROBLEMS.items():
            matrix, path = problem(), Path(folder, "matrix.npz")
            sp.save_npz(path, matrix, compressed=False)
            for backend in factorisations():
                print(f"{name:11} {matrix.shape[0]:8d} {backend:8} {_figures(path, backend)}", flush=True)


def _figures(path: Path, backend: str) -> str:
    """The rest of a line, or why there is none."""
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
        main()
