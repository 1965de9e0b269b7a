"""Stiffness and mass matrices of three-dimensional linear elasticity, assembled over node pairs without loops."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TypeVar

import numpy as np
import scipy.sparse as sp

from geometry.elements import FloatArray, IntArray
from geometry.materials import Material
from geometry.mesh import AnyMesh, Mesh, is_affine, jacobians

CHUNK_VALUES = 2_000_000  # element-matrix entries held at once by the quadrature path
SORTED_VALUES = 4_000_000  # entries of all element matrices sorted or summed at once
Hertz = TypeVar("Hertz", float, FloatArray)


@dataclass(frozen=True)
class Scale:
    """Units in which a pencil is assembled: lengths in `length_m`, moduli in `young_pa`, densities in `density_kg_m3`.

    An eigenvalue lambda of the scaled pencil is the angular frequency squared in units of young/(density length^2).
    """

    length_m: float
    young_pa: float
    density_kg_m3: float

    @classmethod
    def of(cls, length_m: float, material: Material) -> Scale:
        """The units of a body of this length and material."""
        return cls(length_m, material.average.young_pa, material.density_kg_m3)

    @property
    def angular(self) -> float:
        """rad/s per unit of sqrt(lambda)."""
        return float(np.sqrt(self.young_pa / self.density_kg_m3) / self.length_m)

    @property
    def mass_kg(self) -> float:
        """kg of one scaled unit of mass: the modal mass of an M-orthonormal mode."""
        return self.density_kg_m3 * self.length_m**3

    def eigenvalue(self, frequency_hz: Hertz) -> Hertz:
        """Scaled eigenvalues of frequencies, lambda = (2 pi f / angular)^2."""
        return (2.0 * np.pi * frequency_hz / self.angular) ** 2

    def frequency(self, eigenvalue: FloatArray) -> FloatArray:
        """Frequencies in Hz of scaled eigenvalues; rounding below zero counts as zero."""
        return np.asarray(np.sqrt(np.maximum(eigenvalue, 0.0)) * self.angular / (2.0 * np.pi))


@dataclass(frozen=True)
class System:
    """Scaled stiffness K (3n, 3n) with degrees of freedom (node, axis), and the scalar mass m (n, n): M = m (x) I3.

    density (e,) is per element, in units of the scale. loss: the stiffness with each material's part times its loss factor,
    or the loss factor that all of them have; None where it was not asked for. by_material: the stiffness of each material
    that was asked for by itself. upright: nodes that move along z alone; grounded: whether springs hold it to the ground;
    stressed: whether K has the stress of layers at rest.
    """

    stiffness: sp.csr_array
    mass: sp.csr_array
    scale: Scale
    mesh: AnyMesh
    density: FloatArray
    loss: sp.csr_array | float | None = None
    by_material: tuple[sp.csr_array, ...] = ()
    upright: tuple[int, ...] = ()
    grounded: bool = False
    stressed: bool = False

    def region_mass(self, *regions: str) -> sp.csr_array | None:
        """Scalar mass of some regions alone; None when the mesh has none of them."""
        known = [self.mesh.regions[region] for region in regions if region in self.mesh.regions]
        if not known:
            return None
        density, cells = np.zeros_like(self.density), np.concatenate(known)
        density[cells] = self.density[cells]
        return Forms(self.mesh, self.scale.length_m).mass(density)


def on_components(scalar: sp.csr_array | sp.csc_array, shapes: FloatArray) -> FloatArray:
    """Apply a scalar matrix to each component of nodal shapes: (A (x) I3) V.

    Parameters
    ----------
    scalar : sparse array, shape (m, n)
        A.
    shapes : ndarray, shape (3n, k)
        V.

    Returns
    -------
    ndarray, shape (3m, k)
        In the units of A times those of V.
    """
    flat = shapes.reshape(scalar.shape[1], 3 * shapes.shape[1])
    return np.asarray(scalar @ flat).reshape(3 * scalar.shape[0], shapes.shape[1])


def assemble(
    mesh: AnyMesh,
    materials: dict[str, Material],
    scale: Scale | None = None,
    lossy: bool = False,
    parted: Sequence[Material] = (),
) -> System:
    """Assemble K_(a i)(b j) = int C_ikjl N_a,k N_b,l and m_ab = int rho N_a N_b.

    The pencil is scaled by the mesh's smallest extent and the first material unless a scale is given, so that a micrometre
    plate and a metre plate have the same condition number.

    Parameters
    ----------
    mesh : Mesh
        Nodes in m.
    materials : dict of str to Material
        One per region of the mesh.
    scale : Scale, optional
        Units of the pencil.
    lossy : bool, optional
        Whether the materials' loss factors are assembled as well; each must have one.
    parted : sequence of Material, optional
        Materials whose stiffnesses are assembled by themselves as well.

    Returns
    -------
    System
        Scaled stiffness (3n, 3n) and scalar mass (n, n).

    Raises
    ------
    KeyError
        For a region without material.
    """
    regions = mesh.region_of_cells()
    first = materials[next(iter(regions))]
    scale = scale or Scale.of(float(np.ptp(mesh.nodes, axis=0).min()), first)
    forms = Forms(mesh, scale.length_m)
    tensor = np.zeros((mesh.cell_count, 3, 3, 3, 3)) if len(regions) > 1 else None
    density, factor = np.zeros(mesh.cell_count), np.zeros(mesh.cell_count)
    single = first.tensor_pa / scale.young_pa
    for name, cells in regions.items():
        density[cells] = materials[name].density_kg_m3 / scale.density_kg_m3
        if lossy:
            factor[cells] = materials[name].lost
        if tensor is not None:
            tensor[cells] = materials[name].tensor_pa / scale.young_pa
    stiffness = forms.stiffness(single if tensor is None else tensor)
    loss: sp.csr_array | float | None = float(factor[0]) if lossy else None
    if tensor is not None and np.ptp(factor):
        loss = forms.stiffness(factor[:, None, None, None, None] * tensor)
    parts = tuple(forms.stiffness(_own_tensor(mesh, materials, each) / scale.young_pa) for each in parted)
    return System(stiffness, forms.mass(density), scale, mesh, density, loss, parts)


def _own_tensor(mesh: AnyMesh, materials: dict[str, Material], material: Material) -> FloatArray:
    """Stiffness tensor of each element of a material, and 0 of the others, (cells, 3, 3, 3, 3), Pa."""
    tensor = np.zeros((mesh.cell_count, 3, 3, 3, 3))
    for name, cells in mesh.region_of_cells().items():
        if materials[name] == material:
            tensor[cells] = material.tensor_pa
    return tensor


class Forms:
    """The bilinear forms of one mesh for any elastic tensors and densities; lengths in units of `length_m`."""

    def __init__(self, mesh: AnyMesh, length_m: float) -> None:
        self._parts = [(_Geometry(block, length_m), _Pattern(block.cells, len(mesh.nodes))) for block in mesh.blocks]
        self._ends = np.cumsum([len(block.cells) for block in mesh.blocks])[:-1]

    def stiffness(self, tensor: FloatArray) -> sp.csr_array:
        """int C_ikjl N_a,k N_b,l of f fields at each node, (f n, f n), from tensors (f, 3, f, 3) or one an element."""
        tensors = np.split(tensor, self._ends) if tensor.ndim == 5 else [tensor] * len(self._parts)
        count = tensor.shape[-2]
        pairs = list(product(range(count), repeat=2))
        return _sum(
            pattern.vector_matrix(((i, j, geometry.stiffness(own, i, j)) for i, j in pairs), count)
            for (geometry, pattern), own in zip(self._parts, tensors, strict=True)
        )

    def mass(self, density: FloatArray) -> sp.csr_array:
        """int rho N_a N_b, (n, n), from a density an element."""
        densities = np.split(density, self._ends)
        return _sum(
            pattern.scalar_matrix(geometry.mass(own))
            for (geometry, pattern), own in zip(self._parts, densities, strict=True)
        )


def _sum(matrices: Iterable[sp.csr_array]) -> sp.csr_array:
    """The sum over the blocks of a mesh."""
    first, *rest = matrices
    for other in rest:
        first = sp.csr_array(first + other)
    return first


class _Geometry:
    """Element matrices of a mesh: reference integrals where elements are affine, quadrature where they are curved."""

    def __init__(self, mesh: Mesh, length: float) -> None:
        self.mesh, self.length = mesh, length
        element, rule = mesh.element, mesh.element.quadrature
        value, gradient = element.shape(rule.points)
        self.count = value.shape[1]
        self.reference_mass = (value * rule.weights[:, None]).T @ value
        weighted = gradient * rule.weights[:, None, None]
        # 3 x 3 reference integrals of d_m N_a d_n N_b, flattened to (9, k k)
        self.reference_stiffness = np.einsum("qam,qbn->mnab", weighted, gradient, optimize=True).reshape(9, -1)
        self.affine = np.flatnonzero(is_affine(mesh))
        self.curved = np.setdiff1d(np.arange(len(mesh.cells)), self.affine)
        self.inverse, self.volume = self._affine_maps()

    def _affine_maps(self) -> tuple[FloatArray, FloatArray]:
        """Inverse Jacobians d xi_m / d x_k (e, 3, 3) and determinants (e,) of the affine elements, scaled."""
        if self.mesh.spans is not None:
            half = self.mesh.spans / (2.0 * self.length)
            inverse = np.zeros((len(half), 3, 3))
            inverse[:, [0, 1, 2], [0, 1, 2]] = 1.0 / half
            return inverse, half.prod(axis=1)
        centre = self.mesh.element.quadrature.points.mean(axis=0, keepdims=True)
        jacobian = jacobians(self.mesh, self.affine, centre)[:, 0] / self.length  # [m, k]
        return np.asarray(np.linalg.inv(jacobian).transpose(0, 2, 1)), np.asarray(np.linalg.det(jacobian))

    def stiffness(self, tensor: FloatArray, i: int, j: int) -> FloatArray:
        """The (i, j) components of every element's stiffness, shape (e, k k)."""
        coupling = tensor[..., i, :, j, :]
        out = np.zeros((len(self.mesh.cells), self.count**2))
        local = coupling[self.affine] if coupling.ndim == 3 else coupling
        # G_mn = det J (d xi_m / d x_k) C_kl (d xi_n / d x_l)
        metric = self.inverse @ local @ self.inverse.transpose(0, 2, 1) * self.volume[:, None, None]
        out[self.affine] = metric.reshape(len(self.affine), 9) @ self.reference_stiffness
        curved = self.curved[coupling[self.curved].any(axis=(1, 2))] if coupling.ndim == 3 else self.curved
        if len(curved):
            out[curved] = self._curved_stiffness(coupling, curved)
        return out

    def _curved_stiffness(self, coupling: FloatArray, curved: IntArray) -> FloatArray:
        rule = self.mesh.element.quadrature
        _, gradient = self.mesh.element.shape(rule.points)
        parts = []
        for cells in _chunks(curved, self.count**2):
            jacobian = jacobians(self.mesh, cells, rule.points) / self.length
            slope = np.linalg.solve(
                jacobian, np.broadcast_to(gradient.transpose(0, 2, 1), (len(cells), *gradient.transpose(0, 2, 1).shape))
            )
            weight = np.linalg.det(jacobian) * rule.weights
            local = coupling[cells] if coupling.ndim == 3 else coupling[None]
            flux = np.einsum("ekl,eqlb->eqkb", np.broadcast_to(local, (len(cells), 3, 3)), slope, optimize=True)
            flux *= weight[:, :, None, None]
            points = len(rule.weights) * 3
            parts.append(
                slope.reshape(len(cells), points, -1).transpose(0, 2, 1) @ flux.reshape(len(cells), points, -1)
            )
        return np.concatenate(parts).reshape(len(curved), -1)

    def mass(self, density: FloatArray) -> FloatArray:
        """Every element's scalar mass matrix, shape (e, k k)."""
        out = np.empty((len(self.mesh.cells), self.count**2))
        out[self.affine] = (density[self.affine] * self.volume)[:, None] * self.reference_mass.reshape(1, -1)
        rule = self.mesh.element.quadrature
        value, _ = self.mesh.element.shape(rule.points)
        products = (value[:, :, None] * value[:, None, :]).reshape(len(rule.weights), -1)
        for cells in _chunks(self.curved, self.count**2):
            jacobian = jacobians(self.mesh, cells, rule.points) / self.length
            out[cells] = (np.linalg.det(jacobian) * rule.weights * density[cells, None]) @ products
        return out


