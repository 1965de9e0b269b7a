"""A plate without patches, pressed in the wanted shape: what drives the samples of a case that has no piezo.

The pressure is sin(pi (y + W/2)/W) X_N(x) on the active touch face, scaled so that the integral of its size is 1 N.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from geometry.elements import FloatArray
from geometry.layout import Design
from solvers.measures.confinement import wanted_shape, wanted_symmetry
from solvers.piezo.patched_plate import Group
from solvers.superelement.plate import AssembledPlate


class PressedPlate:
    """Symmetry classes of an assembled plate, one load of 1 N where patches would be; only the wanted class feels it."""

    def __init__(self, plates: Mapping[str, AssembledPlate], design: Design, name: str) -> None:
        self.name = name
        self.patches: tuple[object, ...] = ("pressure",)
        self.scale = next(iter(plates.values())).placed_cells[0].cell.scale
        self.stiffness_unit = self.scale.young_pa * self.scale.length_m
        self.capacitance_f: FloatArray = np.ones(1)  # no circuit: never open
        wanted = wanted_symmetry(design.nodal_lines)
        self.everything = [self._group(plate, design, symmetry == wanted) for symmetry, plate in plates.items()]
        self.groups = [group for group in self.everything if group.symmetries == (wanted,)]
        self.undriven = [symmetry for symmetry in plates if symmetry != wanted]

    def _group(self, plate: AssembledPlate, design: Design, pressed: bool) -> Group:
        load = _pressure(plate, design) / self.stiffness_unit if pressed else np.zeros(plate.dof)
        return Group((plate,), plate.pencil, load[:, None])


def _pressure(plate: AssembledPlate, design: Design) -> FloatArray:
    """Work of the pressure on each degree of freedom, (dof,), N."""
    load, size = np.zeros(plate.dof), 0.0
    for placed_cell in plate.placed_cells:
        rule = plate.touch_rule(placed_cell)
        points = rule.points[:, :2] + np.array(placed_cell.middle)
        active = np.abs(points[:, 1]) < design.width_m / 2.0
        force = placed_cell.copies * np.where(active, rule.weights * wanted_shape(design, points), 0.0)
        size += float(np.abs(force).sum())
        live = placed_cell.coefficient != 0.0
        work = placed_cell.coefficient * rule.work(force)
        np.add.at(load, placed_cell.dofs[live], work[live])
    return load / size
