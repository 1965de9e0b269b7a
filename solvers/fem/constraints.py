"""Clamps and mirrors: which degrees of freedom stay free, and which rigid-body modes survive."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geometry.elements import BoolArray, FloatArray, IntArray
from geometry.mesh import AnyMesh
from solvers.fem.assembly import Scale, System

AXES = "xyz"


Support = str | tuple[str, str]  # a face held, or a face and the axes along which it is held, such as ("foot", "xz")


def free_mask(mesh: AnyMesh, clamped: Iterable[Support] = (), mirrors: Mapping[str, str] | None = None) -> BoolArray:
    """Free degrees of freedom, shape (n, 3).

    `clamped` names faces whose displacement is zero, or is so along some axes. `mirrors` maps a face on a mirror
    plane to `S` (u_z even: the normal displacement vanishes there) or `A` (u_z odd: both tangential displacements vanish).
    Raises MeshError for a face that the mesh does not have.
    """
    free = np.ones((len(mesh.nodes), 3), dtype=bool)
    for support in clamped:
        face, axes = (support, AXES) if isinstance(support, str) else support
        free[np.ix_(mesh.nodes_of(face), np.array([AXES.index(axis) for axis in axes]))] = False
    for face, sign in (mirrors or {}).items():
        normal = AXES.index(face[0])
        stopped = [normal] if sign == "S" else [axis for axis in range(3) if axis != normal]
        free[np.ix_(mesh.nodes_of(face), np.array(stopped))] = False
    return free


def rigid_body_modes(nodes: FloatArray) -> FloatArray:
    """Three translations and three rotations about the centroid, shape (n, 3, 6), columns of like size."""
    arm = nodes - nodes.mean(axis=0)
    arm = arm / max(float(np.abs(arm).max()), 1e-300)
    motions = np.zeros((len(nodes), 3, 6))
    motions[:, [0, 1, 2], [0, 1, 2]] = 1.0
    for axis in range(3):
        turn = np.zeros(3)
        turn[axis] = 1.0
        motions[:, :, 3 + axis] = np.cross(turn, arm)
    return motions


@dataclass(frozen=True)
class Pencil:
    """K and M of the free degrees of freedom, with the maps between free and full vectors."""

    stiffness: sp.csc_array
    mass: sp.csc_array
    free: BoolArray
    system: System
    rigid_count: int

    @property
    def dof(self) -> int:
        """Free degrees of freedom."""
        return int(self.stiffness.shape[0])

    @property
    def scale(self) -> Scale:
        """Units of the pencil."""
        return self.system.scale

    def apply_mass(self, vectors: FloatArray) -> FloatArray:
        """M x for (dof,) or (dof, k), as the scalar mass on three components."""
        if vectors.ndim == 1:
            return self._weighed(vectors)
        full = self.expand(vectors)
        nodes = full.shape[0]
        product = self.system.mass @ full.reshape(nodes, -1)
        return np.asarray(product.reshape(nodes, 3, -1)[self.free].reshape(vectors.shape))

    def _weighed(self, vector: FloatArray) -> FloatArray:
        """M x of one vector, a component at a time: twice as fast as three side by side."""
        field = np.zeros((3, len(self.free)))
        field.T[self.free] = vector
        product = np.stack([self.system.mass @ component for component in field])
        return np.asarray(product.T[self.free])

    def expand(self, vectors: FloatArray) -> FloatArray:
        """Free vectors (dof, k) as nodal fields (n, 3, k), zero where clamped."""
        full = np.zeros((*self.free.shape, vectors.shape[1]), dtype=vectors.dtype)
        full[self.free] = vectors
        return full


def constrain(system: System, free: BoolArray) -> Pencil:
    """Restrict a system to its free degrees of freedom and count the rigid-body modes that remain."""
    keep = np.flatnonzero(free.ravel())
    return Pencil(
        _symmetric(_restrict(system.stiffness, keep)),
        _symmetric(sp.csr_array(mass_rows(system, keep)[:, keep])),
        free,
        system,
        _surviving(system.mesh.nodes, free),
    )


def mass_rows(system: System, rows: IntArray) -> sp.csr_array:
    """Rows of the mass of three components, m (x) I3, (r, 3n)."""
    scalar = sp.csr_array(system.mass[rows // 3])
    component = np.repeat(rows % 3, np.diff(scalar.indptr)).astype(scalar.indices.dtype)
    shape = (len(rows), 3 * system.mass.shape[1])
    return sp.csr_array((scalar.data, 3 * scalar.indices + component, scalar.indptr), shape=shape)


def _symmetric(matrix: sp.csr_array) -> sp.csc_array:
    """Rows read as columns: the same matrix without a copy."""
    return sp.csc_array((matrix.data, matrix.indices, matrix.indptr), shape=matrix.shape)


def _restrict(matrix: sp.csr_array, keep: IntArray) -> sp.csr_array:
    if len(keep) == matrix.shape[0]:
        return matrix
    return sp.csr_array(matrix[keep][:, keep])


def _surviving(nodes: FloatArray, free: BoolArray) -> int:
    """Rigid-body modes that the constrained degrees of freedom allow: 6 minus the rank of their rows."""
    rigid_at_clamps = rigid_body_modes(nodes)[~free]
    if not len(rigid_at_clamps):
        return 6
    singular = np.linalg.svd(rigid_at_clamps.T @ rigid_at_clamps, compute_uv=False)
    return int(6 - (singular > 1e-10 * max(len(rigid_at_clamps), 1)).sum())