def _chunks(cells: IntArray, values_each: int) -> list[IntArray]:
    if not len(cells):
        return []
    return np.array_split(cells, max(1, len(cells) * values_each * 30 // CHUNK_VALUES))


def _row_chunks(first: IntArray, width: int) -> Iterator[tuple[int, int]]:
    """Ranges of nodes whose entries are about SORTED_VALUES; every node in one of them."""
    low, count = 0, len(first) - 1
    while low < count:
        high = int(np.searchsorted(first, first[low] + SORTED_VALUES // width, side="right")) - 1
        high = min(max(high, low + 1), count)
        yield low, high
        low = high


class _Pattern:
    """Sparsity of the node graph, and where each element's entry goes."""

    def __init__(self, cells: IntArray, node_count: int) -> None:
        width = cells.shape[1]
        flat = cells.ravel()
        by_node = np.argsort(flat, kind="stable")
        index_type = np.int32 if flat.size * width < 2**31 else np.int64
        self.order = np.empty(flat.size * width, dtype=index_type)
        first = np.concatenate([[0], np.cumsum(np.bincount(flat, minlength=node_count))])  # of each node's elements
        inner = np.arange(width, dtype=index_type)
        starts, columns, rows = [], [], []
        for low, high in _row_chunks(first, width):
            here: IntArray = by_node[first[low] : first[high]].astype(index_type)
            begin = int(first[low]) * width
            graph = sp.csr_array(
                (
                    np.add.outer(here * width, inner).ravel(),
                    cells[here // width].astype(index_type).ravel(),
                    ((first[low : high + 1] - first[low]) * width).astype(index_type),
                ),
                shape=(high - low, node_count),
            )
            graph.sort_indices()
            row = np.repeat(np.arange(low, high, dtype=index_type), np.diff(graph.indptr))
            fresh = np.ones(len(row), dtype=bool)
            fresh[1:] = (np.diff(row) != 0) | (np.diff(graph.indices) != 0)
            kept = np.flatnonzero(fresh)
            self.order[begin : begin + len(row)] = graph.data
            starts.append(begin + kept)
            columns.append(graph.indices[kept])
            rows.append(row[kept])
        self.starts, self.columns, self.rows = (np.concatenate(parts) for parts in (starts, columns, rows))
        self.node_count = node_count
        self.indptr = np.concatenate([[0], np.cumsum(np.bincount(self.rows, minlength=node_count))])

    def _reduce(self, values: FloatArray) -> FloatArray:
        """Sums over the elements of each pair of nodes, some pairs at a time."""
        flat, out = values.ravel(), np.empty(len(self.starts))
        ends = np.append(self.starts[1:], len(self.order))
        for pairs in np.array_split(np.arange(len(out)), max(1, len(self.order) // SORTED_VALUES)):
            low, high = self.starts[pairs[0]], ends[pairs[-1]]
            out[pairs] = np.add.reduceat(flat[self.order[low:high]], self.starts[pairs] - low)
        return out

    def scalar_matrix(self, values: FloatArray) -> sp.csr_array:
        """One value per node pair."""
        shape = (self.node_count, self.node_count)
        return sp.csr_array((self._reduce(values), self.columns.astype(np.int32), self.indptr), shape=shape)

    def vector_matrix(self, blocks: Iterable[tuple[int, int, FloatArray]], count: int) -> sp.csr_array:
        """A block (count, count) per node pair, from an iterable of (i, j, values)."""
        length = np.diff(self.indptr)
        indptr = np.concatenate([[0], np.cumsum(np.repeat(count * length, count))])
        index_type = np.int32 if indptr[-1] < 2**31 else np.int64
        indices = np.empty(indptr[-1], dtype=index_type)
        data = np.empty(indptr[-1])
        offset = np.arange(len(self.columns)) - self.indptr[self.rows]
        for i, j, values in blocks:
            place = indptr[count * self.rows + i] + count * offset + j
            data[place] = self._reduce(values)
            indices[place] = count * self.columns + j
        size = count * self.node_count
        return sp.csr_array((data, indices, indptr.astype(index_type)), shape=(size, size))
