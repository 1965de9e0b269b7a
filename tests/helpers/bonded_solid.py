"""A plate and a piezo patch on its back as solids that share the nodes of their bond."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geometry.elements import FloatArray, IntArray
from geometry.mesh import Mesh
from geometry.piezo_materials import PiezoMaterial
from solvers.fem.assembly import System
from solvers.piezo.patch import _matrices, with_potential

SAME_M = 1e-9


@dataclass(frozen=True)
class BondedSolid:
    """K (N/m) and M (kg), (3n, 3n), at constant voltage; the load of a volt (3n,) in N; the patch's clamped capacitance in F;
    where the nodes lie, (n, 3), in nm; and the matrix (3n, 3 plate nodes) from the plate's own degrees of freedom. bending:
    what the potential between the electrodes adds to K is N D^-1 N'; its factors N (3n, p) and D (p, p).
    """

    stiffness: sp.csr_array
    mass: sp.csr_array
    load: FloatArray
    capacitance_f: float
    place_nm: IntArray
    plate: sp.csr_array
    bending: tuple[sp.csr_array, sp.csr_array]


def bonded_solid(plate: System, patch: Mesh, material: PiezoMaterial, thickness_m: float) -> BondedSolid:
    """Join an assembled plate and a patch, whose mesh starts at z = 0, where their nodes meet on the plate's back."""
    stiffness, mass, theta, capacitance = _matrices(patch, material, thickness_m)
    lifted = patch.nodes + np.array([0.0, 0.0, plate.mesh.nodes[:, 2].max()])
    place = np.round(np.vstack([plate.mesh.nodes, lifted]) / SAME_M).astype(np.int64)
    unique, number = np.unique(place, axis=0, return_inverse=True)
    below, above = (_spread(own, len(unique)) for own in np.split(number.ravel(), [len(plate.mesh.nodes)]))
    both, size = with_potential(patch, material, thickness_m)[0], 3 * len(patch.nodes)
    unit, heavy = plate.scale.young_pa * plate.scale.length_m, sp.kron(plate.mass, sp.eye_array(3))
    return BondedSolid(
        sp.csr_array(below @ (unit * plate.stiffness) @ below.T + above @ sp.csr_array(stiffness) @ above.T),
        sp.csr_array(below @ (plate.scale.mass_kg * heavy) @ below.T + above @ sp.csr_array(mass) @ above.T),
        above @ theta,
        capacitance,
        unique,
        below,
        (sp.csr_array(above @ both[:size, size:]), sp.csr_array(-both[size:, size:])),
    )


def _spread(nodes: IntArray, count: int) -> sp.csr_array:
    """From the degrees of freedom of some nodes to those of all."""
    places = (3 * nodes[:, None] + np.arange(3)).ravel()
    return sp.coo_array((np.ones(len(places)), (places, np.arange(len(places)))), (3 * count, len(places))).tocsr()
