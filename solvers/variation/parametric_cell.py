"""A pillar's cell as a function of its pillar: K_r and M_r for another height, side and place of the foot.

The mesh keeps its topology: grid lines move with the foot's edges, layers with the pillar's height, the cell's own edges stay.
u = Psi(p) b + Phi(p) m, with the constraint shapes of the moved mesh and Phi(p) = K_II^-1 M_II Phi_0 Lambda_0, one inverse
iteration there on the unmoved mesh's fixed-interface modes, node by node: modes of their own but for the second order, and
smooth in p whatever modes cross. K_r(p) and M_r(p) are interpolated between such reductions by quadratic Lagrange polynomials
on {-reach, 0, reach}: height and side together, each coordinate of the foot for itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from geometry.elements import FloatArray
from geometry.hex.boxes import Boxes, HexSettings, Panel, hex_mesh, panel_boxes
from geometry.layout import Pillar, region_materials
from geometry.materials import Material
from geometry.mesh import Mesh, check_mesh
from solvers.errors import SolverError
from solvers.fem.assembly import Scale, System, assemble
from solvers.superelement.cell import Cell, CellBuilder, ClampedBoundaryClass, Coarser, weighted
from solvers.superelement.interface import Interface

HEIGHT, SIDE, X, Y = range(4)  # the parameters of a pillar, m
FLUSH_M = 1e-9
Node = tuple[int, int, int, int]  # -1, 0 or 1 reaches along each parameter
Pair = tuple[FloatArray, FloatArray]


@dataclass(frozen=True)
class CellFamily:
    """A cell and what K_r and M_r change by at the nodes of the interpolation, in the cell's degrees of freedom and scale.

    reach_m (4,): how far height, side, x and y go from the nominal pillar on either side; 0 where nothing varies.
    """

    cell: Cell
    reach_m: FloatArray
    nodes: tuple[Node, ...]
    stiffness: FloatArray
    mass: FloatArray

    def weights(self, change_m: FloatArray) -> FloatArray:
        """Factors (..., nodes) of the nodes' changes for pillars (..., 4) in m. SolverError beyond the reach."""
        reach = np.where(self.reach_m > 0.0, self.reach_m, 1.0)
        t = np.asarray(change_m) / reach
        if (np.abs(t) > 1.0 + 1e-9).any() or (np.asarray(change_m)[..., self.reach_m == 0.0] != 0.0).any():
            raise SolverError(
                f"a pillar differs by {change_m} m from the nominal one: interpolated up to {self.reach_m}"
            )
        lagrange = {-1: t * (t - 1.0) / 2.0, 0: 1.0 - t * t, 1: t * (t + 1.0) / 2.0}
        columns = []
        for node in self.nodes:
            moved = [axis for axis in (X, Y) if node[axis]]
            used = moved or [HEIGHT, SIDE]
            columns.append(np.prod([lagrange[node[axis]][..., axis] for axis in used], axis=0))
        return np.stack(columns, axis=-1) if columns else np.zeros((*t.shape[:-1], 0))

    def at(self, change_m: FloatArray) -> Pair:
        """K_r and M_r of one pillar, (4,) in m from the nominal one."""
        weights = self.weights(change_m)
        return (
            self.cell.stiffness + np.tensordot(weights, self.stiffness, axes=1),
            self.cell.mass + np.tensordot(weights, self.mass, axes=1),
        )


def nodes_of(reach_m: FloatArray) -> tuple[Node, ...]:
    """Nodes besides the nominal one: height and side on a grid, x and y each on its own line."""
    steps = [(-1, 0, 1) if reach > 0.0 else (0,) for reach in reach_m]
    grid = [(a, b, 0, 0) for a in steps[HEIGHT] for b in steps[SIDE] if (a, b) != (0, 0)]
    lines: list[Node] = [(0, 0, a, 0) for a in steps[X] if a]
    lines += [(0, 0, 0, a) for a in steps[Y] if a]
    return (*grid, *lines)


@dataclass(frozen=True)
class Setting:
    """What every panel of a plate shares: thickness (m), materials, pillar, boundary functions, modes' limit, mesh."""

    thickness_m: float
    material: Material
    pillar: Pillar
    interface: Interface
    top_hz: float
    hexahedra: HexSettings


