"""Assembly of K and M against scikit-fem's vector elasticity on the same mesh: `python -m studies.benchmarks.assembly`.

Both integrate by rules of the same degree: 4 for quadratic tetrahedra, 5 an axis for 27-node hexahedra (three points).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from typing import Any

import numpy as np

from geometry.materials import MATERIALS
from geometry.mesh import Mesh
from pipeline.batch.peak_memory import peak_bytes, resident_bytes
from solvers.fem.assembly import Scale, assemble
from studies.benchmarks import in_a_process, timed
from studies.scenes import cube

ALUMINIUM = MATERIALS["aluminium"]
DEGREE = {"tet2": 4, "hex2": 5}
EDGE_M = 1e-2
CUTS = 17  # 3 x 35^3 = 128625 degrees of freedom for both
MIN_RATIO = {"tet2": 8.0, "hex2": 20.0}
MAX_PEAK = 2.5  # of the final matrices
SAME = 1e-9  # relative difference of the two stiffness matrices' Frobenius norms
MODULE = "studies.benchmarks.assembly"
Matrices = tuple[Any, Any]


def _mesh(kind: str, cuts: int) -> Mesh:
    return cube(cuts, kind[:3], EDGE_M)


def ours(kind: str, cuts: int) -> Callable[[], Matrices]:
    """Our assembly, everything before it done."""
    mesh = _mesh(kind, cuts)

    def run() -> Matrices:
        system = assemble(mesh, {"body": ALUMINIUM}, Scale(1.0, 1.0, 1.0))
        return system.stiffness, system.mass

    return run


def scikit(kind: str, cuts: int) -> Callable[[], Matrices]:
    """scikit-fem's assembly of the same mesh, its mesh made before."""
    import skfem
    from skfem.helpers import ddot, dot, eye, sym_grad, trace

    if kind == "tet2":
        mesh = _mesh(kind, cuts)
        nodes, corners = mesh.nodes[: (cuts + 1) ** 3], mesh.cells[:, :4]
        grid = skfem.MeshTet(np.ascontiguousarray(nodes.T), np.ascontiguousarray(corners.T))
        element = skfem.ElementVector(skfem.ElementTetP2())
    else:
        line = np.linspace(0.0, EDGE_M, cuts + 1)
        grid, element = skfem.MeshHex.init_tensor(line, line, line), skfem.ElementVector(skfem.ElementHex2())

    @skfem.BilinearForm
    def stiffness(u, v, w):  # type: ignore[no-untyped-def]
        strain = sym_grad(u)
        stress = 2.0 * ALUMINIUM.shear_pa * strain + ALUMINIUM.lame_pa * eye(trace(strain), 3)
        return ddot(stress, sym_grad(v))

    @skfem.BilinearForm
    def mass(u, v, w):  # type: ignore[no-untyped-def]
        return ALUMINIUM.density_kg_m3 * dot(u, v)

    def run() -> Matrices:
        basis = skfem.Basis(grid, element, intorder=DEGREE[kind])
        return stiffness.assemble(basis), mass.assemble(basis)

    return run


VARIANTS = {"ours": ours, "scikit-fem": scikit}


def _stored(matrix: Any) -> int:
    return int(matrix.data.nbytes + matrix.indices.nbytes + matrix.indptr.nbytes)


def one(kind: str, choice: str, cuts: int, repeats: int) -> dict[str, Any]:
    """Time and peak memory of one way in this process: growth of the resident size over what stood before."""
    run = VARIANTS[choice](kind, cuts)
    before = resident_bytes()
    matrices = run()
    peak = peak_bytes() - before
    result = {
        "dofs": int(matrices[0].shape[0]),
        "peak_bytes": peak,
        "matrix_bytes": sum(map(_stored, matrices)),
        "stiffness_norm": float(np.linalg.norm(matrices[0].data)),
    }
    del matrices
    return result | {"seconds": timed(run, repeats)}


def measure(cuts: int = CUTS, repeats: int = 5) -> dict[str, Any]:
    """For tet2 and hex2: both ways' seconds and peaks, the ratio of times, our peak over the final matrices.

    The faster way repeats `repeats` times, scikit-fem's minute-long one twice; each runs in a process of its own.
    """
    measured: dict[str, Any] = {}
    for kind in DEGREE:
        runs = {
            choice: in_a_process(MODULE, kind, choice, str(cuts), str(repeats if choice == "ours" else 2))
            for choice in VARIANTS
        }
        mine, other = runs["ours"], runs["scikit-fem"]
        if abs(mine["stiffness_norm"] / other["stiffness_norm"] - 1.0) > SAME:
            raise RuntimeError(f"{kind}: the two ways assembled different matrices")
        measured[kind] = {
            "runs": runs,
            "ratio": other["seconds"] / mine["seconds"],
            "peak_over_matrices": mine["peak_bytes"] / mine["matrix_bytes"],
        }
    return measured


def main() -> None:
    """Print the table."""
    print("K and M; time: shortest of several; peak: growth of the resident size over interpreter and mesh")
    print(f"{'mesh':6} {'DOFs':>8} {'way':11} {'time s':>8} {'peak MB':>8} {'peak/matrices':>13}")
    for kind, measured in measure().items():
        for choice, run in measured["runs"].items():
            share = run["peak_bytes"] / run["matrix_bytes"]
            print(
                f"{kind:6} {run['dofs']:8d} {choice:11} {run['seconds']:8.2f} {run['peak_bytes'] / 1e6:8.0f} "
                f"{share:13.2f}"
            )
        kept = measured["ratio"] >= MIN_RATIO[kind] and measured["peak_over_matrices"] < MAX_PEAK
        print(
            f"{kind}: {measured['ratio']:.0f} times as fast (asked: {MIN_RATIO[kind]:.0f}), peak "
            f"{measured['peak_over_matrices']:.2f} times the matrices (asked: below {MAX_PEAK}): "
            f"{'holds' if kept else 'FALLS SHORT'}"
        )


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(json.dumps(one(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4]))))
    else:
        main()
