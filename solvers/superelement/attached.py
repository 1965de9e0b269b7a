"""Masses, springs and resonators on discs of a panel's back face, added to the matrices of its mesh.

A disc moves by the mean of u over it, w'u: a mass adds m w w' to every component, a spring to ground k w w' to u_z, and a
resonator one node of mass m that moves along z alone, by k (w'u_z - r)^2 / 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from geometry.elements import FloatArray
from geometry.mesh import AnyMesh, Mesh
from geometry.supports import Support
from solvers.errors import SolverError
from solvers.fem.assembly import System
from solvers.fem.surface import boundary_facets, facet_places
from solvers.superelement.supports import disc_points

FLAT = 1e-6  # of the thickness: nodes of the back face


def with_attached(system: System, attached: Sequence[Support], thickness_m: float) -> System:
    """Add masses, springs and resonators to the matrices of a panel.

    Parameters
    ----------
    system : System
        Matrices of a whole panel with its middle at the origin.
    attached : sequence of Support
        On discs of the back face: a mass, a stiffness along z, or both for a resonator.
    thickness_m : float
        Height of the back face in m.

    Returns
    -------
    System
        With a node more for each resonator.

    Raises
    ------
    SolverError
        For a disc that does not lie on the back face.
    """
    for each in attached:
        mean = _mean(system.mesh, each, thickness_m)
        mass, stiffness = each.mass_kg / system.scale.mass_kg, each.stiffness_n_m / _unit(system)
        if each.is_resonator:
            system, mean = _with_node(system, each, thickness_m, mass), np.append(mean, -1.0)
        elif mass:
            system = replace(system, mass=sp.csr_array(system.mass + mass * _square(mean)))
        along_z = sp.csr_array(([1.0], ([2], [2])), shape=(3, 3))
        spring = sp.kron(stiffness * _square(mean), along_z, format="csr")
        grounded = system.grounded or not (each.mass_kg or not stiffness)
        system = replace(system, stiffness=sp.csr_array(system.stiffness + spring), grounded=grounded)
    return system


def carried(transfer: sp.csr_array, attached: Sequence[Support]) -> sp.csr_array:
    """Extend the matrix from the nodes of one mesh to those of another by the nodes of resonators.

    Parameters
    ----------
    transfer : csr_array, shape (fine nodes, coarse nodes)
        Without them.
    attached : sequence of Support
        Those of the panel.

    Returns
    -------
    csr_array, shape (fine nodes + r, coarse nodes + r)
        With a row and a column more for each of r resonators.
    """
    count = sum(each.is_resonator for each in attached)
    return sp.csr_array(sp.block_diag([transfer, sp.eye_array(count)], format="csr")) if count else transfer


def _unit(system: System) -> float:
    """Stiffness in N/m that counts as 1."""
    return system.scale.young_pa * system.scale.length_m


def _square(row: FloatArray) -> sp.csr_array:
    """Matrix w w' of a row w (n,)."""
    own = sp.csr_array(row[None])
    return sp.csr_array(own.T @ own)


def _mean(mesh: AnyMesh, support: Support, thickness_m: float) -> FloatArray:
    """Weights (nodes,) of the mean over a disc of the back face."""
    points, weights = disc_points(support)
    out, left = np.zeros(len(mesh.nodes)), np.full(len(points), True)
    for _, facets in boundary_facets(mesh):
        flat = (np.abs(mesh.nodes[facets, 2] - thickness_m) < FLAT * thickness_m).all(axis=1)
        own, found, values = facet_places(mesh.nodes[:, :2], facets[flat], mesh.order, points[left])
        here = np.flatnonzero(left)[own]
        np.add.at(out, found, weights[here, None] * values)
        left[here] = False
    if left.any():
        raise SolverError("a mass or spring on a cell does not lie on the plate's bare back face")
    return out


def _with_node(system: System, support: Support, thickness_m: float, mass: float) -> System:
    """Add a node of a scaled mass that moves along z alone, at the middle of the disc."""
    mesh, wide = system.mesh, sp.csr_array((3, 3))
    assert isinstance(mesh, Mesh)
    nodes = np.vstack([mesh.nodes, [*support.at_m, thickness_m]])

    def grown(matrix: sp.csr_array) -> sp.csr_array:
        return sp.csr_array(sp.block_diag([matrix, wide], format="csr"))

    return replace(
        system,
        mesh=replace(mesh, nodes=nodes, spans=None),
        mass=sp.csr_array(sp.block_diag([system.mass, [[mass]]], format="csr")),
        stiffness=grown(system.stiffness),
        loss=grown(system.loss) if isinstance(system.loss, sp.csr_array) else system.loss,
        by_material=tuple(map(grown, system.by_material)),
        upright=(*system.upright, len(nodes) - 1),
    )
