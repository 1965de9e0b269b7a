"""scikit-fem with scipy, and CalculiX, on hexahedra: `python -m studies.benchmarks.peers.hexahedra PROGRAM TASK` prints JSON.

Both have the same boxes, graded towards singular edges as their users may grade them.
"""

from __future__ import annotations

import gc
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
import skfem
from scipy.sparse.linalg import LinearOperator, eigsh, splu
from skfem.helpers import ddot, dot, eye, sym_grad, trace

from geometry.elements import FloatArray, IntArray
from geometry.hex.boxes import hex_mesh
from geometry.hex.scenes import HexSettings
from geometry.mesh import Mesh
from solvers.measures.confinement import target_shape
from studies import ladder
from studies.benchmarks.peers.scene import boxes, seconds

BELOW_HZ = -20e3  # a shift below all eigenvalues: rigid-body waves have none of it
SPARE = 4  # waves computed beyond those compared: ARPACK may miss one of two with the same frequency
CORNERS = [0, 4, 2, 1, 6, 5, 3, 7]  # ours, x fastest, in scikit-fem's order
# of 27 nodes, in CalculiX's order
SERENDIPITY = [0, 2, 8, 6, 18, 20, 26, 24, 1, 5, 7, 3, 19, 23, 25, 21, 9, 11, 17, 15]  # fmt: skip


def mesh_of(task: dict[str, Any], order: int) -> Mesh:
    """The boxes of a part with the requested element sizes."""
    own = task["settings"]
    settings = HexSettings(2, 1e-3 * own["size_mm"], own["layers"], 0.15, 1e-3 * own["along_mm"], least=own["least"])
    return hex_mesh(boxes(task["part"], settings), order)


def scikit(task: dict[str, Any]) -> dict[str, Any]:
    """Quadratic hexahedra; K - sigma M by SuperLU with minimum degree on its symmetric pattern, modes by ARPACK."""
    start = seconds()
    mesh = mesh_of(task, 1)
    grid = skfem.MeshHex(np.ascontiguousarray(mesh.nodes.T), np.ascontiguousarray(mesh.cells[:, CORNERS].T))
    basis = skfem.Basis(grid, skfem.ElementVector(skfem.ElementHex2()), intorder=5)
    stiffness, mass = assembled(basis, task)
    if task["part"] == "cell":
        return _bands(basis, stiffness, mass, task, start)
    frequencies_hz, strengths, dofs = [], [], 0
    for clamped in task["classes"]:
        fixed = [
            basis.get_dofs(nodes=None, facets=_facets(grid, mesh, face)).all([f"u^{axis + 1}" for axis in axes])
            for face, axes in clamped.items()
        ]
        free = np.setdiff1d(np.arange(basis.N), np.concatenate(fixed))
        near_hz = task["near_hz"] or BELOW_HZ
        hz, vectors = nearest(stiffness[free][:, free], mass[free][:, free], task["count"], near_hz)
        frequencies_hz.append(hz)
        dofs += len(free)
        if task["probe"]:
            full = np.zeros((basis.N, len(hz)))
            full[free] = vectors
            strengths = _strengths(basis, full, task["probe"])
    return {"frequencies_hz": frequencies_hz, "dofs": dofs, "strengths": strengths, "seconds": seconds() - start}


def assembled(basis: skfem.Basis, task: dict[str, Any]) -> tuple[sp.csc_matrix, sp.csc_matrix]:
    """Matrices K and M of one material, whose constants the task holds."""
    young, ratio = task["young_pa"], task["poisson"]
    shear, lame = young / 2.0 / (1.0 + ratio), young * ratio / ((1.0 + ratio) * (1.0 - 2.0 * ratio))

    @skfem.BilinearForm
    def stiffness(u, v, w):  # type: ignore[no-untyped-def]
        strain = sym_grad(u)
        return ddot(2.0 * shear * strain + lame * eye(trace(strain), 3), sym_grad(v))

    @skfem.BilinearForm
    def mass(u, v, w):  # type: ignore[no-untyped-def]
        return task["density_kg_m3"] * dot(u, v)

    return stiffness.assemble(basis).tocsc(), mass.assemble(basis).tocsc()


