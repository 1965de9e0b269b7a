"""Thermal stress of a plate whose supports hold its expansion, and how far it is from buckling.

The reduced plate at rest has K u = f, f the forces of free expansion; the stress of the layers follows panel by panel, linear
along x and y, and its geometric stiffness G joins K (cook2002). The plate buckles where K + t G is singular, t times as warm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from geometry.elements import FloatArray
from solvers.fem.factor import Factor, Factoriser
from solvers.fem.prestress import PLACES
from solvers.superelement.plate import AssembledPlate, prestress_of

TINY = 1e-12  # of the median of K over M on the diagonal: mass that keeps rigid-body modes at rest
SURE = 1e-4  # relative: how well the temperature of buckling is found
NO_BUCKLING = 1e-6  # of K: less compression than this buckles nothing


@dataclass(frozen=True)
class RestStress:
    """A plate at rest.

    Attributes
    ----------
    fields : ndarray, shape (cells, 9)
        Size of each stress field in each placed cell, scaled.
    mean_pa : ndarray, shape (2,)
        Means of xx and yy over the plate, in Pa.
    bow_m : float
        Largest difference in u_z between two places of the touch face, in m.
    """

    fields: FloatArray
    mean_pa: FloatArray
    bow_m: float


def rest_stress(plate: AssembledPlate) -> RestStress:
    """Compute the thermal stress of a plate at rest.

    Parameters
    ----------
    plate : AssembledPlate
        Even along x and y, or the whole plate; its cells reduced with their stress fields.

    Returns
    -------
    RestStress
        Linear in the warming.

    Raises
    ------
    SolverError
        For cells without stress fields.

    References
    ----------
    .. [1] cook2002 (docs/references.bib)
    """
    load = np.zeros(plate.dof)
    for placed in plate.placed_cells:
        own = placed.copies * placed.coefficient * prestress_of(placed.cell).load
        live = placed.coefficient != 0.0
        np.add.at(load, placed.dofs[live], own[live])
    _, factor = _at_rest(plate)
    motion = factor.solve(load)[:, None]
    fields = np.array(
        [prestress_of(placed.cell).stress(plate.cell_vectors(placed, motion)[:, 0]) for placed in plate.placed_cells]
    )
    areas = np.array([placed.copies * np.prod(placed.cell.size_m[:2]) for placed in plate.placed_cells])
    scale, lifted = plate.scale, plate.touch(motion).values
    means = scale.young_pa * (areas @ fields[:, : 2 * len(PLACES) : len(PLACES)]) / areas.sum()
    return RestStress(fields, means, float(np.ptp(lifted)) * scale.length_m)


def buckling_factor(plates: Sequence[AssembledPlate], fields: FloatArray) -> float:
    """Compute how many times as large a stress would buckle the plate.

    Parameters
    ----------
    plates : sequence of AssembledPlate
        All symmetry classes, or the whole plate, without stress.
    fields : ndarray, shape (cells, 9)
        Of `rest_stress`.

    Returns
    -------
    float
        Above 1 where the plate is stable; infinite without compression.
    """
    return min(_factor(plate, fields) for plate in plates)


def _factor(plate: AssembledPlate, fields: FloatArray) -> float:
    stiffness, factor = _at_rest(plate)
    softer = -plate.stress_stiffness(fields)
    inverse = spla.LinearOperator(stiffness.shape, matvec=factor.solve, dtype=float)
    start = factor.solve(np.random.default_rng(0).standard_normal(plate.dof))
    (largest,) = spla.eigsh(
        softer, 1, stiffness, which="LA", Minv=inverse, v0=start, tol=SURE, return_eigenvectors=False
    )
    return 1.0 / float(largest) if largest > NO_BUCKLING else inf


def _at_rest(plate: AssembledPlate) -> tuple[sp.csc_array, Factor]:
    """K with as little mass as keeps rigid-body modes at rest, and its inverse."""
    pencil = plate.pencil()
    stiffness = pencil.stiffness
    if pencil.rigid_count:
        ratio = np.median(stiffness.diagonal() / pencil.mass.diagonal())
        stiffness = sp.csc_array(stiffness + TINY * ratio * pencil.mass)
    return stiffness, Factoriser()(stiffness)
