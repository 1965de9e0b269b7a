"""The error of a mesh of tetrahedra, told by its own stresses: continuous ones stand for the true ones.

Of the continuous fields s* that are linear in each tetrahedron of one material, the one nearest to the computed stresses s in
the energy's norm loses int (s - s*) : C^-1 (s - s*) = u'Ku - b'(C x M^-1) b, with b_a = int N_a e(u) of the strains e and
M_ab = int N_a N_b over linear N (zienkiewicz1987). An eigenvalue lies as far above the true one as the energy of the error
of its mode (boffi2010), of which this loss is most.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from geometry.elements import FloatArray, IntArray
from geometry.materials import Material
from geometry.mesh import AnyMesh, Mesh, jacobians
from solvers.fem.assembly import Scale, elasticity
from solvers.fem.coarser import Shares
from solvers.fem.constraints import Pencil
from solvers.fem.factor.factoriser import Factoriser

# of the loss: the error was 0.65 to 0.9 times it in bodies of one material, 0.6 to 1.6 times where plate and pillar differ,
# and from once to 2.2 times it at clamped edges (`python -m studies.error_bars`); no more than the whole leaves K positive
ALIKE, UNLIKE, CLAMPED = Shares(0.8, 0.25), Shares(1.0, 0.65), Shares(1.5, 0.75)
STRAINS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
ELEMENTS = 4096  # at a time


@dataclass(frozen=True)
class StressRecovery:
    """What continuous stresses tell of a mesh of tetrahedra with a material for each region, in the units of a scale.

    clamped: whether faces are held, at whose edges most is missed.
    """

    mesh: AnyMesh
    materials: dict[str, Material]
    scale: Scale
    clamped: bool = False

    @property
    def shares(self) -> Shares:
        """Of the loss that is taken for the error, and what of it is uncertain."""
        if self.clamped:
            return CLAMPED
        return UNLIKE if len({self.materials[name] for name in self.mesh.region_of_cells()}) > 1 else ALIKE

    def energy(self, shapes: FloatArray) -> FloatArray:
        """Energy of the continuous stresses of motions (3n, m), (m, m): u'Ku less their loss."""
        total = np.zeros((shapes.shape[1],) * 2)
        for elastic, strains, weights in self._projected(shapes):
            total += sum(elastic[i, j] * (strains[i].T @ weights[j]) for i, j in zip(*np.nonzero(elastic), strict=True))
        return total

    def energies(self, shapes: FloatArray) -> FloatArray:
        """The diagonal of the same, (m,)."""
        return np.asarray(
            sum(
                np.einsum("ij,iam,jam->m", elastic, strains, weights)
                for elastic, strains, weights in self._projected(shapes)
            )
        )

    def errors(
        self, symmetry: str | None, pencil: Pencil, vectors: FloatArray, values: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Relative, (k,) each, of M-orthonormal modes (dof, k) with eigenvalues (k,) of a symmetry class: how far their
        frequencies are to be lowered, and the half-width of the bar that is left.
        """
        field = pencil.expand(vectors)
        loss = (values - self.energies(field.reshape(-1, field.shape[2]))) / (2.0 * values)
        return self.shares.taken * loss, self.shares.spread * np.abs(loss)

    def _projected(self, shapes: FloatArray) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
        """C (6, 6), b (6, corners, m) and M^-1 b of each material."""
        field = shapes.reshape(len(self.mesh.nodes), 3, -1)
        for own in self._by_material:
            strains = np.stack([sum(part @ field[:, axis] for part, axis in own.parts(each)) for each in STRAINS])
            yield own.elastic, strains, np.stack([own.solve(strain) for strain in strains])

    @cached_property
    def _by_material(self) -> list[_Recovered]:
        """The elements of each material; a region of the same material goes on in the next one."""
        by_material: dict[Material, list[IntArray]] = {}
        for name, cells in self.mesh.region_of_cells().items():
            by_material.setdefault(self.materials[name], []).append(cells)
        (mesh,) = self.mesh.blocks
        return [
            _Recovered(mesh, np.concatenate(cells), material, self.scale) for material, cells in by_material.items()
        ]


class _Recovered:
    """int N_a d/dx_k over quadratic fields (corners, n) and M over linear N, of one material's elements."""

    def __init__(self, mesh: Mesh, cells: IntArray, material: Material, scale: Scale) -> None:
        tensor = elasticity(material) / scale.young_pa
        self.elastic = np.array([[tensor[i, k, j, m] for j, m in STRAINS] for i, k in STRAINS])
        corners, local = np.unique(mesh.cells[cells, :4], return_inverse=True)
        rows = local.reshape(-1, 4)
        slope, mass = _integrals(mesh, cells, scale.length_m)
        self.slopes = [_summed(part, rows, mesh.cells[cells], (len(corners), len(mesh.nodes))) for part in slope]
        factor = Factoriser()(sp.csc_array(_summed(mass, rows, rows, (len(corners),) * 2)))
        self.solve = factor.solve

    def parts(self, strain: tuple[int, int]) -> Iterator[tuple[sp.csr_array, int]]:
        """Slopes and the displacements that they act on, of a strain."""
        first, second = strain
        yield self.slopes[second], first
        if first != second:
            yield self.slopes[first], second


def _integrals(mesh: Mesh, cells: IntArray, length_m: float) -> tuple[FloatArray, FloatArray]:
    """Of every element (3, e, 4, nodes) int N_a dF_b/dx_k and (e, 4, 4) int N_a N_b: N linear, F the mesh's functions."""
    rule = mesh.element.quadrature
    linear = np.column_stack([1.0 - rule.points.sum(axis=1), rule.points])
    _, gradient = mesh.element.shape(rule.points)
    slopes, masses = [], []
    for some in np.array_split(cells, -(-len(cells) // ELEMENTS)):
        jacobian = jacobians(mesh, some, rule.points) / length_m
        weight = np.linalg.det(jacobian) * rule.weights
        slope = np.linalg.inv(jacobian) @ gradient.transpose(0, 2, 1)  # (e, q, 3, nodes)
        slopes.append(np.einsum("eq,qa,eqkb->keab", weight, linear, slope, optimize=True))
        masses.append(np.einsum("eq,qa,qb->eab", weight, linear, linear, optimize=True))
    return np.concatenate(slopes, axis=1), np.concatenate(masses)


def _summed(values: FloatArray, rows: IntArray, columns: IntArray, shape: tuple[int, int]) -> sp.csr_array:
    """Element matrices (e, a, b) summed over what they share."""
    across, down = np.broadcast_arrays(columns[:, None, :], rows[:, :, None])
    return sp.csr_array(sp.coo_array((values.ravel(), (down.ravel(), across.ravel())), shape=shape))
