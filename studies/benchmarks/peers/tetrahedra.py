"""NGSolve on Netgen's tetrahedra, in whichever interpreter has them: `python tetrahedra.py TASK` prints JSON.

Nothing of Antinode is imported here. Elements shrink geometrically towards the edges where stresses are singular (`RefineHP`).
"""

from __future__ import annotations

import json
import math
import sys
import time
from functools import reduce
from typing import Any

import numpy as np
from netgen.occ import Box, IdentificationType, OCCGeometry, Pnt
from ngsolve import (
    BilinearForm,
    Grad,
    GridFunction,
    Id,
    InnerProduct,
    Mesh,
    Periodic,
    SetNumThreads,
    Sym,
    Trace,
    VectorH1,
    dx,
)
from scipy.sparse.linalg import LinearOperator, eigsh

MM = 1e3  # lengths in mm, stresses in units of Young's modulus
BELOW_HZ = -20e3  # a shift below all eigenvalues: rigid-body waves have none of it


def solid(task: dict[str, Any]) -> Any:
    """The bodies in one, faces named by the side they are on, singular edges marked, opposite sides of a cell identified."""
    bodies = np.array(task["bodies"]) * MM
    parts = [Box(Pnt(*each[::2]), Pnt(*each[1::2])) for each in bodies]
    shape = reduce(lambda one, other: one + other, parts)
    ends = {"xm": bodies[0][0], "xp": bodies[0][1], "ym": bodies[0][2], "yp": bodies[0][3], "zm": bodies[0][4]}
    sides = {}
    for face in shape.faces:
        for name, end in ends.items():
            if abs(getattr(face.center, name[0]) - end) < 1e-6 and (name[0] == "z" or _flat(face, name[0])):
                face.name = name
                sides[name] = face
    for edge in shape.edges:
        if _singular(task["part"], edge, bodies):
            edge.hpref = 1
    if task["part"] == "cell":
        for axis in "xy":
            sides[f"{axis}m"].Identify(sides[f"{axis}p"], axis, IdentificationType.PERIODIC)
    return OCCGeometry(shape)


def _flat(face: Any, axis: str) -> bool:
    low, high = face.bounding_box
    return abs(getattr(high, axis) - getattr(low, axis)) < 1e-3


def _singular(part: str, edge: Any, bodies: Any) -> bool:
    at = edge.center
    if part == "zone":
        return abs(at.y - bodies[0][3]) < 1e-6
    if part == "pillar":
        return abs(at.z) < 1e-6 and at.x > 1e-6 and at.y > 1e-6
    on_rim = abs(at.z - bodies[0][5]) < 1e-6
    inside = bodies[0][0] + 1e-6 < at.x < bodies[0][1] - 1e-6 and bodies[0][2] + 1e-6 < at.y < bodies[0][3] - 1e-6
    return on_rim and inside


def forms(space: Any, task: dict[str, Any]) -> tuple[Any, Any]:
    """K over Young's modulus and M over density and Young's modulus, their stiffness in 1, lengths in mm."""
    u, v = space.TnT()
    ratio = task["poisson"]
    shear, lame = 0.5 / (1.0 + ratio), ratio / ((1.0 + ratio) * (1.0 - 2.0 * ratio))
    strain = Sym(Grad(u))
    stress = 2.0 * shear * strain + lame * Trace(strain) * Id(3)
    density = task["density_kg_m3"] / task["young_pa"] / MM**2
    symmetric = not space.is_complex
    a = BilinearForm(InnerProduct(stress, Sym(Grad(v))) * dx, symmetric=symmetric).Assemble()
    m = BilinearForm(density * InnerProduct(u, v) * dx, symmetric=symmetric).Assemble()
    return a.mat, m.mat


