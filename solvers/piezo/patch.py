"""One piezo patch as a bonded solid: stiffness, mass, actuation and charge, condensed to its bonded face.

K_E u + N p - theta V = f,  N'u - E p = 0,  Q = theta' u + C V, with theta = int B' e' (grad V) dV for a field V/t across the
thickness and p the potential beside it, 0 on both electrodes: N = int B' e' grad, E = int grad' eps grad (ieee176, allik1970).
Bending makes the field uneven and so stiffens a patch about its own middle. The patch's own resonances lie far above, so
its inner nodes follow statically (guyan1965). What they weigh while a volt swells them adds omega^2 M_i K_ii^-1 theta_i to
the load.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product
from math import pi
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from geometry.elements import FloatArray, IntArray
from geometry.hex.boxes import Boxes, hex_mesh
from geometry.hex.scenes import HexSettings, grid_lines
from geometry.materials import VOIGT, PiezoMaterial
from geometry.mesh import Mesh
from solvers.fem.assembly import Forms
from solvers.fem.factor.factoriser import Factor, Factoriser
from solvers.fem.surface import face_quadrature
from solvers.machine import check_room
from solvers.piezo.bond import mirror_signs

MESH = HexSettings(3, 4e-3, 1, 0.15)  # along the patch a quarter of a half-wavelength of 15 mm, shorter at its edges
COPIES = 4  # of the nodes' motions and potential inside per bonded one, held at once
SQUARES = 6  # of matrices of the bonded face, held at once
SAME = 1e-9  # of the thickness: one place
APART = 1e-6  # of a length: nodes are farther from each other
OWN = 1e-6  # of a resonance: how finely a patch's own one is found
BASIS = 10  # Lanczos vectors of a lowest resonance
KEPT = ("points", "projection", "stiffness", "mass", "theta", "swell", "capacitance_f", "own_hz")
CLASSES = ("SS", "SA", "AS", "AA")


@dataclass(frozen=True)
class BondedPatch:
    """A patch at its place, condensed to the nodes of its bonded face.

    points (q, 2) in m on that face, projection (b, q): the nodes' displacements are those of its field nearest to u at the
    points in the mean square, so that forces pass through the whole face and not at nodes. stiffness and mass (3b, 3b) in N/m
    and kg at constant voltage; theta (3b,) in N/V = C/m; swell (3b,) in kg m/V, force per volt and squared angular frequency;
    capacitance_f with the bonded face clamped. box_m: the footprint x0, x1, y0, y1; mesh: elements, shorter at its edges.
    own_hz: its lowest resonance on a bonded face that is held; far below it alone the patch follows statically.
    """

    material: PiezoMaterial
    box_m: FloatArray
    thickness_m: float
    mesh: HexSettings

    points: FloatArray
    projection: FloatArray
    stiffness: FloatArray
    mass: FloatArray
    theta: FloatArray
    swell: FloatArray
    capacitance_f: float
    own_hz: float


class Cache(Protocol):
    """Where patches are kept between runs."""

    def load(self, key: str) -> dict[str, Any] | None:
        """Arrays kept under this key, or None."""
        ...

    def keep(self, key: str, flat: dict[str, Any]) -> None:
        """Keep arrays."""
        ...


@dataclass(frozen=True)
class _Where:
    """Where a patch may be kept, which is no part of what it is."""

    cache: Cache | None = field(default=None, compare=False)


def bonded_patch(
    material: PiezoMaterial,
    box_m: FloatArray,
    thickness_m: float,
    above: bool,
    mesh: HexSettings | None = None,
    cache: Cache | None = None,
) -> BondedPatch:
    """A patch with footprint box_m = (x0, x1, y0, y1), bonded below (on the plate's back) or above (on its touch face).

    Meshed by MESH where nothing else is given; computed where neither this process nor the cache has one alike.
    """
    x0, x1, y0, y1 = (float(end) for end in box_m)
    size = round(x1 - x0, 12), round(y1 - y0, 12)
    patch = _known((material, *size, thickness_m, above, mesh or MESH), _Where(cache))
    return replace(patch, points=patch.points + np.array([x0, y0]), box_m=np.array([x0, x1, y0, y1]))


_Own = tuple[PiezoMaterial, float, float, float, bool, HexSettings]  # what tells patches from others, wherever they are


@lru_cache(maxsize=8)
def _known(own: _Own, where: _Where) -> BondedPatch:
    if where.cache is None:
        return _alike(*own)
    key = hashlib.sha256(repr(("patch", *own)).encode()).hexdigest()
    flat = where.cache.load(key)
    if flat is None:
        patch = _alike(*own)
        where.cache.keep(key, {name: getattr(patch, name) for name in KEPT})
        return patch
    material, x_m, y_m, thickness_m, _, settings = own
    parts: dict[str, Any] = {name: flat[name] if flat[name].ndim else float(flat[name]) for name in KEPT}
    return BondedPatch(material, np.array([0.0, x_m, 0.0, y_m]), thickness_m, settings, **parts)


def _alike(
    material: PiezoMaterial, x_m: float, y_m: float, thickness_m: float, above: bool, settings: HexSettings
) -> BondedPatch:
    """The patch with its first corner at the origin: patches of one size are one."""
    box = np.array([0.0, x_m, 0.0, y_m])
    mesh = _mesh(box, thickness_m, settings, above)
    _check_room(mesh, box)
    bond = np.flatnonzero(np.abs(mesh.nodes[:, 2] - (0.0 if above else thickness_m)) < 1e-9 * thickness_m + 1e-15)
    matrices = with_potential(mesh, material, thickness_m)
    parts = [_condensed(matrices, *_fields(mesh, symmetry, matrices[0].shape[0]), 3 * bond) for symmetry in CLASSES]
    *added, own_hz = zip(*parts, strict=True)
    stiffness, mass, theta, swell, charged = (np.sum(each, axis=0) for each in added)
    places = _projection(mesh, "touch" if above else "top", bond)
    capacitance_f = float(matrices[3] + charged)
    return BondedPatch(
        material, box, thickness_m, settings, *places, stiffness, mass, theta, swell, capacitance_f, min(own_hz)
    )


_Matrices = tuple[sp.csr_array, sp.csr_array, FloatArray, float]


def _condensed(
    matrices: _Matrices, fields: sp.csr_array, own: IntArray, bond: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float, float]:
    """What fields (dof, m) of one symmetry class have of stiffness, mass, theta, swell, capacitance and lowest resonance.

    The matrices' images of the fields are fields of the class: their rows `own`, one a field, hold them.
    """
    scale = sp.diags_array(1.0 / fields[own, np.arange(len(own))])
    stiffness, mass = (sp.csr_array(scale @ (matrix[own] @ fields)) for matrix in matrices[:2])
    theta, on_bond = fields.T @ matrices[2], fields[(bond[:, None] + np.arange(3)).ravel()]
    b = np.unique(on_bond.indices)
    i = np.setdiff1d(np.arange(fields.shape[1]), b)
    (k_b, k_i), (m_b, m_i) = ((matrix[b], matrix[i]) for matrix in (stiffness, mass))
    k_ii, m_ii, k_bi, m_bi = k_i[:, i], m_i[:, i], k_b[:, i], m_b[:, i]
    inner = Factoriser()(sp.csc_array(k_ii))
    follow = -inner.solve(k_i[:, b].toarray())
    swell = inner.solve(theta[i][:, None])[:, 0]
    condensed = k_b[:, b] + k_bi @ follow
    heavy = m_b[:, b] + m_bi @ follow + follow.T @ (m_i[:, b] + m_ii @ follow)
    place = on_bond[:, b]
    return (
        place @ (place @ (condensed + condensed.T) / 2.0).T,
        place @ (place @ heavy).T,
        place @ (theta[b] + follow.T @ theta[i]),
        place @ (m_bi @ swell + follow.T @ (m_ii @ swell)),
        float(theta[i] @ swell),
        _lowest_hz(k_ii, m_ii, inner),
    )


def _fields(mesh: Mesh, symmetry: str, size: int) -> tuple[sp.csr_array, IntArray]:
    """Orthonormal fields (size, m) of one symmetry class of a patch, which is its own mirror image: motions of all nodes, then
    the potential, which is even or odd as u_z is, of those inside. And of each field a row in which it alone is, (m,).
    """
    grid = [_ranks(places) for places in mesh.nodes.T]
    last = [int(ranks.max()) for ranks in grid]
    number = np.empty([each + 1 for each in last], dtype=np.int64)
    number[tuple(grid)] = np.arange(len(mesh.nodes))
    inside = np.flatnonzero((grid[2] > 0) & (grid[2] < last[2]))
    motion = np.arange(3 * len(mesh.nodes)).reshape(-1, 3)
    potential = np.full(len(mesh.nodes), -1)
    potential[inside] = motion.size + np.arange(size - motion.size)
    first = (2 * grid[0] <= last[0]) & (2 * grid[1] <= last[1])
    rows, values = [], []
    for flip in product((1.0, -1.0), repeat=2):
        x, y = (ranks if way > 0.0 else end - ranks for ranks, end, way in zip(grid, last, flip, strict=False))
        image, signs = number[x, y, grid[2]][first], mirror_signs(symmetry, np.array(flip))
        has = potential[image] >= 0
        rows.append(np.concatenate([motion[image].ravel(), potential[image][has]]))
        values.append(np.concatenate([np.tile(signs, len(image)), np.full(int(has.sum()), signs[2])]))
    where = np.concatenate(rows), np.tile(np.arange(len(rows[0])), len(rows))
    fields = sp.csc_array(sp.coo_array((np.concatenate(values), where), (size, len(rows[0]))))
    length = np.sqrt(np.asarray(fields.multiply(fields).sum(axis=0)))
    alive = np.flatnonzero(length > 0.5)  # a motion on a mirror line that its class forbids cancels
    return sp.csr_array(fields[:, alive] @ sp.diags_array(1.0 / length[alive])), rows[0][alive]


def _ranks(places: FloatArray) -> IntArray:
    """The number of each place among the different ones, ascending."""
    order = np.argsort(places, kind="stable")
    out = np.zeros(len(places), dtype=np.int64)
    out[order[1:]] = np.cumsum(np.diff(places[order]) > APART * np.ptp(places))
    return out


def _check_room(mesh: Mesh, box_m: FloatArray) -> None:
    """TooLarge where the dense matrices of the condensation would not fit into memory."""
    layers = len(np.unique(np.round(mesh.nodes[:, 2], 12)))
    bond = 3.0 * len(mesh.nodes) / layers
    size = " x ".join(f"{1e3 * each:g}" for each in np.diff(box_m)[::2])
    what = f"a patch of {size} mm in elements as short as it needs takes"
    check_room(8.0 * bond**2 * (COPIES * (layers - 1) + SQUARES), what, "take shorter patches")


def _lowest_hz(stiffness: sp.csr_array, mass: sp.csr_array, factor: Factor) -> float:
    """Lowest natural frequency of K and M with the factor of K."""
    inverse = spla.LinearOperator(stiffness.shape, matvec=factor.solve, dtype=float)
    start = np.ones(stiffness.shape[0])
    value = spla.eigsh(
        stiffness, 1, mass, sigma=0.0, OPinv=inverse, v0=start, ncv=BASIS, tol=OWN, return_eigenvectors=False
    )
    return float(np.sqrt(value[0]) / (2.0 * pi))


def _mesh(box_m: FloatArray, thickness_m: float, settings: HexSettings, above: bool) -> Mesh:
    x, y = (grid_lines({float(low): True, float(high): True}, settings.grading) for low, high in box_m.reshape(2, 2))
    z = grid_lines({0.0: above, thickness_m: not above}, settings.grading)
    region = np.zeros((len(x) - 1, len(y) - 1, len(z) - 1), dtype=np.int64)
    return hex_mesh(Boxes(x, y, z, region, ("patch",)), settings.order)


def _projection(mesh: Mesh, face: str, nodes: IntArray) -> tuple[FloatArray, FloatArray]:
    """Points (q, 2) of a quadrature over a face and the mean-square projection (b, q) onto the field of its nodes (b,)."""
    rule = face_quadrature(mesh, face)
    value = rule.interpolation[:, nodes].toarray()
    heavy = value.T * rule.weights
    return rule.points[:, :2], np.asarray(np.linalg.solve(heavy @ value, heavy))


def with_potential(
    mesh: Mesh, material: PiezoMaterial, thickness_m: float
) -> tuple[sp.csr_array, sp.csr_array, FloatArray, float]:
    """K_E and M, theta, C with the potential at nodes between the electrodes, (p,), after the motion of all nodes.

    K is indefinite and M has nothing there. The potential is scaled, so that its own part is as large as K_E.
    """
    size = float(np.sqrt(material.stiffness_pa[2, 2] / material.permittivity_clamped_f_m[2, 2]))
    law = np.zeros((4, 3, 4, 3))  # of u_x, u_y, u_z and the potential: stresses and charges of their slopes
    law[:3, :, :3] = material.stiffness_pa[VOIGT[:, :, None, None], VOIGT]
    law[3, :, :3] = size * material.stress_c_m2[:, VOIGT]
    law[:3, :, 3] = law[3, :, :3].transpose(1, 2, 0)
    law[3, :, 3] = -(size**2) * material.permittivity_clamped_f_m
    forms, count, height = Forms(mesh, 1.0), len(mesh.nodes), mesh.nodes[:, 2]
    motion, potential = (4 * np.arange(count)[:, None] + np.arange(3)).ravel(), 4 * np.arange(count) + 3
    inside = (height > height.min() + SAME * thickness_m) & (height < height.max() - SAME * thickness_m)
    every = forms.stiffness(law)
    own = np.concatenate([motion, potential[inside]])
    scalar = forms.mass(np.full(len(mesh.cells), material.density_kg_m3))
    heavy = sp.block_diag([sp.kron(scalar, np.eye(3)), sp.csr_array((inside.sum(),) * 2)], format="csr")
    # a field E_z = -V/t has the potential V z/t: N times it is -theta V
    theta = np.concatenate([every[motion][:, potential] @ height / (-thickness_m * size), np.zeros(inside.sum())])
    area = float(np.ptp(mesh.nodes[:, 0]) * np.ptp(mesh.nodes[:, 1]))
    capacitance = float(material.permittivity_clamped_f_m[2, 2]) * area / thickness_m
    return sp.csr_array(every[own][:, own]), sp.csr_array(heavy), theta, capacitance
