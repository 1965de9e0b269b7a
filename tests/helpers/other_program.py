"""Modes and Bloch bands of a mesh of hexahedra by scikit-fem: other elements and quadrature, nodes tied by where they lie."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp

from geometry.elements import FloatArray
from geometry.formats.neutral import local_nodes
from geometry.lattice import Lattice
from geometry.materials import Material
from geometry.mesh import Mesh
from studies.benchmarks.peers.hexahedra import SPARE, nearest

CORNERS = [0, 4, 3, 1, 7, 5, 2, 6]  # VTK's corners of a hexahedron in the order of scikit-fem
RIGID = 6  # motions of a free body
STILL = 1e-2  # of the first elastic mode's frequency: a rigid-body mode in the digits of a computer
TRIES = 10  # from a random start each: ARPACK misses some of six equal values once in ten runs or so
DIGITS = 6  # of a position relative to the lattice vectors


def other_bands(
    mesh: Mesh, lattice: Lattice, wavevector: FloatArray, count: int, materials: Mapping[str, Material]
) -> FloatArray:
    """The lowest bands of complete quadratic hexahedra at a wavevector (2,) in rad/m, Hz."""
    basis, k, m = _assembled(mesh, materials)
    component = np.zeros(basis.N)
    for kind in (basis.nodal_dofs, basis.edge_dofs, basis.facet_dofs, basis.interior_dofs):
        component[kind] = np.arange(len(kind))[:, None] % 3
    shares = (basis.doflocs[:2].T - mesh.nodes[:, :2].min(axis=0)) @ np.linalg.inv(lattice.vectors_m)
    steps = np.floor(shares + 10.0**-DIGITS)
    height = basis.doflocs[2] / np.sqrt(lattice.area_m2)
    keys = (np.column_stack([shares - steps, height, component]) * 10.0 ** (DIGITS - 1)).round().astype(int)
    _, follows = np.unique(keys, axis=0, return_inverse=True)
    phase = np.exp(1j * (steps @ lattice.vectors_m) @ wavevector)
    tie = sp.csr_array((phase, (np.arange(basis.N), follows.ravel())))
    return _lowest_hz(tie.conj().T @ k @ tie, tie.conj().T @ m @ tie, count)


def other_modes(mesh: Mesh, count: int, materials: Mapping[str, Material]) -> FloatArray:
    """The lowest elastic modes of a free body of complete quadratic hexahedra, Hz."""
    _, k, m = _assembled(mesh, materials)
    for _ in range(TRIES):
        found = _lowest_hz(k, m, RIGID + count)
        if found[RIGID - 1] < STILL * found[RIGID]:
            return found[RIGID:]
    raise AssertionError(f"the other program found fewer than {RIGID} rigid-body modes in {TRIES} tries")


def _assembled(mesh: Mesh, materials: Mapping[str, Material]) -> tuple[Any, Any, Any]:
    """Basis, K and M of all regions."""
    import skfem
    from skfem.helpers import ddot, dot, eye, sym_grad, trace

    used, cells = np.unique(mesh.cells[:, local_nodes(mesh.kind, mesh.order)][:, :8], return_inverse=True)
    body = skfem.MeshHex(mesh.nodes[used].T, np.ascontiguousarray(cells.reshape(-1, 8)[:, CORNERS].T))
    element = skfem.ElementVector(skfem.ElementHex2())
    basis, parts = skfem.Basis(body, element, intorder=4), [0.0, 0.0]

    @skfem.BilinearForm
    def elastic(u, v, w):  # type: ignore[no-untyped-def]
        strain = sym_grad(u)
        return ddot(w.lame * eye(trace(strain), 3) + 2.0 * w.shear * strain, sym_grad(v))

    @skfem.BilinearForm
    def inert(u, v, w):  # type: ignore[no-untyped-def]
        return w.rho * dot(u, v)

    for name, members in mesh.region_of_cells().items():
        young, nu = materials[name].average.young_pa, materials[name].average.poisson
        lame, shear = young * nu / (1.0 + nu) / (1.0 - 2.0 * nu), young / 2.0 / (1.0 + nu)
        own = skfem.Basis(body, element, elements=members, intorder=4)
        parts[0] = parts[0] + elastic.assemble(own, lame=lame, shear=shear)
        parts[1] = parts[1] + inert.assemble(own, rho=materials[name].density_kg_m3)
    return basis, *parts


def _lowest_hz(k: Any, m: Any, count: int) -> FloatArray:
    k, m = sp.csc_array(k), sp.csc_array(m)
    if np.abs(k.data.imag).max() < 1e-9 * np.abs(k.data).max():
        k, m = k.real, m.real
    below_hz = -np.sqrt(1e-4 * abs(k.diagonal()).max() / abs(m.diagonal()).max()) / (2.0 * np.pi)
    found, _ = nearest(k, m, count + SPARE, below_hz)
    return np.sort(found)[:count]