def cell_family(setting: Setting, panel: Panel, reach_m: FloatArray, coarser: Coarser | None = None) -> CellFamily:
    """Reduce a panel at every node. SolverError for a pillar that is no box or reaches out of its panel.

    `coarser` takes the mesh's error from the nominal cell; what varies keeps that of its mesh, which it hardly changes.
    """
    if not setting.pillar.is_square_prism or panel.foot is None:
        raise SolverError("only square pillars without fillet can be varied")
    sampler = _Sampler(setting, panel)
    nodes = nodes_of(np.asarray(reach_m, dtype=float))
    zero = sampler.matrices(np.zeros(4))
    for one, other in zip(zero, (sampler.cell.stiffness, sampler.cell.mass), strict=True):
        if np.abs(one - other).max() > 1e-8 * np.abs(other).max():
            raise SolverError("the unvaried pillar's cell is not the nominal one")
    changes: dict[Node, Pair] = {}
    for node in nodes:
        changes[node] = sampler.change(node, np.asarray(reach_m), changes)
    size = sampler.cell.dof
    stacked = [np.array([pair[i] for pair in changes.values()]).reshape(len(nodes), size, size) for i in (0, 1)]
    cell = coarser(sampler.cell, sampler.build, sampler.parts) if coarser else sampler.cell
    return CellFamily(cell, np.asarray(reach_m, dtype=float), nodes, stacked[0], stacked[1])


class _Sampler:
    """Reductions of one piece on moved meshes, in the degrees of freedom of its nominal cell."""

    def __init__(self, setting: Setting, panel: Panel) -> None:
        self.setting, self.panel = setting, panel
        self.boxes = panel_boxes(panel, setting.thickness_m, setting.pillar, setting.hexahedra)
        nominal = self._system(self.boxes)
        self.build = CellBuilder(nominal, setting.interface, panel.halved, panel.free)
        self.parts = self.build.classes(setting.top_hz)
        self.cell: Cell = self.build.join(self.parts)
        self.nodes = nominal.mesh.nodes

    def change(self, node: Node, reach_m: FloatArray, before: dict[Node, Pair]) -> Pair:
        """K_r and M_r at a node less the nominal ones; a foot moved back is the mirror image of one moved on."""
        height, side, x, y = node
        for axis, moved, twin in ((0, x, (height, side, -x, y)), (1, y, (height, side, x, -y))):
            if moved and twin in before and axis in self.panel.halved:
                return self._mirrored(before[twin], axis)
        varied = self.matrices(np.array(node) * reach_m)
        return varied[0] - self.cell.stiffness, varied[1] - self.cell.mass

    def _mirrored(self, pair: Pair, axis: int) -> Pair:
        where, sign = self.cell.interface.mirror(axis)
        modes = np.arange(len(where), self.cell.dof)
        where = np.concatenate([where, modes])
        sign = np.concatenate([sign, self.cell.fixed_parity[:, axis]])
        one, two = (matrix[np.ix_(where, where)] * np.outer(sign, sign) for matrix in pair)
        return one, two

    def matrices(self, change_m: FloatArray) -> Pair:
        """K_r and M_r over [boundary degrees of freedom, the nominal cell's fixed-interface modes]."""
        kept = tuple(axis for axis in self.panel.halved if change_m[X + axis] == 0.0)
        opened = [axis for axis in self.panel.halved if axis not in kept]
        boxes = self.boxes
        for axis in opened:
            boxes = unfolded(boxes, axis)
        still, moved = self._mesh(boxes), self._system(moved_boxes(boxes, self.setting, self.panel, change_m))
        build = CellBuilder(moved, self.setting.interface, kept, self.panel.free)
        stiffness, mass = (np.zeros((self.cell.dof,) * 2) for _ in range(2))
        for signs in product((1, -1), repeat=len(kept)):
            wanted = dict(zip(kept, signs, strict=True))
            modes, fixed = self._fixed(still, opened, wanted)
            clamped = build.clamp(wanted)
            eigenvalue = moved.scale.eigenvalue(1.0) * self.cell.fixed_hz[modes] ** 2
            shapes = np.hstack([clamped.shapes, _prolonged_modes(build, clamped, fixed, eigenvalue)])
            width = clamped.basis.shape[1]
            place = np.zeros((self.cell.dof, shapes.shape[1]))
            place[: len(clamped.basis), :width] = clamped.basis
            place[self.cell.interface.count + modes, width + np.arange(len(modes))] = 1.0
            stiffness += build.copies * place @ (shapes.T @ (moved.stiffness @ shapes)) @ place.T
            mass += build.copies * place @ weighted(shapes, moved.mass) @ place.T
        return (stiffness + stiffness.T) / 2.0, (mass + mass.T) / 2.0

    def _mesh(self, boxes: Boxes) -> Mesh:
        return hex_mesh(boxes, self.setting.hexahedra.order)

    def _system(self, boxes: Boxes) -> System:
        setting, mesh = self.setting, self._mesh(boxes)
        check_mesh(mesh)
        scale = Scale(setting.thickness_m, setting.material.young_pa, setting.material.density_kg_m3)
        return assemble(mesh, region_materials(setting.material, setting.pillar), scale)

    def _fixed(self, still: Mesh, opened: list[int], signs: dict[int, int]) -> tuple[FloatArray, FloatArray]:
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
    nodes = len(build.system.mesh.nodes)
    heavy = (build.system.mass @ (fixed * eigenvalue).reshape(nodes, -1)).reshape(fixed.shape)
    return clamped.sector.spread(clamped.factor.solve(clamped.sector.gathered(heavy)))


