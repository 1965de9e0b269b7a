"""Convergence of eigenvalues on a box between six sliding walls, whose modes are plane waves: exact and smooth.

Zero normal displacement and zero shear traction mirror the body: u_i ~ sin(k_i x_i) cos ... with k = pi (l/a, m/b, n/c),
omega = c_p |k| for pressure waves and c_s |k| for the shear waves normal to k.
"""

from __future__ import annotations

from itertools import product
from math import log, pi, sqrt

import numpy as np
import pytest

from geometry.hex.boxes import Boxes, hex_mesh
from geometry.mesh import Mesh
from solvers.fem.assembly import assemble
from solvers.fem.eigen import modes_in_band
from solvers.fem.solid import Pencil, constrain
from tests.helpers import small_meshes as small

EDGES_M = (1.0e-3, 0.9e-3, 0.77e-3)
COUNT = 4
MESHES = {  # order, cuts of the coarse and the fine mesh
    "hex1": (1, 4, 8),
    "hex2": (2, 2, 4),
    "hex3": (3, 2, 3),
    "hex4": (4, 2, 3),
    "tet1": (1, 6, 9),
    "tet2": (2, 8, 10),
}


def exact_hz(count: int) -> np.ndarray:
    """The lowest frequencies: one pressure wave a wavevector, two shear waves, one when a component of k is zero."""
    body, result = small.SOFT, []
    shear = body.as_isotropic.young_pa / (2.0 * (1.0 + body.as_isotropic.poisson)) / body.density_kg_m3
    pressure = shear * (2.0 - 2.0 * body.as_isotropic.poisson) / (1.0 - 2.0 * body.as_isotropic.poisson)
    for numbers in product(range(4), repeat=3):
        k = pi * float(np.linalg.norm(np.array(numbers) / np.array(EDGES_M)))
        turns = sum(n > 0 for n in numbers)
        if turns:
            result += [sqrt(pressure) * k / (2.0 * pi)] + [sqrt(shear) * k / (2.0 * pi)] * (turns - 1)
    return np.sort(result)[:count]


def box(kind: str, cuts: int) -> Mesh:
    """The box in equal hexahedra, or each of them in six tetrahedra."""
    order = int(kind[-1])
    if kind.startswith("tet"):
        return small.tets(order, (cuts,) * 3, EDGES_M)
    lines = [np.linspace(0.0, edge, cuts + 1) for edge in EDGES_M]
    return hex_mesh(Boxes(*lines, np.zeros((cuts,) * 3, dtype=np.int64), ("body",)), order)


def sliding(mesh: Mesh) -> Pencil:
    """Normal displacement held on the six walls."""
    low, high = mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)
    near = 1e-9 * (high - low)
    free = (mesh.nodes - low > near) & (high - mesh.nodes > near)
    return constrain(assemble(mesh, {"body": small.SOFT}), free)


def errors(kind: str, cuts: int) -> np.ndarray:
    """Relative errors of the lowest eigenvalues, (COUNT,)."""
    truth = exact_hz(COUNT + 1)
    top = (truth[COUNT - 1] + truth[COUNT]) / 2.0
    result = modes_in_band(
        sliding(box(kind, cuts)), 0.0, (1.5 if cuts < 6 and kind.endswith("1") else 1.05) * top
    ).frequency_hz[:COUNT]
    return (result / truth[:COUNT]) ** 2 - 1.0


def check_rate(kind: str) -> None:
    """Errors from above, falling at 2p - 0.2 or faster for every one of the modes."""
    order, coarse, fine = MESHES[kind]
    first, second = errors(kind, coarse), errors(kind, fine)
    assert second.min() > 0.0, "conforming elements converge from above"
    rates = np.log(first / second) / log(fine / coarse)
    assert rates.min() >= 2.0 * order - 0.2, rates


@pytest.mark.parametrize("kind", [*sorted(MESHES)[:-1], pytest.param("tet2", marks=pytest.mark.slow)])
def test_eigenvalues_converge_at_twice_the_order(kind: str) -> None:
    check_rate(kind)
