"""One piezo patch as a bonded solid: stiffness, mass, actuation and charge, condensed to its bonded face.

K_E u - theta V = f,  Q = theta' u + C V, with theta = int B' e' (grad V) dV for a field V/t across the thickness
(ieee176, allik1970). The patch's own resonances lie far above, so its inner nodes follow statically (guyan1965).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.elements import FloatArray
from geometry.hex.boxes import Boxes, hex_mesh
from geometry.mesh import Mesh
from geometry.piezo_materials import PiezoMaterial

ORDER = 2
ELEMENT_M = 2e-3  # along the patch: an eighth of a half-wavelength of 15 mm
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


@dataclass(frozen=True)
class BondedPatch:
    """A patch at its place, condensed to the nodes of its bonded face.

    points (b, 2) in m of those nodes; stiffness and mass (3b, 3b) in N/m and kg at constant voltage; theta (3b,) in N/V
    = C/m; capacitance_f with the bonded face clamped.
    """

    points: FloatArray
    stiffness: FloatArray
    mass: FloatArray
    theta: FloatArray
    capacitance_f: float


def bonded_patch(
    material: PiezoMaterial, box_m: FloatArray, thickness_m: float, above: bool, element_m: float = ELEMENT_M
) -> BondedPatch:
    """A patch with footprint box_m = (x0, x1, y0, y1), bonded below (on the plate's back) or above (on its touch face)."""
    mesh = _mesh(box_m, thickness_m, element_m)
    stiffness, mass, theta, capacitance = _matrices(mesh, material, thickness_m)
    bond = np.flatnonzero(np.abs(mesh.nodes[:, 2] - (0.0 if above else thickness_m)) < 1e-9 * thickness_m + 1e-15)
    b = (3 * bond[:, None] + np.arange(3)).ravel()
    i = np.setdiff1d(np.arange(3 * len(mesh.nodes)), b)
    inner = stiffness[np.ix_(i, i)]
    follow = -np.linalg.solve(inner, stiffness[np.ix_(i, b)])
    swell = np.linalg.solve(inner, theta[i])
    map_to = np.zeros((3 * len(mesh.nodes), len(b)))
    map_to[b, np.arange(len(b))] = 1.0
    map_to[i] = follow
    condensed = map_to.T @ stiffness @ map_to
    return BondedPatch(
        mesh.nodes[bond, :2],
        (condensed + condensed.T) / 2.0,
        map_to.T @ mass @ map_to,
        map_to.T @ theta,
        float(capacitance + theta[i] @ swell),
    )


def _mesh(box_m: FloatArray, thickness_m: float, element_m: float) -> Mesh:
    x0, x1, y0, y1 = box_m
    cuts = [max(2, int(np.ceil((high - low) / element_m))) for low, high in ((x0, x1), (y0, y1))]
    lines = (np.linspace(x0, x1, cuts[0] + 1), np.linspace(y0, y1, cuts[1] + 1), np.array([0.0, thickness_m]))
    return hex_mesh(Boxes(*lines, np.zeros((*cuts, 1), dtype=np.int64), ("patch",)), ORDER)


def _matrices(
    mesh: Mesh, material: PiezoMaterial, thickness_m: float
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """K_E and M (3n, 3n), theta (3n,), C: equal boxes, one of them integrated."""
    rule = mesh.element.quadrature
    value, gradient = mesh.element.shape(rule.points)
    assert mesh.spans is not None
    half = mesh.spans[0] / 2.0
    weight = rule.weights * half.prod()
    strain = _strain(gradient / half)
    one = np.einsum("q,qim,ij,qjn->mn", weight, strain, material.stiffness_pa, strain, optimize=True)
    scalar = material.density_kg_m3 * np.einsum("q,qa,qb->ab", weight, value, value, optimize=True)
    heavy = np.kron(scalar, np.eye(3))
    # stress of a field E_z = -V/t is -e' E = e_3 V/t against c S: the equivalent nodal force is theta V
    load = np.einsum("q,qim,i->m", weight, strain, material.stress_c_m2[2], optimize=True) / -thickness_m
    size = 3 * len(mesh.nodes)
    stiffness, mass, theta = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
    for cell in mesh.cells:
        place = (3 * cell[:, None] + np.arange(3)).ravel()
        stiffness[np.ix_(place, place)] += one
        mass[np.ix_(place, place)] += heavy
        theta[place] += load
    area = float(np.ptp(mesh.nodes[:, 0]) * np.ptp(mesh.nodes[:, 1]))
    return stiffness, mass, theta, float(material.permittivity_clamped_f_m[2, 2]) * area / thickness_m


def _strain(gradient: FloatArray) -> FloatArray:
    """B (q, 6, 3k): strains xx, yy, zz, yz, xz, xy (engineering shear) of nodal displacements."""
    points, nodes = gradient.shape[:2]
    out = np.zeros((points, 6, nodes, 3))
    for row, (a, b) in enumerate(VOIGT):
        out[:, row, :, a] += gradient[:, :, b]
        if a != b:
            out[:, row, :, b] += gradient[:, :, a]
    return out.reshape(points, 6, 3 * nodes)
