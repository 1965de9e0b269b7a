"""Bloch bands of a case's unit cell along a path, and the complete gaps on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from geometry.hexmesh import cell_boxes, hex_mesh
from geometry.layout import Design
from pipeline import planner
from pipeline.case import Case
from pipeline.cell_shelf import CellShelf
from pipeline.errors import InputFault
from pipeline.logs import Log
from pipeline.part_models import check_model, mesh_record
from solvers.fem.assembly import assemble
from solvers.superelement.build import Reductions, lattice_piece
from solvers.superelement.lattice import Lattice
from solvers.waves.bloch import BlochCell
from solvers.waves.brillouin import Path, path_through
from solvers.waves.gaps import Gap, complete_gaps

Frequencies = Callable[[FloatArray, int], FloatArray]


@dataclass(frozen=True)
class Bands:
    """Frequencies (wavevectors, bands) in Hz along a path, complete gaps, and what computed them."""

    model: str
    dof: int
    path: Path
    frequencies_hz: FloatArray
    gaps: list[Gap]
    meshes: list[dict[str, Any]] = field(default_factory=list)

    def at(self, label: str) -> FloatArray | None:
        """Frequencies at the first point with a label, or None when the path does not pass it."""
        return self.frequencies_hz[self.path.labels.index(label)] if label in self.path.labels else None

    def json(self) -> dict[str, Any]:
        """The contract's fields, without times."""
        points = [
            {
                "label": label,
                "kx_per_m": float(k[0]),
                "ky_per_m": float(k[1]),
                "frequencies_hz": [float(f) for f in row],
            }
            for label, k, row in zip(self.path.labels, self.path.wavevectors, self.frequencies_hz, strict=True)
        ]
        gaps = [vars(gap) for gap in self.gaps]
        return {"schema": 1, "model": self.model, "dof": self.dof, "points": points, "gaps": gaps}


def solve_bands(case: Case, log: Log) -> Bands:
    """Every band asked for, at every wavevector of the case's path."""
    _check(case)
    meshes: list[dict[str, Any]] = []
    model, dof, frequencies = _cell(case, log, meshes)
    design, asked = case.design, case.bands
    path = path_through(asked.path, asked.points, design.pitch_x_m, design.pitch_y_m)
    log.left_out("wavevectors off the path", f"{asked.path} bounds the irreducible Brillouin zone")
    with log.step(f"{len(path.wavevectors)} wavevectors"):
        rows = _along(path, asked.count, frequencies)
    return Bands(model, dof, path, rows, complete_gaps(rows), meshes)


def _along(path: Path, count: int, frequencies: Frequencies) -> FloatArray:
    """Solve each distinct wavevector once."""
    known: dict[tuple[float, float], FloatArray] = {}
    for k in path.wavevectors:
        key = (float(k[0]), float(k[1]))
        if key not in known:
            known[key] = frequencies(k, count)
    return np.array([known[float(k[0]), float(k[1])] for k in path.wavevectors])


def _check(case: Case) -> None:
    case.require("plate", "array.pitch_mm", command="bands")
    check_model(case, box=not (case.design.pillar and not case.design.pillar.is_box))
    if case.design.pillar is None and case.design.rows:
        raise InputFault(f"{case.name}: array.rows = {case.design.rows}: must be 0 when the case has no [pillar]")


def _cell(case: Case, log: Log, meshes: list[dict[str, Any]]) -> tuple[str, int, Frequencies]:
    design, solve = case.design, case.solve
    if design.pillar is None:
        log.left_out("pillars", "the case has none: the cell is bare")
    if solve.mesh == "tet" or (design.pillar and not design.pillar.is_box):
        return _tetrahedral(design, solve.accuracy, log, meshes)
    log.left_out("CAD and tetrahedra", "the cell is made of boxes")
    return _full(case, log, meshes) if solve.model == "solid" else _reduced(design, solve.accuracy, log)


def _materials(design: Design) -> dict[str, Any]:
    return {"plate": design.material, "pillar": design.pillar.material if design.pillar else design.material}


def _reduced(design: Design, accuracy: float, log: Log) -> tuple[str, int, Frequencies]:
    recipe = planner.lattice_recipe(design, accuracy)
    reductions = Reductions(design.thickness_m, design.material, design.pillar, recipe, CellShelf())
    with log.step("reduce the cell"):
        lattice = Lattice(reductions.cell(lattice_piece(design)))
    source = "reduced now" if reductions.fresh else "taken from the shelf"
    log.info(f"cell of {lattice.cell.mesh_dof} unknowns in its mesh, {lattice.dof} at a wavevector, {source}")
    return f"superelement hex{recipe.hexahedra.order}", lattice.dof, lattice.frequencies


def _full(case: Case, log: Log, meshes: list[dict[str, Any]]) -> tuple[str, int, Frequencies]:
    design = case.design
    settings = planner.cell_settings(design, case.solve.accuracy)
    mesh = hex_mesh(cell_boxes(design, settings), settings.order)
    meshes.append(mesh_record("cell", mesh))
    with log.step("assemble the cell"):
        cell = BlochCell(assemble(mesh, _materials(design)), design.pitch_x_m, design.pitch_y_m)
    return f"solid hex{settings.order}", cell.dof, cell.frequencies


def _tetrahedral(
    design: Design, accuracy: float, log: Log, meshes: list[dict[str, Any]]
) -> tuple[str, int, Frequencies]:
    from pipeline.tet_parts import tet_cell

    mesh, halved = tet_cell(design, accuracy, log)
    meshes.append(mesh_record("cell", mesh))
    recipe = planner.lattice_recipe(design, accuracy)
    reductions = Reductions(design.thickness_m, design.material, design.pillar, recipe, None, lambda piece: mesh)
    with log.step("reduce the cell"):
        lattice = Lattice(reductions.cell(replace(lattice_piece(design), halved=halved)))
    log.info(f"cell of {mesh.dof} unknowns in its mesh, {lattice.dof} at a wavevector; opposite faces need not match")
    return f"superelement tet{mesh.order}", lattice.dof, lattice.frequencies
