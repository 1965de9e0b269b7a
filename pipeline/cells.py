"""The reduced unit cell of a case, from hexahedra or tetrahedra, or bare."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from geometry.layout import Design
from pipeline import planner
from pipeline.case import Case
from pipeline.cell_shelf import CellShelf
from pipeline.logs import Log
from pipeline.part_models import mesh_record
from solvers.superelement.build import Reductions, lattice_piece
from solvers.superelement.cell import Cell


def by_tetrahedra(case: Case) -> bool:
    """Whether the cell goes through CAD: it is no set of boxes, or the case wants tetrahedra."""
    pillar = case.design.pillar
    return case.solve.mesh == "tet" or (pillar is not None and not pillar.is_box)


def unit_cell(case: Case, log: Log, meshes: list[dict[str, Any]]) -> tuple[Cell, str]:
    """The cell with its pillar, and the name of its model; a mesh from CAD is added to `meshes`."""
    design, accuracy = case.design, case.solve.accuracy
    recipe = planner.lattice_recipe(design, accuracy)
    if not by_tetrahedra(case):
        return _hexahedral(design, accuracy, log), f"superelement hex{recipe.hexahedra.order}"
    from pipeline.tet_parts import tet_cell

    mesh, halved = tet_cell(design, accuracy, log)
    meshes.append(mesh_record("cell", mesh))
    reductions = Reductions(design.thickness_m, design.material, design.pillar, recipe, None, lambda piece: mesh)
    with log.step("reduce the cell"):
        cell = reductions.cell(replace(lattice_piece(design), halved=halved))
    log.info(f"cell of {mesh.dof} unknowns in its mesh; opposite faces need not match")
    return cell, f"superelement tet{mesh.order}"


def bare_cell(case: Case, log: Log) -> Cell:
    """The same piece of plate without its pillar, with the same boundary functions."""
    return _hexahedral(replace(case.design, pillar=None), case.solve.accuracy, log, "reduce the bare cell")


def _hexahedral(design: Design, accuracy: float, log: Log, step: str = "reduce the cell") -> Cell:
    recipe = planner.lattice_recipe(design, accuracy)
    reductions = Reductions(design.thickness_m, design.material, design.pillar, recipe, CellShelf())
    with log.step(step):
        cell = reductions.cell(lattice_piece(design))
    source = "reduced now" if reductions.fresh else "taken from the shelf"
    log.info(f"{'cell' if design.pillar else 'bare cell'} of {cell.mesh_dof} unknowns in its mesh, {source}")
    return cell
