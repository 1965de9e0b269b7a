"""A meshed body, held by clamps and mirrors: its pencil, its modes by symmetry class, and their measures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from geometry.elements import BoolArray, FloatArray, IntArray
from geometry.materials import Material, Stack
from geometry.mesh import AnyMesh
from solvers.fem.assembly import Scale, System, assemble
from solvers.fem.cost import LARGE
from solvers.fem.eigen import PlainPencil
from solvers.fem.prestress import with_free_stress
from solvers.fem.surface import FaceQuadrature, Frame, Skin, face_quadrature, skin_faces
from solvers.measures.confinement import TouchField

# -- clamps and mirrors ------------------------------------------------------------------------------------------------
# Clamps and mirrors: which degrees of freedom stay free, and which rigid-body modes survive.

AXES = "xyz"
Support = str | tuple[str, str]  # a face held, or a face and the axes along which it is held, such as ("foot", "xz")


def free_mask(mesh: AnyMesh, clamped: Iterable[Support] = (), mirrors: Mapping[str, str] | None = None) -> BoolArray:
    """Mask the free degrees of freedom.

    Parameters
    ----------
    mesh : Mesh
        Its named faces.
    clamped : iterable of str or (str, axes), optional
        Faces whose displacement is zero, or zero along some axes.
    mirrors : mapping of str to {"S", "A"}, optional
        Faces on mirror planes: `S` for u_z even (no normal displacement), `A` for u_z odd (no tangential
        displacement).

    Returns
    -------
    ndarray of bool, shape (n, 3)
        True where free.

    Raises
    ------
    MeshError
        For a face that the mesh does not have.
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


def rigid_body_modes(nodes: FloatArray, about_m: FloatArray | None = None, length_m: float | None = None) -> FloatArray:
    """Build three translations and three rotations about a point.

    Parameters
    ----------
    nodes : ndarray, shape (n, 3)
        In m.
    about_m : ndarray, shape (3,), optional
        The point; the centroid by default.
    length_m : float, optional
        Distance at which rotations move by 1; by default that of the farthest node along an axis.

    Returns
    -------
    ndarray, shape (n, 3, 6)
        Dimensionless displacements.
    """
    arm = nodes - (nodes.mean(axis=0) if about_m is None else about_m)
    arm = arm / (length_m or max(float(np.abs(arm).max()), 1e-300))
    motions = np.zeros((len(nodes), 3, 6))
    motions[:, [0, 1, 2], [0, 1, 2]] = 1.0
    for axis, turn in enumerate(np.eye(3)):
        motions[:, :, 3 + axis] = np.cross(turn, arm)
    return motions


@dataclass(frozen=True, kw_only=True)
class Pencil(PlainPencil):
    """K and M of the free degrees of freedom, with the maps between free and full vectors."""

    free: BoolArray
    system: System

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
        return _expanded(self.free, vectors)


def _expanded(free: BoolArray, vectors: FloatArray) -> FloatArray:
    """Vectors (dof, k) of free degrees of freedom (n, 3) as nodal fields (n, 3, k), zero where clamped."""
    full = np.zeros((*free.shape, vectors.shape[1]), dtype=vectors.dtype)
    full[free] = vectors
    return full


def constrain(system: System, free: BoolArray) -> Pencil:
    """Restrict a system to its free degrees of freedom, and count the rigid-body modes that remain.

    Parameters
    ----------
    system : System
        Scaled K and M of all nodes.
    free : ndarray of bool, shape (n, 3)
        Free degrees of freedom.

    Returns
    -------
    Pencil
        Scaled K and M, (dof, dof).
    """
    keep = np.flatnonzero(free.ravel())
    return Pencil(
        _symmetric(_restrict(system.stiffness, keep)),
        _symmetric(sp.csr_array(mass_rows(system, keep)[:, keep])),
        system.scale,
        _surviving(system.mesh.nodes, free),
        free=free,
        system=system,
    )


def mass_rows(system: System, rows: IntArray) -> sp.csr_array:
    """Select rows of the mass of three components, m (x) I3.

    Parameters
    ----------
    system : System
        With scaled scalar mass (n, n).
    rows : ndarray of int, shape (r,)
        Degrees of freedom.

    Returns
    -------
    sparse array, shape (r, 3n)
        Scaled.
    """
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


# -- bodies ------------------------------------------------------------------------------------------------------------
# A body meshed whole or as its quarter: modes of each symmetry class, and their measures.

CLASSES = ("SS", "SA", "AS", "AA")