def lowest(space: Any, task: dict[str, Any], near_hz: float) -> tuple[list[float], int, list[float]]:
    """Frequencies nearest to one, by scipy's Lanczos on NGSolve's factorisation, and the free degrees of freedom."""
    stiffness, mass = forms(space, task)
    free = np.flatnonzero(np.array(space.FreeDofs()))
    sigma = math.copysign((2.0 * math.pi * near_hz) ** 2, near_hz)
    shifted = stiffness.CreateMatrix()
    shifted.AsVector().data = stiffness.AsVector() - sigma * mass.AsVector()
    inverse = shifted.Inverse(space.FreeDofs(), inverse="sparsecholesky")
    right, left = shifted.CreateColVector(), shifted.CreateColVector()

    def apply(operator: Any) -> LinearOperator:
        def product(vector: Any) -> Any:
            right[:] = 0.0
            right.FV().NumPy()[free] = vector.ravel()
            left.data = operator * right
            return left.FV().NumPy()[free].copy()

        kind = complex if space.is_complex else float
        return LinearOperator((len(free),) * 2, matvec=product, dtype=kind)

    values, vectors = eigsh(apply(stiffness), task["count"], apply(mass), sigma=sigma, OPinv=apply(inverse), tol=1e-9)
    strengths = [_strength(space, free, vector, task["probe"]) for vector in vectors.T] if task["probe"] else []
    frequencies = np.sqrt(np.maximum(values.real, 0.0)) / (2.0 * math.pi)
    return frequencies.tolist(), len(free), strengths


def _strength(space: Any, free: Any, vector: Any, probe: dict[str, Any]) -> float:
    """Square of the product of a mode, of modal mass 1, and the target shape on the touch face."""
    motion = GridFunction(space)
    motion.vec.FV().NumPy()[free] = vector
    points = MM * np.array(probe["points"])
    across = motion(space.mesh(points[:, 0], points[:, 1], np.zeros(len(points))))[:, 2]
    return float((across @ np.array(probe["shape"])) ** 2)


def bands(mesh: Any, task: dict[str, Any], order: int) -> tuple[list[list[float]], int, float]:
    """Ten bands at the corners; seconds of a general wavevector and of those before it."""

    def at(k: list[float]) -> tuple[list[float], int, list[float]]:
        phase = [complex(np.exp(2j * math.pi * each)) for each in k]
        real = all(abs(each.imag) < 1e-9 for each in phase)
        phase = [each.real if real else each for each in phase]
        return lowest(Periodic(VectorH1(mesh, order=order, complex=not real), phase=phase), task, BELOW_HZ)

    solved = [at(k) for k in task["corners"]]
    start = time.process_time()
    at(task["between"])
    return [sorted(frequencies) for frequencies, *_ in solved], solved[0][1], time.process_time() - start


def run(task: dict[str, Any]) -> dict[str, Any]:
    """A part on one mesh and order."""
    SetNumThreads(1)
    start = time.process_time()
    own = task["settings"]
    mesh = Mesh(solid(task).GenerateMesh(maxh=own["size_mm"]))
    if own["levels"]:
        mesh.RefineHP(own["levels"], factor=0.15)
    meshed = time.process_time() - start
    if task["part"] == "cell":
        frequencies, dofs, each = bands(mesh, task, own["order"])
        return {"frequencies_hz": frequencies, "dofs": dofs, "seconds": meshed + task["wavevectors"] * each}
    solved = []
    for clamped in task["classes"]:
        names: dict[str, list[str]] = {"xyz"[axis]: [] for axis in range(3)}
        for face, axes in clamped.items():
            for axis in axes:
                names["xyz"[axis]].append({"touch": "zm"}.get(face, face.replace("-", "m").replace("+", "p")))
        fixed = {f"dirichlet{axis}": "|".join(faces) for axis, faces in names.items() if faces}
        solved.append(lowest(VectorH1(mesh, order=own["order"], **fixed), task, task["near_hz"] or BELOW_HZ))
    return {
        "frequencies_hz": [each for each, *_ in solved],
        "dofs": sum(each[1] for each in solved),
        "strengths": solved[0][2],
        "seconds": time.process_time() - start,
    }


if __name__ == "__main__":
    print(json.dumps(run(json.loads(sys.argv[1]))))
