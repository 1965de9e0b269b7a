"""Bands of a user's own cell by `antinode bands --mesh-file` and by scikit-fem with scipy, on one mesh, in one run.

`python -m studies.benchmarks.own_cell` prints seconds of wall time and of the processor, the largest memory, their ratios, and
the largest difference of a frequency. Both have the same complete quadratic hexahedra, the same wavevectors and as many bands.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from geometry.formats.neutral import VOLUME, local_nodes
from geometry.hex.boxes import Boxes, hex_mesh
from geometry.lattice import Lattice
from geometry.mesh import Mesh
from pipeline.quantity import percent
from studies.benchmarks import Ended, ran

PITCH_M, THICK_M = 10e-3, 2e-3
CASE = """name = "own-cell"
[material]
young_GPa = 70.0
poisson = 0.33
density_kg_m3 = 2700.0
[array]
pitch_mm = 10.0
[bands]
points = {points}
count = {count}
"""
MATERIAL = {"young_pa": 70e9, "poisson": 0.33, "density_kg_m3": 2700.0}
ONE_THREAD = {"OMP_NUM_THREADS": "1"}  # a second one takes processor time and hardly shortens either program's
MOVING_HZ = 1.0  # slower waves are translations, whose frequency is rounding
COLUMNS = ("program", "degrees of freedom", "wall time, s", "processor, s", "peak memory, MB")


def cell(intervals: int, order: int) -> Mesh:
    """Mesh a plate cell by boxes: a square hole, half as wide as the cell, in its middle."""
    across, through = np.linspace(0.0, PITCH_M, 4 * intervals + 1), np.linspace(0.0, THICK_M, intervals + 1)
    middle = (across[1:] + across[:-1]) / 2.0 / PITCH_M - 0.5
    hole = (np.abs(middle) < 0.25)[:, None] & (np.abs(middle) < 0.25)[None, :]
    region = np.repeat(np.where(hole, -1, 0)[:, :, None], intervals, axis=2)
    return hex_mesh(Boxes(across, across, through, region, ("plate",)), order)


def written(intervals: int, file: Path) -> None:
    """Write the mesh with complete quadratic hexahedra as a Gmsh file in m."""
    import meshio

    mesh = cell(intervals, 2)
    blocks = [(VOLUME[mesh.kind, mesh.order], mesh.cells[:, local_nodes(mesh.kind, mesh.order)])]
    meshio.write(file, meshio.Mesh(mesh.nodes, blocks), file_format="gmsh22")


def by_scikit(intervals: int, points: int, count: int) -> dict[str, Any]:
    """Solve the bands by scikit-fem's matrices with a phase between opposite sides, and by ARPACK at each wavevector."""
    import skfem

    from studies.benchmarks.peers.hexahedra import CORNERS, assembled, bloch

    mesh = cell(intervals, 1)
    grid = skfem.MeshHex(np.ascontiguousarray(mesh.nodes.T), np.ascontiguousarray(mesh.cells[:, CORNERS].T))
    basis = skfem.Basis(grid, skfem.ElementVector(skfem.ElementHex2()), intorder=4)
    at, dof = bloch(basis, *assembled(basis, MATERIAL), PITCH_M, count)
    path = Lattice.of_rows(PITCH_M, PITCH_M).path("GXMG", points)
    return {"frequencies_hz": [at(k) for k in path.wavevectors], "dof": dof}


def compared(intervals: int, points: int, count: int) -> tuple[dict[str, tuple[int, Ended]], float]:
    """Run both programs, each in a fresh process; return unknowns and costs by program, and the largest relative difference."""
    with tempfile.TemporaryDirectory() as folder:
        case, file = Path(folder, "case.toml"), Path(folder, "cell.msh")
        case.write_text(CASE.format(points=points, count=count))
        written(intervals, file)
        question = ("bands", str(case), "--mesh-file", str(file), "--json", "-", "--quiet")
        own = ran("-m", "antinode", *question, environment=ONE_THREAD)
        words = ("-m", __spec__.name, "--scikit", *map(str, (intervals, points, count)))
        other = ran(*words, environment=ONE_THREAD)
    ours, theirs = json.loads(own.printed), json.loads(other.printed)
    one = np.array([point["computed_hz"] for point in ours["points"]])
    two = np.array(theirs["frequencies_hz"])
    moving = two > MOVING_HZ
    apart = float(np.abs(one[moving] / two[moving] - 1.0).max())
    return {"Antinode": (ours["dof"], own), "scikit-fem": (theirs["dof"], other)}, apart


def main() -> None:
    """Print a Markdown table of both programs and their ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--intervals", type=int, default=6, help="elements through the thickness; four times as many across"
    )
    parser.add_argument("--points", type=int, default=6, help="intervals per segment of the path GXMG")
    parser.add_argument("--count", type=int, default=8, help="number of bands")
    parser.add_argument("--scikit", nargs=3, type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.scikit:
        print(json.dumps(by_scikit(*given.scikit)))
        return
    found, apart = compared(given.intervals, given.points, given.count)
    print(f"{3 * given.points + 1} wavevectors, {given.count} bands; times of a machine that others may use, too\n")
    print(f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
    for name, (dof, cost) in found.items():
        print(f"| {name} | {dof} | {cost.wall:.1f} | {cost.seconds:.1f} | {cost.peak_bytes / 1e6:.0f} |")
    ours, theirs = (cost for _, cost in found.values())
    print(f"\nprocessor time: scikit-fem takes {theirs.seconds / ours.seconds:.2f} times as long")
    print(f"memory: Antinode takes {ours.peak_bytes / theirs.peak_bytes:.2f} times as much")
    print(f"largest relative difference of a frequency: {percent(apart)} ({apart:.1e})")


if __name__ == "__main__":
    main()
