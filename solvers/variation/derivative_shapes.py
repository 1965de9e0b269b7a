"""How the wanted mode's field changes with each pillar: static answers to what a changed cell pulls at it.

Of K u = l M u a change dK, dM of one cell gives du = -(K - l M)^-1 (dK - l dM) u beside u itself: a field about that cell, of
modes far beyond any band. In a space of modes alone frequencies err in second order, fields and levels in first (fox1968).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.linalg import eigh

from geometry.elements import FloatArray
from solvers.fem.eigen import factor_near
from solvers.piezo.forced import ForcedPlate, GroupModes
from solvers.superelement.tiling import Signature, signature
from solvers.variation.parametric_cell import CellFamily

BESIDE = 1e-3  # of the wanted mode's eigenvalue: a shift at which its own class has an answer
LEFT = 1e-4  # of the wanted mode: a field that the shapes left out may add up to where every pillar is off by one deviation
Pulls = list[tuple[int, FloatArray]]


def derivative_shapes(
    forced: ForcedPlate, families: Mapping[Signature, CellFamily], deviations: float
) -> list[FloatArray]:
    """Answers of every group of the plate, (dof, k) each, to changes of each pillar by one standard deviation.

    Parameters
    ----------
    forced : ForcedPlate
        The nominal plate; none of the groups has any where the band holds no wanted mode.
    families : mapping
        Cells as functions of their pillars.
    deviations : float
        Standard deviations that a family reaches to.

    Returns
    -------
    list of ndarray
        One array a group of `forced.all_modes`.
    """
    place = forced.wanted_place()
    if place is None:
        return [np.zeros((len(basis.columns), 0)) for basis in forced.all_modes]
    basis, index = forced.modes[place[0]], place[1]
    value = float(basis.eigenvalue[index])
    pulls = _pulls(basis, index, families, deviations)
    return [_answers(each, pulls, value) for each in forced.all_modes]


def _pulls(basis: GroupModes, index: int, families: Mapping[Signature, CellFamily], deviations: float) -> Pulls:
    """Numbers of the placed cells with a pillar, and the forces (cell dof, k) of their changes in the wanted mode."""
    group, value = basis.group, float(basis.eigenvalue[index])
    parts = group.split(basis.columns[:, [index]])
    tiling, grid = group.plates[0].tiling, group.plates[0].grid
    out = []
    for number, (i, j) in enumerate(grid.representative_cells()):
        if (i, j) not in tiling.feet:
            continue
        family = families[signature(tiling.panel(i, j))]
        moved = np.hstack(
            [
                plate.cell_vectors(plate.placed_cells[number], part)
                for plate, part in zip(group.plates, parts, strict=True)
            ]
        )
        forces = []
        for axis in np.flatnonzero(family.reach_m):
            weights = family.weights(np.eye(4)[axis] * family.reach_m / deviations)
            stiffness, mass = (np.tensordot(weights, each, axes=1) for each in (family.stiffness, family.mass))
            forces.append((stiffness - value * mass) @ moved)
        out.append((number, np.hstack(forces)))
    return out


def _answers(basis: GroupModes, pulls: Pulls, value: float) -> FloatArray:
    """What a group's classes answer, each class by itself, as few fields as hold all of them."""
    pencil, starts = basis.group.pencil, np.cumsum([0, *(plate.dof for plate in basis.group.plates)])
    plates = list(zip(starts, basis.group.plates, strict=False))
    loads = np.zeros((pencil.dof, len(plates) * sum(forces.shape[1] for _, forces in pulls)))
    if not loads.shape[1]:
        return loads
    at = 0
    for start, plate in plates:
        for number, forces in pulls:
            cell = plate.placed_cells[number]
            live, own = cell.coefficient != 0.0, loads[:, at : at + forces.shape[1]]
            np.add.at(own, start + cell.dofs[live], cell.coefficient[live, None] * forces[live])
            at += forces.shape[1]
    factor, _ = factor_near(pencil, value * (1.0 + BESIDE), basis.group.factorise)
    answers = factor.solve(loads)
    del loads, factor  # each as large as the answers: the peak of a plate's memory
    modes = basis.columns[:, : len(basis.eigenvalue)]
    answers -= modes @ (modes.T @ pencil.apply_mass(answers))
    energy, turn = eigh(answers.T @ pencil.apply_mass(answers))
    kept = np.cumsum(np.maximum(energy, 0.0)) > LEFT**2
    return np.asarray(answers @ turn[:, kept])
