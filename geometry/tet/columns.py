"""A quarter of a plate from half a column of its pillars: meshed once, and mirrored again and again along the zone.

A column ends half-way between two pillars, at a plane about which the plate is its own image but for its end; there, beyond
the last foot, the elements are stretched as far as the plate reaches.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geometry.cad import solids
from geometry.elements import TET_EDGES, FloatArray, IntArray
from geometry.layout import Design
from geometry.mesh import Mesh, check_mesh
from geometry.tet.mesher import TetOptions, tet_mesh
from geometry.tet.mirror import TET_SWAP, TRIANGLE_SWAP

STRETCH = (0.5, 1.6)  # of the strip beyond the last foot: its elements stay well shaped
SAME = 1e-9  # of half a pitch: one plane
# Relative volume difference between the quarter and its columns; more where elements on a fillet's curved rim reach into what
# is stretched of the last column: one element lost or doubled is 1e-5 of a plate at least.
ROUNDING, FILLETED = 1e-9, 1e-6


@dataclass(frozen=True)
class Columns:
    """How a quarter x, y >= 0 is put together: half a column of width half_m, its pillar's middle at x = 0, `count` times, the
    last one stretched beyond foot_m until it is end_m wide; `begins_at_pillar`: whether one stands at the plate's middle.
    """

    half_m: float
    foot_m: float
    end_m: float
    count: int
    begins_at_pillar: bool

    @classmethod
    def of(cls, design: Design) -> Columns | None:
        """Those of a plate; None for one without columns that are alike, or whose end no stretched column reaches."""
        if not design.row_pillars or design.is_staggered or not design.is_mirrored:
            return None
        centres, half = design.column_centres(), design.pitch_x_m / 2.0
        foot = max(pillar.reach_m[0] for pillar in design.kinds) / 2.0
        end = design.length_m / 2.0 - float(centres[-1])
        if not (foot < half and STRETCH[0] * (half - foot) <= end - foot <= STRETCH[1] * (half - foot)):
            return None
        return cls(half, foot, end, len(centres), len(centres) % 2 == 1)

    def alone(self, design: Design) -> Design:
        """One column of the plate as a plate of its own."""
        return replace(design, length_m=2.0 * self.half_m)

    def stretched(self, x: FloatArray) -> FloatArray:
        """Where the planes x of a column lie in the last one."""
        beyond = self.foot_m + (x - self.foot_m) * (self.end_m - self.foot_m) / (self.half_m - self.foot_m)
        return np.where(x > self.foot_m, beyond, x)


def tet_quarter(design: Design, edge_m: float, columns: Columns, options: TetOptions) -> Mesh:
    """The quarter x, y >= 0 of a plate of such columns. MeshError where a mesh is refused."""
    body = solids.plate_solid(columns.alone(design), "xy")
    column = tet_mesh(body, edge_m, options=options)
    quarter = _assembled(column, columns)
    added = 2.0 * (columns.end_m - columns.half_m) * design.half_span_m * design.thickness_m / 2.0
    check_mesh(quarter, columns.count * body.volume_m3 + added, options.volume_tolerance)
    allowed = FILLETED if any(pillar.fillet_m for pillar in design.kinds) else ROUNDING
    check_mesh(quarter, columns.count * check_mesh(column).volume_m3 + added, allowed)
    return quarter


def _assembled(column: Mesh, columns: Columns) -> Mesh:
    """Copies of a column side by side, every other one its mirror image; neighbours share the nodes of their plane."""
    planes = [column.nodes_of("x-"), column.nodes_of("x+")]
    nodes: list[FloatArray] = []
    cells: list[IntArray] = []
    faces: dict[str, list[IntArray]] = {name: [] for name in column.faces if not name.startswith("x")}
    count, before = 0, np.empty(0, dtype=np.int64)
    for number in range(columns.count):
        turned = (number % 2 == 0) != columns.begins_at_pillar  # its pillar stands at its upper end
        image = np.full(len(column.nodes), -1)
        if number:
            image[planes[int(turned)]] = before
        fresh = image < 0
        image[fresh] = count + np.arange(fresh.sum())
        before = image[planes[int(not turned)]]
        own = _placed(column, columns, number, turned)
        nodes.append(own[fresh])
        count += int(fresh.sum())
        swap = (TET_SWAP[column.order], TRIANGLE_SWAP[column.order]) if turned else (slice(None), slice(None))
        cells.append(image[column.cells][:, swap[0]])
        for name, parts in faces.items():
            parts.append(image[column.faces[name]][:, swap[1]])
        if number == 0:
            low = image[column.faces["x+" if turned else "x-"]][:, swap[1]]
    regions = {
        name: np.concatenate([part + number * len(column.cells) for number in range(columns.count)])
        for name, part in column.regions.items()
    }
    named = {name: np.vstack(parts) for name, parts in faces.items()} | {"x-": low, "x+": image[column.faces["x+"]]}
    return Mesh(np.vstack(nodes), np.vstack(cells), column.kind, column.order, regions, named)


def _placed(column: Mesh, columns: Columns, number: int, turned: bool) -> FloatArray:
    """The nodes of one copy; of the last one the elements beyond the foot stretched."""
    out, x, half = column.nodes.copy(), column.nodes[:, 0], columns.half_m
    x = np.where(np.abs(x - half) < SAME * half, half, x)
    if number == columns.count - 1:
        x = _straight(column, x, columns)
    out[:, 0] = (number + 1) * half - x if turned else number * half + x
    return out


def _straight(column: Mesh, x: FloatArray, columns: Columns) -> FloatArray:
    """Stretched places of the nodes, those between two corners as far from the middle of their edge as before."""
    moved = columns.stretched(x)
    for middle, (start, end) in zip(column.cells.T[4:], TET_EDGES, strict=column.order == 2):
        one, other = column.cells[:, start], column.cells[:, end]
        moved[middle] = (moved[one] + moved[other]) / 2.0 + (x[middle] - (x[one] + x[other]) / 2.0)
    return moved