def _facets(grid: skfem.MeshHex, mesh: Mesh, face: str) -> IntArray:
    """Facets of one side: of all corners on it."""
    on = np.zeros(grid.p.shape[1], dtype=bool)
    on[mesh.nodes_of(face)] = True
    boundary = grid.boundary_facets()
    return np.asarray(boundary[on[grid.facets[:, boundary]].all(axis=0)])


def nearest(stiffness: Any, mass: Any, count: int, near_hz: float) -> tuple[list[float], Any]:
    """Frequencies nearest to one and their modes of modal mass 1."""
    sigma = np.copysign((2.0 * np.pi * near_hz) ** 2, near_hz)
    factor = splu(
        sp.csc_matrix(stiffness - sigma * mass), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )  # fmt: skip
    inverse = LinearOperator(stiffness.shape, matvec=factor.solve, dtype=stiffness.dtype)
    values, vectors = eigsh(stiffness, count, mass, sigma=sigma, OPinv=inverse)
    gc.collect()  # ARPACK's object refers to itself, and would keep the factors of every wavevector
    return (np.sqrt(np.maximum(values, 0.0)) / (2.0 * np.pi)).tolist(), vectors


def _strengths(basis: skfem.Basis, modes: FloatArray, probe: dict[str, Any]) -> list[float]:
    """Squares of the product of each mode and the target shape on the touch face."""
    points = np.array(probe["points"])
    at = basis.probes(np.vstack([points.T, np.full(len(points), 1e-9)])) @ modes
    across = at.reshape(3, len(points), -1)[2]
    return ((np.array(probe["shape"]) @ across) ** 2).tolist()


def bloch(
    basis: Any, stiffness: Any, mass: Any, pitch: float, count: int
) -> tuple[Callable[[FloatArray], list[float]], int]:
    """The lowest frequencies of a square cell at a wavevector in rad/m, and its degrees of freedom.

    Bloch's conditions join the degrees of freedom of opposite sides, a phase between them.
    """
    component = np.empty(basis.N, dtype=int)
    for axis in range(3):
        component[basis.get_dofs(elements=True).all([f"u^{axis + 1}"])] = axis
    places = basis.doflocs.T.copy()
    far = places[:, :2] > places[:, :2].max(axis=0) - 1e-9
    places[:, :2] -= pitch * far
    key = np.column_stack([np.round(places / 1e-9).astype(int), component])
    _, master = np.unique(key, axis=0, return_inverse=True)

    def at(wavevector: FloatArray) -> list[float]:
        phase = np.exp(1j * pitch * (far @ wavevector))
        phase = phase.real if np.abs(phase.imag).max() < 1e-9 else phase
        joined = sp.csr_matrix((phase, (np.arange(basis.N), master.ravel())))
        k_r, m_r = ((joined.conj().T @ matrix @ joined).tocsc() for matrix in (stiffness, mass))
        return sorted(nearest(k_r, m_r, count + SPARE, BELOW_HZ)[0])[:count]

    return at, int(master.max()) + 1


def _bands(basis: Any, stiffness: Any, mass: Any, task: dict[str, Any], start: float) -> dict[str, Any]:
    at, dofs = bloch(basis, stiffness, mass, task["pitch_m"], task["count"])
    edge = 2.0 * np.pi / task["pitch_m"]
    ready = seconds() - start
    frequencies_hz = [at(edge * np.array(k)) for k in task["corners"]]
    before = seconds()
    at(edge * np.array(task["between"]))
    each = seconds() - before
    return {"frequencies_hz": frequencies_hz, "dofs": dofs, "seconds": ready + task["wavevectors"] * each}


