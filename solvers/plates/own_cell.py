"""One meshed body in the place of every panel with a foot: its sides are faces of bare plate, to which other panels join."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from geometry import errors
from geometry.elements import FloatArray, IntArray
from geometry.lattice import FURTHEST, Vectors, row_vectors
from geometry.layout import Design
from geometry.materials import Material
from geometry.mesh import AnyMesh, Mesh
from geometry.tiling import Panel
from solvers.accuracy.mesh import StressRecovery
from solvers.accuracy.reduction import recovered
from solvers.fem.surface import boundary_facets
from solvers.plates.assembled import Reductions
from solvers.superelement.cell import Cell, MeshError
from solvers.superelement.interface import SIDES, Interface
from solvers.superelement.reduction import CellBuilder, Coarser, SymmetryClass, reduce_cell
from solvers.waves.bloch import Side, sides

FLUSH = 1e-6  # of the thickness: largest distance of a side from that of bare plate, and of its area
STANDING = "section "  # regions of elements on the plate


@dataclass(frozen=True)
class Body:
    """A meshed cell with its middle at the origin and its sides named, and the materials of its regions.

    estimated: whether stress recovery corrects its discretisation error and gives its bar. edges_m: vectors (2, 2) along the
    sides of an oblique cell, the first one along x; None for a rectangle.
    """

    mesh: Mesh
    materials: dict[str, Material]
    estimated: bool = False
    edges_m: FloatArray | None = None

    @property
    def held(self) -> tuple[int, int]:
        """Highest degrees of functions along the sides and through the thickness that the mesh can hold.

        The nodes of tetrahedra are counted as if they were evenly spaced.
        """
        mesh = self.mesh
        places = [mesh.nodes[mesh.nodes_of(side)] for side in ("x+", "y+")]
        if mesh.kind == "hex":
            along = min(_levels(points[:, axis]) for points, axis in zip(places, (1, 0), strict=True))
            return along - 1, min(_levels(points[:, 2]) for points in places) - 1
        lengths = np.ptp(places[0], axis=0)[1], np.ptp(places[1], axis=0)[0]
        thick, least = float(np.ptp(places[0][:, 2])), min(map(len, places))
        spacing = np.sqrt(min(lengths) * thick / least)
        return max(int(min(lengths) / spacing) - 1, 1), max(int(thick / spacing), 1)

    def limited(self, face: Interface) -> Interface:
        """Boundary functions of no higher degrees than the mesh can hold."""
        along, through = self.held
        return replace(face, along=min(face.along, along), through=min(face.through, through))


def body_of(mesh: AnyMesh, materials: dict[str, Material], design: Design, estimated: bool = False) -> Body:
    """Place a mesh of one cell as a panel of a plate.

    Parameters
    ----------
    mesh : AnyMesh
        Tetrahedra or hexahedra, in m, the touch face on z = 0.
    materials : dict of Material
        Of its regions.
    design : Design
        Lattice and thickness of the plate, in m.
    estimated : bool, optional
        Whether stress recovery is to correct its discretisation error.

    Returns
    -------
    Body
        Regions on the plate are apart from those in it.

    Raises
    ------
    MeshError
        For a lattice without rows along x, and sides that are not those of bare plate.
    """
    size, thick = np.array([design.pitch_x_m, design.pitch_y_m]), design.thickness_m
    if not isinstance(mesh, Mesh) or mesh.kind not in ("tet", "hex"):
        raise errors.MeshError(f"elements are {mesh.kind}: must be tetrahedra alone or hexahedra alone")
    edges = _oblique_edges(design, mesh)
    if edges is not None:
        size = np.linalg.norm(edges, axis=1)
        mesh = _in_plan(
            mesh, np.asarray(np.linalg.solve(edges, np.diag(size)))
        )  # checked as the rectangle with these sides
    found = {side.name: side for side in sides(mesh, float(size.min()))}
    for name in SIDES:
        if fault := _fault(mesh, found.get(name), size, thick):
            raise errors.MeshError(f"side {name} {fault}")
    middle = np.append((mesh.nodes[:, :2].min(axis=0) + mesh.nodes[:, :2].max(axis=0)) / 2.0, 0.0)
    faces = {name: found[name].facets[0][1] for name in SIDES} | {"touch": _touch(mesh, thick)}
    regions, own = _parted(mesh, materials, thick)
    nodes = mesh.nodes - middle
    for axis, half in enumerate(size / 2.0):  # sides are exact: boundary functions are evaluated on them
        for sign, name in zip((-1.0, 1.0), SIDES[2 * axis : 2 * axis + 2], strict=True):
            nodes[np.unique(faces[name]), axis] = sign * half
    placed = replace(mesh, nodes=nodes, faces=faces, regions=regions, spans=None)
    if edges is not None:
        placed = _in_plan(placed, edges / size[:, None])
    return Body(placed, own, estimated, edges)


def _in_plan(mesh: Mesh, map_: FloatArray) -> Mesh:
    """The mesh with its places in plan multiplied by a matrix (2, 2)."""
    return replace(mesh, nodes=np.column_stack([mesh.nodes[:, :2] @ map_, mesh.nodes[:, 2]]), spans=None)


def oblique_rows(design: Design) -> Vectors | None:
    """Find the vectors along a row and to the next row of a lattice that is not rectangular.

    Parameters
    ----------
    design : Design
        With the lattice.

    Returns
    -------
    tuple or None
        (pitch, 0) and (shift, distance) in m; None for a rectangular lattice.

    Raises
    ------
    MeshError
        For a lattice without rows along x.
    """
    if design.lattice.a1_m[1] == 0.0 and design.lattice.a2_m[0] == 0.0:
        return None
    rows = row_vectors(*design.lattice.vectors_m)
    if rows is None:
        raise errors.MeshError("the lattice must have rows along x: turn the cell and its vectors")
    return rows


def _oblique_edges(design: Design, mesh: Mesh) -> FloatArray | None:
    """Vectors along the sides of a cell whose rows lie along x: that from row to row leans as the mesh does; None for a
    rectangle.

    Raises MeshError for a lattice without rows along x, and for a mesh that leans otherwise.
    """
    rows = oblique_rows(design)
    if rows is None:
        return None
    ((pitch, _), (shift, height)), low = rows, mesh.nodes[:, 1].min()
    ends = [mesh.nodes[np.abs(mesh.nodes[:, 1] - low - up) < FLUSH * height, 0] for up in (0.0, height)]
    if not all(map(len, ends)):
        raise errors.MeshError(
            f"the cell must have two sides along x, {1e3 * height:g} mm apart, as rows of the lattice are"
        )
    lean = float(ends[1].min() - ends[0].min())
    shifts = shift + pitch * np.arange(-FURTHEST, FURTHEST + 1)
    if np.abs(shifts - lean).min() > FLUSH * pitch:
        allowed = ", ".join(f"{1e3 * shift:g}" for shift in sorted(shifts, key=abs)[:3])
        what = f"its upper side lies {1e3 * lean:g} mm further along x than the lower one"
        raise errors.MeshError(f"{what}, but rows of the lattice are shifted by {allowed} mm")
    return np.array([[pitch, 0.0], [lean, height]])


def _levels(places: FloatArray) -> int:
    """Number of different places."""
    return len(np.unique(np.round(places / (FLUSH * np.ptp(places)))))


def _fault(mesh: Mesh, side: Side | None, size: FloatArray, thickness: float) -> str:
    """Say what distinguishes a side from one of bare plate, or ''."""
    if side is None:
        return "is missing: it must be a plane face of the cell"
    across = 0 if side.name[0] == "x" else 1
    points, near = mesh.nodes[side.nodes], FLUSH * thickness
    along, ends = 1 - across, (points[:, 2].min(), points[:, 2].max())
    places = [np.ptp(mesh.nodes[:, across]), np.ptp(points[:, along]), *ends]
    lengths = [size[across], size[along], 0.0, thickness]
    whole = f"must be a face of the plate, {1e3 * size[along]:g} mm long, from z = 0 to {1e3 * thickness:g} mm"
    for what, place, needed in zip(
        ("one pitch from the opposite one", "long", "low", "high"), places, lengths, strict=True
    ):
        if abs(place - needed) > near + FLUSH * needed:
            where = {"low": "begins at z = {:g} mm", "high": "ends at z = {:g} mm", "long": "is {:g} mm long"}
            own = where.get(what, "lies {:g} mm from the opposite one").format(1e3 * place)
            return f"{own}: {whole}" if what in where else f"{own}: must lie a pitch from it, {1e3 * needed:g} mm"
    area = sum(_area(mesh.nodes[corners]) for corners, _ in side.facets)
    missing = 1.0 - area / (size[along] * thickness)
    return f"has {100.0 * missing:.2g}% less area than a face of the plate: {whole}" if missing > FLUSH else ""


def _area(corners: FloatArray) -> float:
    """Area of plane triangles or quadrilaterals (n, corners, 3)."""
    one, two = (corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1]) if corners.shape[1] == 4 else (
        corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    )  # fmt: skip
    return float(np.linalg.norm(np.cross(one, two), axis=1).sum() / 2.0)


def _touch(mesh: Mesh, thickness: float) -> IntArray:
    """Outer facets on z = 0."""
    near = FLUSH * thickness
    return np.concatenate([full[(np.abs(mesh.nodes[full, 2]) < near).all(axis=1)] for _, full in boundary_facets(mesh)])


def _parted(
    mesh: Mesh, materials: dict[str, Material], thickness: float
) -> tuple[dict[str, IntArray], dict[str, Material]]:
    """Regions in the plate and on it, and their materials."""
    height = mesh.nodes[mesh.cells, 2].mean(axis=1)
    on = (height < 0.0) | (height > thickness)
    regions, own = {}, {}
    for name, cells in mesh.region_of_cells().items():
        for label, part in ((name, cells[~on[cells]]), (STANDING + name, cells[on[cells]])):
            if len(part):
                regions[label], own[label] = part, materials[name]
    return regions, own


@dataclass
class OwnReductions(Reductions):
    """Reduction of a plate's bare panels, and of one meshed body for every panel with a foot.

    is_known: whether the discretisation error of the body is known from elsewhere, so that it is none of the plate's own.
    """

    body: Body | None = None
    is_known: bool = False
    known: dict[str, Cell] = field(default_factory=dict)

    @property
    def materials(self) -> tuple[Material, ...]:
        """The materials of plate and body, each once."""
        assert self.body
        return tuple(dict.fromkeys((*super().materials, *self.body.materials.values())))

    def cell(self, panel: Panel) -> Cell:
        """The reduced cell of a panel: the body's where it has a foot."""
        if panel.foot is None:
            return super().cell(panel)
        if "own" not in self.known:
            self.known["own"] = self._of_body()
            self.fresh += 1
        return self.known["own"]

    def _of_body(self) -> Cell:
        assert self.body
        body, reduction = self.body, self.reduction
        system = self._assembled(body.mesh, body.materials, self.lossy, self.materials if self.parted else ())
        cell = reduce_cell(
            system, reduction.ample, reduction.top_hz, coarser=self._recovering(body), edges_m=body.edges_m
        )
        if self.is_known and not body.estimated:
            none = np.zeros_like(cell.mass)
            cell = replace(cell, mesh_error=MeshError(none, none, none, none, 0.0, 0.0, 0.0))
        return self._finished(cell, system)

    def _recovering(self, body: Body) -> Coarser | None:
        def corrected(cell: Cell, builder: CellBuilder, parts: list[SymmetryClass]) -> Cell:
            return recovered(cell, builder, parts, StressRecovery(body.mesh, body.materials, builder.system.scale))

        return corrected if body.estimated else None