def unfolded(boxes: Boxes, axis: int) -> Boxes:
    """Boxes on both sides of the mirror plane at 0 from those on its positive side."""
    lines = [boxes.x, boxes.y, boxes.z]
    half = lines[axis]
    if half[0] != 0.0:
        raise SolverError("only boxes that begin at 0 can be unfolded")
    lines[axis] = np.concatenate([-half[:0:-1], half])
    region = np.concatenate([np.flip(boxes.region, axis), boxes.region], axis)
    return Boxes(lines[0], lines[1], lines[2], region, boxes.names)


def moved_boxes(boxes: Boxes, setting: Setting, panel: Panel, change_m: Sequence[float] | FloatArray) -> Boxes:
    """The grid with its foot's edges and its pillar's layers moved. SolverError where the foot leaves the panel."""
    assert panel.foot is not None
    lines = [
        _moved_line(line, setting.pillar.base_m, panel, axis, change_m) for axis, line in enumerate((boxes.x, boxes.y))
    ]
    top = setting.thickness_m
    stretch = 1.0 + change_m[HEIGHT] / setting.pillar.height_m
    if stretch <= 0.0:
        raise SolverError("a pillar's height must stay above 0")
    z = np.where(boxes.z > top, top + (boxes.z - top) * stretch, boxes.z)
    return replace(boxes, x=lines[0], y=lines[1], z=z)


def _moved_line(
    line: FloatArray, side_m: float, panel: Panel, axis: int, change_m: Sequence[float] | FloatArray
) -> FloatArray:
    """Linear between the panel's edges and the foot's; a foot flush with an edge stays so and grows to the other side."""
    assert panel.foot is not None
    edge = (panel.high[axis] - panel.low[axis]) / 2.0
    centre = panel.foot[axis] - panel.middle[axis]
    feet = centre + side_m / 2.0 * np.array([-1.0, 1.0])
    moved = centre + change_m[X + axis] + (side_m + change_m[SIDE]) / 2.0 * np.array([-1.0, 1.0])
    flush = np.abs(np.abs(feet) - edge) < FLUSH_M
    if flush.any():
        grown = change_m[SIDE] * np.array([-1.0, 1.0])
        moved = np.where(flush, feet, feet + (0.0 if flush.all() else grown))
    inner = np.concatenate([moved[:1] + edge, np.diff(moved), edge - moved[1:]])
    if (inner[1:2] <= 0.0).any() or (inner[[0, 2]] < np.where(flush, 0.0, FLUSH_M) - FLUSH_M / 2.0).any():
        raise SolverError("a pillar reaches out of its panel: its spread is too wide for the pitch")
    from_, to = np.array([-edge, *feet, edge]), np.array([-edge, *moved, edge])
    once = np.concatenate([[True], np.diff(from_) > FLUSH_M])
    return np.interp(line, from_[once], to[once])
