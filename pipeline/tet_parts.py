"""Parts of a case through CAD and pytetwild, as quarters where the shape is its own mirror image."""

from __future__ import annotations

from collections.abc import Callable

from geometry import solids, tet_scenes
from geometry.hexmesh import Piece
from geometry.layout import Design
from geometry.mesh import Mesh
from geometry.tetmesh import TetOptions, tet_mesh
from pipeline.logs import Log
from pipeline.planner import tet_cell_edge_m, tet_edge_m, tet_plate_edge_m


def tet_zone(design: Design, accuracy: float, log: Log) -> Mesh:
    """The quarter x, y >= 0 of the bare strip, finer towards its clamped side faces."""
    with log.step("mesh the zone by tetrahedra"):
        return tet_scenes.tet_zone(design, tet_edge_m(2.0 * design.thickness_m, accuracy), "xy")


def tet_pillar(design: Design, accuracy: float, log: Log) -> Mesh:
    """The whole lone pillar, finer towards its clamped foot."""
    assert design.pillar
    with log.step("mesh the pillar by tetrahedra"):
        return tet_scenes.tet_pillar(design.pillar, tet_edge_m(design.pillar.tip_m, accuracy))


def tet_plate(design: Design, accuracy: float, log: Log) -> tuple[Mesh, bool]:
    """The plate, and whether it is the quarter."""
    quarter = design.is_mirrored
    edge = tet_plate_edge_m(design, accuracy)
    with log.step("mesh the plate by tetrahedra"):
        return tet_scenes.tet_plate(design, edge, quarter), quarter


def tet_cell(design: Design, accuracy: float, log: Log) -> tuple[Mesh, tuple[int, ...]]:
    """The unit cell, finer towards the pillar's foot, and the axes along which it is halved."""
    edge = tet_cell_edge_m(design, accuracy)
    quarter = design.pillar is None or design.pillar.is_own_image
    with log.step("mesh the cell by tetrahedra"):
        if not quarter:
            return tet_scenes.tet_cell(design, edge, quarter_then_mirror=False), ()
        rim = tet_scenes.foot_rim(design.pillar, design.thickness_m) if design.pillar else []
        return tet_mesh(solids.cell_solid(design, "xy"), edge, options=tet_scenes.graded(TetOptions(), rim, edge)), (
            0,
            1,
        )


def piece_mesher(design: Design, accuracy: float, log: Log) -> Callable[[Piece], Mesh]:
    """What meshes the pieces of a joined plate that carry a pillar."""
    edge = tet_cell_edge_m(design, accuracy)

    def mesh(piece: Piece) -> Mesh:
        with log.step("mesh a piece by tetrahedra"):
            return tet_scenes.tet_piece(design, piece, edge)

    return mesh
