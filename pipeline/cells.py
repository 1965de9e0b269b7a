"""Which way a case's unit cell is meshed, and the same piece of plate without its pillar."""

from __future__ import annotations

from dataclasses import replace

from pipeline import omissions, planner
from pipeline.case import Case
from pipeline.cell_shelf import CellShelf
from pipeline.logs import Log
from solvers.superelement.build import Reductions, lattice_piece
from solvers.superelement.cell import Cell
from solvers.superelement.interface import Interface


def by_tetrahedra(case: Case) -> bool:
    """Whether the cell goes through CAD: it is no set of boxes, or the case wants tetrahedra."""
    return omissions.boxes(case, "cell") is None


def bare_cell(case: Case, interface: Interface, log: Log) -> Cell:
    """The unit cell's piece of plate without a pillar, with the boundary functions of the cell beside it."""
    design = replace(case.design, pillar=None)
    recipe = replace(planner.lattice_recipe(design, case.solve.accuracy), interface=interface)
    with log.step("reduce the bare cell"):
        return Reductions(design.thickness_m, design.material, None, recipe, CellShelf()).cell(lattice_piece(design))
