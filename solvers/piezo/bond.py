"""Displacements of an assembled plate at any point of its bare faces, where something may be bonded."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy.sparse as sp

from geometry.elements import FloatArray, IntArray, gauss_lobatto, lagrange
from solvers.errors import SolverError
from solvers.superelement.cell import Cell
from solvers.superelement.plate import WHOLE, AssembledPlate, PlacedCell

SAME_M = 1e-9


@dataclass(frozen=True)
class Contact:
    """Where something touches a bare face of the plate: points (p, 2) in m on its back (z = thickness) or its touch face, and
    the means (b, p) of u at them that it feels.
    """

    points: FloatArray
    means: FloatArray
    back: bool


def displacement_at(plate: AssembledPlate, contact: Contact) -> sp.csr_array:
    """Rows (3 b, dof) that give the means of u which a contact feels.

    In a symmetry class points on the negative sides follow from the mirrors. Raises SolverError for a point outside the plate
    or on a panel that carries a pillar.
    """
    return displacement_on(plate, list(panel_contacts(plate, contact)), len(contact.means))


def displacement_on(plate: AssembledPlate, panels: Sequence[PanelContact], count: int) -> sp.csr_array:
    """The same where the panels that a contact of b means (count) lies on are known, of this or another class of the plate."""
    parts = []
    for panel in panels:
        placed_cell = plate.placed_cells[panel.number]
        signs = mirror_signs(plate.symmetry, panel.flip)[:, None]
        live = placed_cell.coefficient != 0.0
        field = signs * (panel.field[:, :, live] * placed_cell.coefficient[live])
        block = sp.coo_array(field.reshape(3 * len(panel.rows), -1))
        places = ((3 * panel.rows[:, None] + np.arange(3)).ravel()[block.row], placed_cell.dofs[live][block.col])
        parts.append(sp.csr_array((block.data, places), shape=(3 * count, plate.dof)))
    return sp.csr_array(sum(parts[1:], start=parts[0]))


@dataclass(frozen=True)
class PanelContact:
    """What of a contact lies on one panel of the whole plate: the number and place of the cell that stands for it, the mirrors
    (2,) that carry it there, and the contact's means of u that feel it (rows, (b,)) from that cell's degrees of freedom,
    (b, 3, dof).
    """

    number: int
    placed_cell: PlacedCell
    flip: FloatArray
    rows: IntArray
    field: FloatArray


def panel_contacts(plate: AssembledPlate, contact: Contact) -> Iterator[PanelContact]:
    """A contact panel by panel. A panel on a mirror line is its own image and holds its points as they are."""
    left = np.ones(len(contact.points), dtype=bool)
    for number, placed_cell in enumerate(plate.placed_cells):
        middle, half = np.array(placed_cell.middle), np.array(placed_cell.cell.size_m[:2]) / 2.0
        alone = (plate.symmetry == WHOLE) | (middle < half / 2.0)
        for flip in map(np.array, product(*((1.0,) if own else (1.0, -1.0) for own in alone))):
            local = contact.points * flip - middle
            inside = left & (np.abs(local) <= half + SAME_M).all(axis=1)
            if inside.any():
                left &= ~inside
                rows = np.flatnonzero(contact.means[:, inside].any(axis=1))
                means = contact.means[np.ix_(rows, inside)]
                yield PanelContact(
                    number, placed_cell, flip, rows, _field(placed_cell.cell, local[inside], means, contact.back)
                )
    if left.any():
        raise SolverError(f"the point {1e3 * contact.points[left][0]} mm lies outside the plate")


def mirror_signs(symmetry: str, flip: FloatArray) -> FloatArray:
    """Signs (..., 3) of u_x, u_y, u_z of a class's field from those at its image in x, y >= 0; flip (..., 2)."""
    signs = np.ones((*flip.shape[:-1], 3))
    for axis, mark in enumerate(symmetry):
        turned = flip[..., axis] < 0.0
        signs *= np.where(turned & (mark != "S"), -1.0, 1.0)[..., None]
        signs[..., axis] *= np.where(turned, -1.0, 1.0)
    return signs


def _field(cell: Cell, local_m: FloatArray, means: FloatArray, back: bool) -> FloatArray:
    """Means (b, p) of u at places (p, 2) of a face from the cell's degrees of freedom, (b, 3, dof).

    Raises SolverError where the face carries a pillar or is no tensor grid.
    """
    level, bare = cell.size_m[2] if back else 0.0, cell.bare
    if bare is None or bare.order is None:
        what = "about a round or hexagonal pillar, or of tetrahedra,"
        raise SolverError(f"the faces of a panel {what} are no tensor grid: nothing can be bonded to it or felt on it")
    on = np.flatnonzero(np.abs(bare.points[:, 2] - level) < SAME_M)
    if not len(on):
        raise SolverError("a patch lies on a panel of plate that carries a pillar: move the patch or the rows")
    weights = means @ grid_weights(bare.points[on, :2], bare.order, local_m)
    return np.tensordot(weights, bare.matrix[on], axes=1)


def grid_weights(nodes_m: FloatArray, order: int, at_m: FloatArray) -> FloatArray:
    """Weights (p, n) of the nodes (n, 2) of a tensor grid of elements at places (p, 2), by the elements' polynomials."""
    (x, i), (y, j) = (_lines(nodes_m[:, axis]) for axis in range(2))
    if len(x) * len(y) != len(nodes_m):
        raise SolverError("the nodes of a face are no tensor grid: nothing can be told between them")
    along, across = (_weights(nodes, order, at_m[:, axis]) for axis, nodes in enumerate((x, y)))
    return np.asarray(along[:, i] * across[:, j])


def _lines(places_m: FloatArray) -> tuple[FloatArray, IntArray]:
    """The different coordinates in ascending order, and which of them each place has."""
    _, first, which = np.unique(np.round(places_m / SAME_M), return_index=True, return_inverse=True)
    return places_m[first], np.asarray(which)


def _weights(nodes: FloatArray, order: int, at: FloatArray) -> FloatArray:
    """Weights (p, n) of the elements' polynomials between nodes (n,), `order` + 1 of them in each element, shared ends."""
    at = np.clip(at, nodes[0], nodes[-1])
    ends = nodes[::order]
    element = np.clip(np.searchsorted(ends, at, side="right") - 1, 0, len(ends) - 2)
    local = (2.0 * at - ends[element] - ends[element + 1]) / np.diff(ends)[element]
    out = np.zeros((len(at), len(nodes)))
    places = element[:, None] * order + np.arange(order + 1)
    np.put_along_axis(out, places, lagrange(gauss_lobatto(order), local)[0], axis=1)
    return out