class SolidModel:
    """Three-dimensional elasticity of a mesh: `clamped` faces, `mirrored` when the mesh is the quarter x, y >= 0.

    lines_m, cuts_m: y and x where parts of its touch face meet. frame: that face's own; None where it is the mesh's.
    layers: those of a free plate, whose thermal stress counts.
    """

    def __init__(
        self,
        mesh: AnyMesh,
        materials: dict[str, Material],
        clamped: tuple[Support, ...],
        mirrored: bool,
        lines_m: tuple[float, ...] = (),
        frame: Frame | None = None,
        cuts_m: tuple[float, ...] = (),
        layers: Stack | None = None,
    ) -> None:
        self.mesh, self.materials, self.clamped, self.mirrored = mesh, materials, clamped, mirrored
        self.lines_m, self.frame, self.cuts_m, self.layers = lines_m, frame, cuts_m, layers
        self.name = f"solid {mesh.kind}{mesh.order}"
        self.symmetries: tuple[str | None, ...] = CLASSES if mirrored else (None,)

    @cached_property
    def system(self) -> System:
        """K and M before constraints."""
        system = assemble(self.mesh, self.materials)
        return with_free_stress(system, self.layers) if self.layers and self.layers.is_stressed else system

    @cached_property
    def scale(self) -> Scale:
        """Units of the pencils; kept when a large system is let go."""
        return self.system.scale

    def pencil(self, symmetry: str | None) -> Pencil:
        """K and M of one symmetry class."""
        pencil = constrain(self.system, self._free(symmetry))
        if self.mesh.dof > LARGE and self.scale:
            del self.system  # assembled again for the next class: both stiffnesses at once are a quarter of the peak
            pencil = replace(pencil, system=replace(pencil.system, stiffness=sp.csr_array(pencil.stiffness.shape)))
        return pencil

    def field(self, symmetry: str | None, vectors: FloatArray) -> FloatArray:
        """Nodal displacements (n, 3, k) from free degrees of freedom (dof, k)."""
        return _expanded(self._free(symmetry), vectors)

    def _free(self, symmetry: str | None) -> BoolArray:
        return free_mask(self.mesh, self.clamped, {"x-": symmetry[0], "y-": symmetry[1]} if symmetry else {})

    @cached_property
    def _touch_rule(self) -> FaceQuadrature:
        seen = replace(self.mesh, nodes=self.frame.places(self.mesh.nodes)) if self.frame else self.mesh
        return face_quadrature(seen, "touch", self.lines_m, self.cuts_m)

    def touch(self, symmetry: str | None, vectors: FloatArray) -> TouchField:
        """u_z on the touch face of the meshed part, in the face's frame."""
        rule, field = self._touch_rule, self.field(symmetry, vectors)
        normal = np.einsum("nak,a->nk", field, self.frame.axes[2]) if self.frame else field[:, 2]
        values = np.asarray(rule.interpolation @ normal)
        return TouchField(rule.points[:, :2], rule.weights, values, self.scale.mass_kg)

    def pillar_share(self, symmetry: str | None, vectors: FloatArray) -> FloatArray:
        """Share of the pillars in the kinetic energy of M-orthonormal modes, (k,)."""
        mass = self.system.region_mass(*self.mesh.standing)
        if mass is None:
            return np.zeros(vectors.shape[1])
        field = self.field(symmetry, vectors)
        heavy = (mass @ field.reshape(len(field), -1)).reshape(field.shape)
        return np.asarray(np.einsum("nak,nak->k", field, heavy))

    def lost(self, symmetry: str | None, vectors: FloatArray) -> FloatArray:
        """Loss between motions, u' (sum of loss factor times stiffness) u, (k, k)."""
        flat, loss = self.field(symmetry, vectors).reshape(-1, vectors.shape[1]), self._loss
        return np.asarray(flat.T @ (loss @ flat))

    @cached_property
    def _loss(self) -> sp.csr_array:
        system = assemble(self.mesh, self.materials, self.scale, lossy=True)
        return sp.csr_array(system.loss * system.stiffness if isinstance(system.loss, float) else system.loss)

    def skin(self, symmetry: str | None, vectors: FloatArray) -> Skin:
        """Outer skin of the meshed part."""
        facets = skin_faces(self.mesh)
        used, local = np.unique(facets, return_inverse=True)
        moved = self.field(symmetry, vectors)[used]
        return Skin(self.mesh.nodes[used], local.reshape(facets.shape), moved.transpose(2, 0, 1))
