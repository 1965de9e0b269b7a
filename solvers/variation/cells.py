"""Families of cells for pillars that are taller, wider, moved or stiffer, and a plate's reductions by them."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, product

import numpy as np
from scipy.linalg import solve_triangular

from geometry.elements import FloatArray, IntArray
from geometry.hex.panels import FLUSH_M, PillarChange, VariedPanel
from geometry.layout import PLAIN, Pillar
from geometry.mesh import Mesh
from geometry.tiling import Panel, Signature, signature
from solvers.errors import SolverError
from solvers.fem.assembly import on_components
from solvers.plates.assembled import Cache, Reductions
from solvers.superelement.cell import Cell
from solvers.superelement.reduction import CellBuilder, ClampedBoundaryClass, Coarser, projected, weighted

# -- families ----------------------------------------------------------------------------------------------------------
# A pillar's cell as a function of its pillar: K_r and M_r for another height, side, place of the foot and stiffness.
# The mesh keeps its topology: its nodes move with the foot and with the pillar's height, the cell's own sides stay. u
# = Psi(p) b + Phi(p) m, with the constraint shapes of the moved mesh and Phi(p) = K_II^-1 M_II Phi_0 Lambda_0, one
# inverse iteration there on the unmoved mesh's fixed-interface modes, node by node, made orthonormal: modes of their
# own but for the second order, and smooth in p whatever modes cross. K_r(p) and M_r(p) are interpolated between such
# reductions by quadratic Lagrange polynomials on {-reach, 0, reach}: height and side together, each coordinate of the
# foot for itself, stiffness likewise, and the products of these with every other parameter from a single reduction with
# both one reach away. A further reduction of a pillar with all deviations at once shows the remaining error.

HEIGHT, SIDE, X, Y, STIFFNESS = range(5)  # the parameters of a pillar, m; of its stiffness the relative deviation
PARAMETERS = 5
CHECKED = 2.0 / 3.0  # of the reach of every parameter: where interpolation is compared with a reduction
Node = tuple[int, ...]  # -1, 0 or 1 reaches along each parameter
Pair = tuple[FloatArray, FloatArray]


@dataclass(frozen=True)
class CellFamily:
    """A cell and the changes of its K_r and M_r at the nodes of the interpolation, in the cell's degrees of freedom and scale.

    reach (5,): how far height, side, x, y and stiffness go from the nominal pillar on either side; 0 where nothing varies.
    missed: what a reduction at `checked` has more than is interpolated there, of K_r and of M_r.
    """

    cell: Cell
    reach: FloatArray
    nodes: tuple[Node, ...]
    stiffness: FloatArray
    mass: FloatArray
    missed: Pair

    @property
    def checked(self) -> FloatArray:
        """The pillar whose reduction was compared with the interpolation, its deviations (5,) from the nominal one."""
        return CHECKED * self.reach

    def weights(self, change: FloatArray) -> FloatArray:
        """Factors (..., nodes) of the nodes' changes for pillars with deviations (..., 5). SolverError beyond the reach."""
        reach = np.where(self.reach > 0.0, self.reach, 1.0)
        t = np.asarray(change) / reach
        if (np.abs(t) > 1.0 + 1e-9).any() or (np.asarray(change)[..., self.reach == 0.0] != 0.0).any():
            raise SolverError(f"a pillar differs by {change} from the nominal one: interpolation reaches {self.reach}")
        lagrange = {-1: t * (t - 1.0) / 2.0, 0: 1.0 - t * t, 1: t * (t + 1.0) / 2.0}
        columns = []
        for node in self.nodes:
            off = [axis for axis in range(PARAMETERS) if node[axis]]
            if _is_product(node):
                columns.append(np.prod(t[..., off], axis=-1))
                continue
            used = [HEIGHT, SIDE] if off[0] in (HEIGHT, SIDE) else off
            columns.append(np.prod([lagrange[node[axis]][..., axis] for axis in used], axis=0))
        return np.stack(columns, axis=-1) if columns else np.zeros((*t.shape[:-1], 0))

    def at(self, change: FloatArray) -> Pair:
        """K_r and M_r of one pillar with deviations (5,) from the nominal one."""
        weights = self.weights(change)
        return (
            self.cell.stiffness + np.tensordot(weights, self.stiffness, axes=1),
            self.cell.mass + np.tensordot(weights, self.mass, axes=1),
        )