def calculix(task: dict[str, Any]) -> dict[str, Any]:
    """Elements of 20 nodes, C3D20R, as `ccx` solves them: SPOOLES and ARPACK, from the lowest mode up."""
    start = seconds()
    mesh = mesh_of(task, 2)
    used, cells = np.unique(mesh.cells[:, SERENDIPITY], return_inverse=True)
    number = np.zeros(len(mesh.nodes), dtype=int)
    number[used] = np.arange(1, len(used) + 1)
    corners = np.unique(mesh.cells[:, SERENDIPITY[:8]])
    on_zone = (np.abs(mesh.nodes[corners, 2]) < 1e-9) & (mesh.nodes[corners, 1] < ladder.design().width_m / 2.0 + 1e-9)
    touch = corners[on_zone].tolist() if task["probe"] else []
    frequencies_hz, strengths, dofs = [], [], 0
    for clamped in task["classes"]:
        stopped = {(number[n], axis) for face, axes in clamped.items() for n in mesh.nodes_of(face) for axis in axes}
        stopped = {(n, axis) for n, axis in stopped if n}
        deck = _deck(task, mesh.nodes[used], cells.reshape(-1, 20) + 1, sorted(stopped), number[touch].tolist())
        hz, motions = _ccx(deck)
        frequencies_hz.append(hz)
        dofs += 3 * len(used) - len(stopped)
        if touch:
            points = mesh.nodes[touch]
            weights = _weights(points) * target_shape(ladder.plate_design(), points)
            strengths = ((motions @ weights) ** 2).tolist()
    return {"frequencies_hz": frequencies_hz, "dofs": dofs, "strengths": strengths, "seconds": seconds() - start}


def _deck(
    task: dict[str, Any], nodes: FloatArray, cells: IntArray, stopped: list[tuple[int, int]], probed: list[int]
) -> str:
    """The input file: mesh, material, supports, one frequency step, the motions of the nodes probed."""
    own = task["settings"]
    lines = ["*NODE, NSET=NALL"]
    lines += [f"{i}, {x:.12e}, {y:.12e}, {z:.12e}" for i, (x, y, z) in enumerate(nodes, start=1)]
    lines += [f"*ELEMENT, TYPE={own['element']}, ELSET=EALL"]
    for i, cell in enumerate(cells, start=1):
        lines += [f"{i}, " + ", ".join(map(str, cell[:15])) + ",", ", ".join(map(str, cell[15:]))]
    lines += ["*MATERIAL, NAME=BODY", "*ELASTIC", f"{task['young_pa']:.12g}, {task['poisson']:.12g}"]
    lines += ["*DENSITY", f"{task['density_kg_m3']:.12g}", "*SOLID SECTION, ELSET=EALL, MATERIAL=BODY"]
    lines += ["*BOUNDARY", *(f"{n}, {axis + 1}" for n, axis in stopped)]
    lines += ["*NSET, NSET=PROBED", *(f"{n}," for n in probed)] if probed else []
    lines += ["*STEP", "*FREQUENCY", str(own["lowest"] or task["count"])]
    lines += ["*NODE PRINT, NSET=PROBED", "U"] if probed else []
    return "\n".join([*lines, "*END STEP", ""])


def _weights(points: FloatArray) -> FloatArray:
    """Areas that the nodes of a grid stand for, by the trapezoidal rule."""
    weights = np.ones(len(points))
    for axis in (0, 1):
        lines, place = np.unique(np.round(points[:, axis], 9), return_inverse=True)
        spans = np.diff(lines)
        weights *= ((np.append(spans, 0.0) + np.append(0.0, spans)) / 2.0)[place]
    return weights


def _ccx(deck: str) -> tuple[list[float], FloatArray]:
    """Frequencies, Hz, and u_z of the printed nodes, one row per mode. RuntimeError with CalculiX's last words."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "part.inp").write_text(deck)
        done = subprocess.run(["ccx", "part"], cwd=folder, capture_output=True, text=True)
        results = Path(folder, "part.dat")
        if done.returncode or not results.exists():
            raise RuntimeError(f"ccx: {' '.join(done.stdout.split()[-20:])}")
        text = results.read_text()
    head, *printed = text.split("displacements (vx,vy,vz)")
    values = head.partition("E I G E N V A L U E   O U T P U T")[2].partition("P A R T I C I P A T I O N")[0]
    rows = [line.split() for line in values.splitlines()]
    hz = [float(row[3]) for row in rows if len(row) == 5 and row[0].isdigit()]
    motions = [[float(r.split()[3]) for r in one.splitlines()[1:] if len(r.split()) == 4] for one in printed]
    return hz, np.array(motions)


PROGRAMS = {"scikit-fem": scikit, "calculix": calculix}

if __name__ == "__main__":
    print(json.dumps(PROGRAMS[sys.argv[1]](json.loads(sys.argv[2]))))
