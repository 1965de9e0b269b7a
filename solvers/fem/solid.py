"""A body meshed whole or as its quarter: modes of each symmetry class, and what is measured on them."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from geometry.elements import FloatArray
from geometry.materials import Material
from geometry.mesh import AnyMesh
from solvers.fem.assembly import Scale, System, assemble
from solvers.fem.constraints import Pencil, Support, constrain, free_mask
from solvers.fem.solve_cost import LARGE
from solvers.fem.surface import FaceQuadrature, Frame, Skin, face_quadrature, skin_faces
from solvers.measures.confinement import TouchField

CLASSES = ("SS", "SA", "AS", "AA")


class SolidModel:
    """Three-dimensional elasticity of a mesh: `clamped` faces, `mirrored` when the mesh is the quarter x, y >= 0.

    lines_m: y where parts of its touch face meet. frame: that face's own; None where it is the mesh's.
    """

    def __init__(
        self,
        mesh: AnyMesh,
        materials: dict[str, Material],
        clamped: tuple[Support, ...],
        mirrored: bool,
        lines_m: tuple[float, ...] = (),
        frame: Frame | None = None,
    ) -> None:
        self.mesh, self.materials, self.clamped, self.mirrored = mesh, materials, clamped, mirrored
        self.lines_m, self.frame = lines_m, frame
        self.name = f"solid {mesh.kind}{mesh.order}"
        self.symmetries: tuple[str | None, ...] = CLASSES if mirrored else (None,)

    @cached_property
    def system(self) -> System:
        """K and M before constraints."""
        return assemble(self.mesh, self.materials)

    @cached_property
    def scale(self) -> Scale:
        """Units of the pencils; kept when a large system is let go."""
        return self.system.scale

    def pencil(self, symmetry: str | None) -> Pencil:
        """K and M of one symmetry class."""
        mirrors = {"x-": symmetry[0], "y-": symmetry[1]} if symmetry else {}
        pencil = constrain(self.system, free_mask(self.mesh, self.clamped, mirrors))
        if self.mesh.dof > LARGE and self.scale:
            del self.system  # assembled anew for the next class: both stiffnesses at once are a quarter of the peak
            pencil = replace(pencil, system=replace(pencil.system, stiffness=sp.csr_array(pencil.stiffness.shape)))
        return pencil

    def field(self, symmetry: str | None, vectors: FloatArray) -> FloatArray:
        """Nodal displacements (n, 3, k) from free degrees of freedom (dof, k)."""
        mirrors = {"x-": symmetry[0], "y-": symmetry[1]} if symmetry else {}
        free = free_mask(self.mesh, self.clamped, mirrors)
        full = np.zeros((*free.shape, vectors.shape[1]))
        full[free] = vectors
        return full

    @cached_property
    def _touch_rule(self) -> FaceQuadrature:
        seen = replace(self.mesh, nodes=self.frame.places(self.mesh.nodes)) if self.frame else self.mesh
        return face_quadrature(seen, "touch", self.lines_m)

    def touch(self, symmetry: str | None, vectors: FloatArray) -> TouchField:
        """u_z on the touch face of the meshed part, in the face's frame."""
        rule, field = self._touch_rule, self.field(symmetry, vectors)
        normal = np.einsum("nak,a->nk", field, self.frame.axes[2]) if self.frame else field[:, 2]
        values = np.asarray(rule.interpolation @ normal)
        return TouchField(rule.points[:, :2], rule.weights, values, self.scale.mass_kg)

    def pillar_share(self, symmetry: str | None, vectors: FloatArray) -> FloatArray:
        """Share of the pillars in the kinetic energy of M-orthonormal modes, (k,)."""
        mass = self.system.region_mass("pillar", "tip")
        if mass is None:
            return np.zeros(vectors.shape[1])
        field = self.field(symmetry, vectors)
        heavy = (mass @ field.reshape(len(field), -1)).reshape(field.shape)
        return np.asarray(np.einsum("nak,nak->k", field, heavy))

    def skin(self, symmetry: str | None, vectors: FloatArray) -> Skin:
        """Outer skin of the meshed part."""
        facets = skin_faces(self.mesh)
        used, local = np.unique(facets, return_inverse=True)
        moved = self.field(symmetry, vectors)[used]
        return Skin(self.mesh.nodes[used], local.reshape(facets.shape), moved.transpose(2, 0, 1))
