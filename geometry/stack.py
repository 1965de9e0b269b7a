"""The plate's layers from the touch face to the back as one object: what plate theory, meshes, masses and exports ask of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from geometry.elements import FloatArray
from geometry.errors import GeometryError
from geometry.materials import Material, rows_of


class Layer(NamedTuple):
    """One layer of the plate."""

    material: Material
    thickness_m: float


@dataclass(frozen=True)
class Stack:
    """Layers bonded to one another, from the touch face z = 0 to the back."""

    layers: tuple[Layer, ...]

    @classmethod
    def of(cls, thickness_m: float, material: Material) -> Stack:
        """A plate of one layer."""
        return cls((Layer(material, thickness_m),))

    @property
    def thickness_m(self) -> float:
        """Of all layers, m."""
        return sum(thickness for _, thickness in self.layers)

    @property
    def levels_m(self) -> FloatArray:
        """Heights where layers begin and end, ascending from 0, (layers + 1,), m."""
        return np.cumsum([0.0, *(thickness for _, thickness in self.layers)])

    @property
    def mass_kg_m2(self) -> float:
        """Mass per area, kg/m2."""
        return sum(material.density_kg_m3 * thickness for material, thickness in self.layers)

    @property
    def regions(self) -> dict[str, Material]:
        """Material of each layer by its region of a mesh: plate, then layer2 and so on."""
        names = ["plate", *(f"layer{number}" for number in range(2, len(self.layers) + 1))]
        return {name: material for name, (material, _) in zip(names, self.layers, strict=True)}

    @property
    def back(self) -> Material:
        """Material of the back, on which pillars stand."""
        return self.layers[-1].material

    @property
    def material(self) -> Material:
        """Its only material, for what holds for one layer alone. GeometryError for several layers."""
        if len(self.layers) > 1:
            raise GeometryError(f"a plate of {len(self.layers)} layers: must have one layer here")
        return self.back

    @cached_property
    def mean(self) -> Material:
        """The material with its mean density and stiffness, its own where it has one layer: for estimates and as a unit."""
        if len(self.layers) == 1:
            return self.back
        parts = [part / self.thickness_m * np.array(material.stiffness_pa) for material, part in self.layers]
        law = Material("mean", self.mass_kg_m2 / self.thickness_m, rows_of(np.sum(parts, axis=0)))
        return replace(law, constants=law.average) if all(material.constants for material, _ in self.layers) else law

    @property
    def mirrors(self) -> tuple[str, ...]:
        """Mirrors that leave every layer alone: x, y, and "d", which exchanges x and y."""
        return tuple(name for name in ("x", "y", "d") if all(name in material.mirrors for material, _ in self.layers))

    @cached_property
    def _moments(self) -> tuple[FloatArray, FloatArray]:
        """int (1, z, z^2) dz about the middle, of the plane stiffness, (3, 3, 3), and of the density, (3,)."""
        z = self.levels_m - self.thickness_m / 2.0
        powers = np.array([np.diff(z**n) / n for n in (1, 2, 3)])
        planes = np.array([material.plane_stress_pa for material, _ in self.layers])
        return np.einsum("nl,lij->nij", powers, planes), powers @ [
            material.density_kg_m3 for material, _ in self.layers
        ]

    @cached_property
    def bending_n_m(self) -> FloatArray:
        """Bending stiffnesses over the curvatures xx, yy, 2 xy with no force in the plane, D - B A^-1 B, (3, 3), N m."""
        a, b, d = self._moments[0]
        return np.asarray(d - b @ np.linalg.solve(a, b))

    @property
    def rotary_kg(self) -> float:
        """Rotary inertia per area about the centre of mass, kg: rho h^3/12 of one layer."""
        first, middle, square = self._moments[1]
        return float(square - middle**2 / first)

    @property
    def shear_n_m(self) -> tuple[float, float]:
        """Transverse shear stiffnesses along x and y, N/m: 5/6 G h of one layer, of several with the mean of 1/G."""
        soft = [thickness / np.array(material.transverse_shear_pa) for material, thickness in self.layers]
        along, across = (5.0 / 6.0 * self.thickness_m**2 / np.sum(soft, axis=0)).tolist()
        return along, across