def nodes_of(reach: FloatArray) -> tuple[Node, ...]:
    """List the nodes of the interpolation, except the nominal one.

    Height and side form a grid, every other parameter a line; the nodes of the products follow.

    Parameters
    ----------
    reach : ndarray, shape (5,)
        Reach of height, side, x and y (m) and relative stiffness on either side; 0 where a parameter does not vary.

    Returns
    -------
    tuple of Node
        Reaches (-1, 0 or 1) along each parameter.
    """
    steps = [(-1, 0, 1) if own > 0.0 else (0,) for own in reach]
    grid = [_node({HEIGHT: a, SIDE: b}) for a in steps[HEIGHT] for b in steps[SIDE] if (a, b) != (0, 0)]
    lines = [_node({axis: a}) for axis in (X, Y, STIFFNESS) for a in steps[axis] if a]
    varied = [axis for axis in range(PARAMETERS) if reach[axis] > 0.0]
    pairs = [pair for pair in combinations(varied, 2) if pair != (HEIGHT, SIDE)]
    return (*grid, *lines, *(_node(dict.fromkeys(pair, 1)) for pair in pairs))


def _is_product(node: Node) -> bool:
    """Whether a node stands for the product of two parameters that form no grid."""
    return sum(map(bool, node)) == 2 and any(node[X:])


def _node(steps: Mapping[int, int]) -> Node:
    """The node so many reaches away along these parameters."""
    return tuple(steps.get(axis, 0) for axis in range(PARAMETERS))


def _cell_family(reductions: Reductions, panel: Panel, reach: FloatArray, coarser: Coarser | None = None) -> CellFamily:
    """The nominal cell of a panel with a foot, its changes at the nodes, and the error of the interpolation at `checked`.

    reach (5,): of height, side, x and y (m) and relative stiffness on either side of the nominal pillar. coarser: corrects
    the nominal cell's discretisation error; its small change with the pillar is neglected. Raises SolverError for a pillar
    that cannot grow as a whole, MeshError where a varied pillar reaches out of its panel.
    """
    pillar = reductions.pillar_of(panel)
    if pillar is None or not pillar.is_plain or panel.foot is None:
        raise SolverError(f"only {PLAIN} can be varied")
    sampler = _Sampler(reductions, panel, pillar)
    reach = np.asarray(reach, dtype=float)
    nodes = nodes_of(reach)
    zero = sampler.matrices(np.zeros(PARAMETERS))
    for one, other in zip(zero, (sampler.cell.stiffness, sampler.cell.mass), strict=True):
        if np.abs(one - other).max() > 1e-8 * np.abs(other).max():
            raise SolverError("the unvaried pillar's cell is not the nominal one")
    changes: dict[Node, Pair] = {}
    for node in nodes:
        changes[node] = sampler.change(node, reach, changes)
    size = sampler.cell.dof
    stacked = [np.array([pair[i] for pair in changes.values()]).reshape(len(nodes), size, size) for i in (0, 1)]
    none = np.zeros_like(zero[0]), np.zeros_like(zero[1])
    family = CellFamily(sampler.cell, reach, nodes, stacked[0], stacked[1], none)
    checked = zip(sampler.matrices(family.checked), family.at(family.checked), strict=True)
    stiffer, heavier = (own - interpolated for own, interpolated in checked)
    cell = coarser(sampler.cell, sampler.build, sampler.parts) if coarser else sampler.cell
    return replace(family, cell=cell, missed=(stiffer, heavier))


