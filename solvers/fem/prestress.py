"""Thermal stress of a mesh: its geometric stiffness, its loads, and the stress of free layers.

A stress s at rest adds int s_kl u_i,k u_i,l to twice the strain energy, one scalar matrix G for all three components
(cook2002). Stresses are constant in an element.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import scipy.sparse as sp

from geometry.elements import FloatArray
from geometry.materials import USUAL_C, Material, Stack
from geometry.mesh import AnyMesh, cell_volumes
from solvers.fem.assembly import Forms, Scale, System

COMPONENTS = ((0, 0), (1, 1), (0, 1))  # of the stress in the plane: xx, yy, xy
PLACES = ((0, 0), (1, 0), (0, 1))  # powers of x and y from the panel's middle, over its half edges
FIELDS = list(product(range(len(COMPONENTS)), range(len(PLACES))))  # component and place of each field, 9


@dataclass(frozen=True)
class StressFields:
    """Fields of in-plane stress of a panel's layers, linear in x and y: what each does, and how much of it a motion makes.

    Attributes
    ----------
    stiffness : tuple of csr_array, shape (n, n) each
        Scalar geometric stiffness of each field of FIELDS with a mean of 1 through the layers, scaled. Layers share it in the
        ratio of their stiffnesses.
    pull : ndarray, shape (3n, 9)
        int p s_c from nodal displacements, c and p the component and place of each field. What a pillar carries counts to the
        layers beneath it.
    load : ndarray, shape (3n,)
        Forces of free expansion in the whole panel, scaled.
    rest : ndarray, shape (9,)
        int p s_c lost to expansion.
    gram : ndarray, shape (3, 3)
        int p p' over the layers.
    """

    stiffness: tuple[sp.csr_array, ...]
    pull: FloatArray
    load: FloatArray
    rest: FloatArray
    gram: FloatArray

    def relaxed(self, stiffness: sp.csr_array, inner: FloatArray) -> StressFields:
        """Return the fields after the expansion `inner` (3n,) within held sides: what a motion of these adds to."""
        return replace(self, load=self.load - stiffness @ inner, rest=self.rest - self.pull.T @ inner)


def _expansion(material: Material) -> float:
    """Free thermal strain a (T - 20 C) of a material; an expansion that is not known counts as 0."""
    return (material.expansion_per_k or 0.0) * (material.temperature_c - USUAL_C)


def stress_fields(
    mesh: AnyMesh, materials: dict[str, Material], stack: Stack, half_m: FloatArray, scale: Scale
) -> StressFields:
    """Assemble the stress fields of a panel whose middle is the origin.

    Parameters
    ----------
    mesh : Mesh
        The panel, or its part at x >= 0, y >= 0.
    materials : dict of str to Material
        One per region.
    stack : Stack
        Layers of the plate.
    half_m : ndarray, shape (2,)
        Half edges along x and y in m.
    scale : Scale
        Units.

    Returns
    -------
    StressFields
        Of the meshed part.
    """
    forms, regions = Forms(mesh, scale.length_m), mesh.region_of_cells()
    tensor, warm = np.zeros((mesh.cell_count, 3, 3, 3, 3)), np.zeros(mesh.cell_count)
    stiff = np.zeros(mesh.cell_count)  # of the layers: their share of a stress
    for name, cells in regions.items():
        tensor[cells], warm[cells] = materials[name].tensor_pa / scale.young_pa, _expansion(materials[name])
        if name in stack.region_names:
            stiff[cells] = materials[name].plane_stress_pa[:2, :2].trace()
    volume = np.concatenate([cell_volumes(block) for block in mesh.blocks]) / scale.length_m**3
    centre = _centres(mesh)[:, :2] / half_m
    places = np.array([(centre**power).prod(axis=1) for power in PLACES])
    shares = stiff * volume.sum(where=stiff > 0.0) / (stiff @ volume)
    inside = (stiff > 0.0) * places
    held = warm[:, None, None] * np.einsum("eijkk->eij", tensor)
    nodes, pull = mesh.nodes / scale.length_m, np.empty((3 * len(mesh.nodes), len(FIELDS)))
    for place, at in enumerate(places):
        own = forms.stiffness(at[:, None, None, None, None] * tensor)
        for component, (i, j) in enumerate(COMPONENTS):
            pull[:, len(PLACES) * component + place] = own @ _unit_strain(nodes, i, j)
    return StressFields(
        tuple(_geometric(forms, _in_plane(*COMPONENTS[c], shares * places[p])) for c, p in FIELDS),
        pull,
        np.asarray(forms.stiffness(warm[:, None, None, None, None] * tensor) @ nodes.ravel()),
        np.array([held[:, COMPONENTS[c][0], COMPONENTS[c][1]] @ (places[p] * volume) for c, p in FIELDS]),
        (inside * volume) @ inside.T,
    )


def _geometric(forms: Forms, stress: FloatArray) -> sp.csr_array:
    """G_ab = int s_kl N_a,k N_b,l, scaled (n, n), of a stress (elements, 3, 3) over the unit of moduli."""
    return forms.stiffness(stress[:, None, :, None, :])


def with_free_stress(system: System, stack: Stack) -> System:
    """Add the geometric stiffness of the thermal stress of a free layered plate, by laminate theory.

    Forces and moments are zero: the plate has grown and bowed. Free edges and feet are left out, about which the stress differs
    as far as the plate is thick.

    Parameters
    ----------
    system : System
        Of a mesh with the touch face at z = 0.
    stack : Stack
        Layers at their temperature.

    Returns
    -------
    System
        The system itself where the layers do not stress one another.
    """
    warmer, warming, mesh = stack.back.temperature_c - USUAL_C, stack.warming, system.mesh
    if not stack.is_stressed or warming is None:
        return system
    stress, height = np.zeros((mesh.cell_count, 3, 3)), _centres(mesh)[:, 2]
    regions = mesh.region_of_cells()
    for name, low, (_, thickness), faces in zip(
        stack.region_names, stack.levels_m[:-1], stack.layers, warming.stress_pa, strict=True
    ):
        if name in regions:
            cells = regions[name]
            above = (height[cells, None] - low) / thickness
            own = warmer * (faces[0] + above * (faces[1] - faces[0]))
            stress[cells] = sum(_in_plane(*axes, size) for axes, size in zip(COMPONENTS, own.T, strict=True))
    return _with_stress(system, stress)


def _with_stress(system: System, stress_pa: FloatArray) -> System:
    """The system with the geometric stiffness of a stress (elements, 3, 3) in Pa: K and G."""
    scale = system.scale
    own = _geometric(Forms(system.mesh, scale.length_m), stress_pa / scale.young_pa)
    stiffness = sp.csr_array(system.stiffness + sp.kron(own, sp.eye_array(3), format="csr"))
    return replace(system, stiffness=stiffness, stressed=True)


def _centres(mesh: AnyMesh) -> FloatArray:
    """Middle of each element, (elements, 3), m."""
    return np.concatenate([block.nodes[block.cells].mean(axis=1) for block in mesh.blocks])


def _unit_strain(nodes: FloatArray, i: int, j: int) -> FloatArray:
    """Displacements (3n,) of a strain that a stress works on with its component ij."""
    moved = np.zeros_like(nodes)
    moved[:, i] += nodes[:, j] / 2.0
    moved[:, j] += nodes[:, i] / 2.0
    return moved.ravel()


def _in_plane(i: int, j: int, size: FloatArray) -> FloatArray:
    """Stress (elements, 3, 3) of one component."""
    stress = np.zeros((len(size), 3, 3))
    stress[:, i, j] = stress[:, j, i] = size
    return stress
