"""Thermal stress of a reduced cell: its geometric stiffness and loads in the cell's degrees of freedom."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geometry.elements import FloatArray, IntArray
from solvers.fem.assembly import on_components
from solvers.fem.prestress import COMPONENTS, FIELDS, PLACES, StressFields

Signs = dict[int, int]  # of a symmetry class by halved axis


@dataclass(frozen=True)
class Prestress:
    """Stress fields of a whole cell, as `StressFields`, in its degrees of freedom.

    stiffness (9, dof, dof), pull (9, dof), load (dof,), rest (9,) and gram (3, 3), scaled.
    """

    stiffness: FloatArray
    pull: FloatArray
    load: FloatArray
    rest: FloatArray
    gram: FloatArray

    def kept(self, keep: IntArray) -> Prestress:
        """The same for some of the degrees of freedom."""
        stiffness = self.stiffness[:, keep[:, None], keep]
        return Prestress(stiffness, self.pull[:, keep], self.load[keep], self.rest, self.gram)

    def stress(self, motion: FloatArray) -> FloatArray:
        """Size of each field, (9,), that fits the stress of the warm cell moved by (dof,) best, scaled."""
        work = (self.pull @ motion - self.rest).reshape(len(COMPONENTS), len(PLACES))
        return np.asarray(np.linalg.solve(self.gram, work.T).T.ravel())


def joined(
    fields: StressFields, classes: Sequence[tuple[Signs, FloatArray, FloatArray]], halved: Sequence[int], dof: int
) -> Prestress:
    """Project stress fields on the symmetry classes of a cell.

    Parameters
    ----------
    fields : StressFields
        Of the meshed part.
    classes : sequence of tuple
        Signs under the mirrors, nodal shapes (3n, m) and places in the cell's degrees of freedom (dof, m) of each class.
    halved : sequence of int
        Axes meshed on their positive side only.
    dof : int
        Degrees of freedom of the cell.

    Returns
    -------
    Prestress
        Of the whole cell.
    """
    copies = 2 ** len(halved)
    stiffness, pull, load = np.zeros((len(FIELDS), dof, dof)), np.zeros((len(FIELDS), dof)), np.zeros(dof)
    even = np.array([all(_sign(field, axis) > 0 for axis in halved) for field in range(len(FIELDS))])
    for signs, shapes, place in classes:
        if all(sign > 0 for sign in signs.values()):
            load += copies * place @ (shapes.T @ fields.load)
        for field in range(len(FIELDS)):
            if all(sign == _sign(field, axis) for axis, sign in signs.items()):
                pull[field] += copies * place @ (shapes.T @ fields.pull[:, field])
    for field, matrix in enumerate(fields.stiffness):
        for signs, shapes, place in classes:
            moved = on_components(matrix, shapes)
            for others, other_shapes, other in classes:
                if all(sign * others[axis] == _sign(field, axis) for axis, sign in signs.items()):
                    stiffness[field] += copies * other @ (other_shapes.T @ moved) @ place.T
    apart = np.array([[all(a[axis] == b[axis] for axis in halved) for b in PLACES] for a in PLACES])
    rest, gram = copies * even * fields.rest, copies * apart * fields.gram
    return Prestress((stiffness + stiffness.swapaxes(1, 2)) / 2.0, pull, load, rest, gram)


def _sign(field: int, axis: int) -> int:
    """Whether a stress field is even or odd about a mirror."""
    component, place = FIELDS[field]
    return (-1) ** (PLACES[place][axis] + (COMPONENTS[component] == (0, 1)))