class _Sampler:
    """Reductions of one piece on moved meshes, in the degrees of freedom of its nominal cell."""

    def __init__(self, reductions: Reductions, panel: Panel, pillar: Pillar) -> None:
        self.reductions, self.panel, self.pillar = reductions, panel, pillar
        nominal, reduction = reductions.system(self._varied(()).still), reductions.reduction
        self.build = CellBuilder(nominal, reduction.interface, panel.halved, panel.free)
        self.parts = self.build.classes(reduction.top_hz)
        self.cell: Cell = self.build.join(self.parts)
        self.nodes = nominal.mesh.nodes

    def change(self, node: Node, reach: FloatArray, before: dict[Node, Pair]) -> Pair:
        """K_r and M_r at a node less the nominal ones, at a product's less what either of its parameters changes alone, too.

        A foot moved back is the mirror image of one moved on.
        """
        if _is_product(node):
            alone = [before[_node({axis: 1})] for axis in range(PARAMETERS) if node[axis]]
            both = self._difference(node, reach)
            return both[0] - alone[0][0] - alone[1][0], both[1] - alone[0][1] - alone[1][1]
        for axis in self.panel.halved:
            twin = _node(dict(enumerate(node)) | {X + axis: -node[X + axis]})
            if twin != node and twin in before:
                return self._mirrored(before[twin], axis)
        return self._difference(node, reach)

    def _difference(self, node: Node, reach: FloatArray) -> Pair:
        varied = self.matrices(np.array(node) * reach)
        return varied[0] - self.cell.stiffness, varied[1] - self.cell.mass

    def _mirrored(self, pair: Pair, axis: int) -> Pair:
        where, sign = self.cell.interface.mirror(axis)
        modes = np.arange(len(where), self.cell.dof)
        where = np.concatenate([where, modes])
        sign = np.concatenate([sign, self.cell.fixed_parity[:, axis]])
        one, two = (matrix[np.ix_(where, where)] * np.outer(sign, sign) for matrix in pair)
        return one, two

    def matrices(self, change: FloatArray) -> Pair:
        """K_r and M_r over [boundary degrees of freedom, the nominal cell's fixed-interface modes]."""
        kept = tuple(axis for axis in self.panel.halved if change[X + axis] == 0.0)
        opened = [axis for axis in self.panel.halved if axis not in kept]
        varied = self._varied(opened)
        still, moved = varied.still, varied.moved(PillarChange(*np.asarray(change[:STIFFNESS], dtype=float)))
        build = CellBuilder(
            self._stiffened(1.0 + change[STIFFNESS]).system(moved), self.build.interface, kept, self.panel.free
        )
        stiffness, mass = (np.zeros((self.cell.dof,) * 2) for _ in range(2))
        for signs in product((1, -1), repeat=len(kept)):
            target = dict(zip(kept, signs, strict=True))
            modes, fixed = self._fixed(still, opened, target)
            stiff, heavy = self._of_class(build, target, modes, fixed)
            stiffness += stiff
            mass += heavy
        return (stiffness + stiffness.T) / 2.0, (mass + mass.T) / 2.0

    def _of_class(
        self, build: CellBuilder, signs: dict[int, int], modes: IntArray, fixed: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """K_r and M_r of one symmetry class, whose factor and shapes end here: `modes` of the nominal cell, shapes (3n, m)."""
        moved, cell = build.system, self.cell
        clamped, eigenvalue = build.clamp(signs), moved.scale.eigenvalue(1.0) * cell.fixed_hz[modes] ** 2
        carried = _prolonged_modes(build, clamped, fixed, eigenvalue)
        gram = build.copies / self.build.copies * weighted(carried, moved.mass)
        shapes = np.hstack([clamped.shapes, carried @ _orthonormal(gram, eigenvalue)])
        width = clamped.basis.shape[1]
        place = np.zeros((cell.dof, shapes.shape[1]))
        place[: len(clamped.basis), :width] = clamped.basis
        place[cell.interface.count + modes, width + np.arange(len(modes))] = 1.0
        stiffness = build.copies * place @ projected(shapes, moved.stiffness.__matmul__) @ place.T
        return stiffness, build.copies * place @ weighted(shapes, moved.mass) @ place.T

    def _stiffened(self, factor: float) -> Reductions:
        """The reductions with this pillar, all elastic constants of its material times a factor."""
        return replace(self.reductions, pillar=replace(self.pillar, material=self.pillar.material.scaled(factor)))

    def _varied(self, opened: Sequence[int]) -> VariedPanel:
        own = self.reductions
        return VariedPanel(self.panel, own.stack, self.pillar, own.reduction.hexahedra, tuple(opened))

    def _fixed(self, still: Mesh, opened: list[int], signs: dict[int, int]) -> tuple[IntArray, FloatArray]:
        """The nominal modes of a symmetry class, numbers and nodal shapes (3n, m), on the mesh unfolded about `opened`."""
        from scipy.spatial import cKDTree  # slow to import, and a family from the cache needs none

        folded = still.nodes.copy()
        folded[:, opened] = np.abs(folded[:, opened])
        distance, source = cKDTree(self.nodes).query(folded)
        if distance.max() > FLUSH_M:
            raise SolverError("an unfolded mesh is not the mirror image of its half")
        numbers, columns, start = [], [], 0
        for part in self.parts:
            count = len(part.fixed_hz)
            if all(part.signs[axis] == sign for axis, sign in signs.items()):
                field = part.shapes[:, part.basis.shape[1] :].reshape(len(self.nodes), 3, count)[source]
                for axis in opened:
                    beyond = still.nodes[:, axis] < 0.0
                    flip = np.full(3, float(part.signs[axis]))
                    flip[axis] *= -1.0
                    field[beyond] *= flip[None, :, None]
                numbers.append(start + np.arange(count))
                columns.append(field.reshape(-1, count))
            start += count
        return np.concatenate(numbers), np.hstack(columns)


def _prolonged_modes(
    build: CellBuilder, clamped: ClampedBoundaryClass, fixed: FloatArray, eigenvalue: FloatArray
) -> FloatArray:
    """K_II^-1 M_II Phi_0 Lambda_0 at every node, (3n, m)."""
    heavy = on_components(build.system.mass, fixed * eigenvalue)
    return clamped.sector.spread(clamped.factor.solve(clamped.sector.restrict(heavy)))


def _orthonormal(gram: FloatArray, eigenvalue: FloatArray) -> FloatArray:
    """Transform to orthonormal modes from their Gram matrix, each cleared of those below: L^-T of G = L L^T, ascending.

    Inverse iteration amplifies a mode's part in those below it and damps that in those above: lower ones stay clean.
    """
    upwards = np.argsort(eigenvalue, kind="stable")
    sorted_in = np.ix_(upwards, upwards)
    turn = np.zeros_like(gram)
    turn[sorted_in] = solve_triangular(np.linalg.cholesky(gram[sorted_in]), np.eye(len(gram)), lower=True).T
    return turn


# -- reductions of a plate ---------------------------------------------------------------------------------------------
# Reductions of a plate whose pillars differ: a family for each kind of panel with a pillar, bare panels unchanged.


@dataclass
class VariedReductions(Reductions):
    """reach: how far a pillar's height, side, x, y and stiffness may go from nominal; `families` fills as panels are needed."""

    reach: tuple[float, ...] = (0.0,) * PARAMETERS
    parametric_cache: Cache[CellFamily] | None = None
    families: dict[Signature, CellFamily] = field(default_factory=dict)

    def cell(self, panel: Panel) -> Cell:
        """The nominal cell of a panel. SolverError for pillars that cannot grow as a whole."""
        if not panel.foot:
            return super().cell(panel)
        if signature(panel) not in self.families:
            self.families[signature(panel)] = self._family(panel)
        return self.families[signature(panel)].cell

    def _family(self, panel: Panel) -> CellFamily:
        if self.mesher is not None:
            raise SolverError(f"only {PLAIN} meshed by hexahedra can be varied")
        key = hashlib.sha256(repr(("family", self._key(panel), self.reach)).encode()).hexdigest()
        kept = self.parametric_cache.get(key) if self.parametric_cache else None
        if kept is not None:
            self.reused += 1
            return kept
        family = _cell_family(self, panel, np.array(self.reach), self.coarser(panel))
        self.fresh += 1
        if self.parametric_cache:
            self.parametric_cache.put(key, family)
        return family
