"""Parts of a case through CAD and pytetwild."""

from __future__ import annotations

import numpy as np

from geometry import solids
from geometry.elements import FloatArray
from geometry.layout import Design
from geometry.mesh import Mesh
from geometry.tetmesh import TetOptions, tet_mesh
from pipeline.logs import Log
from pipeline.planner import tet_edge_m

SYMMETRIC = ("square", "round", "tapered")


def tet_zone(design: Design, accuracy: float, log: Log) -> Mesh:
    """The bare strip, finer towards its clamped side faces."""
    edge = tet_edge_m(2.0 * design.thickness_m, accuracy)

    def size(points: FloatArray) -> FloatArray:
        away = design.width_m / 2.0 - np.abs(points[:, 1])
        return np.asarray(np.clip(edge / 3.0 + 0.4 * away, edge / 3.0, edge))

    with log.step("mesh the zone by tetrahedra"):
        return tet_mesh(solids.zone_solid(design), edge, options=TetOptions(size=size, finest_m=edge / 3.0))


def tet_pillar(design: Design, accuracy: float, log: Log) -> Mesh:
    """The lone pillar."""
    assert design.pillar
    with log.step("mesh the pillar by tetrahedra"):
        return tet_mesh(solids.pillar_solid(design.pillar), tet_edge_m(design.pillar.tip_m, accuracy))


def tet_plate(design: Design, accuracy: float, log: Log) -> tuple[Mesh, bool]:
    """The plate, as its quarter where the pillars are their own mirror images; whether it is the quarter."""
    mirrored = design.pillar is None or not design.rows or design.pillar.shape in SYMMETRIC
    smallest = min(design.thickness_m, design.pillar.tip_m) if design.pillar and design.rows else design.thickness_m
    with log.step("mesh the plate by tetrahedra"):
        body = solids.plate_solid(design, "xy" if mirrored else "")
        return tet_mesh(body, tet_edge_m(smallest, max(accuracy, 0.01))), mirrored


def tet_cell(design: Design, accuracy: float, log: Log) -> Mesh:
    """The whole unit cell; its opposite faces need not match."""
    smallest = min(design.thickness_m, design.pillar.tip_m) if design.pillar else design.thickness_m
    with log.step("mesh the cell by tetrahedra"):
        return tet_mesh(solids.cell_solid(design), tet_edge_m(smallest, accuracy))
