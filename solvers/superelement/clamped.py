"""Cells at a clamped edge, whose singularity their elements miss: how much of it, and the cell without most of that.

Displacements go as r^a from the edge where a clamp meets a free face. Without graded elements the energy's error of order p
goes as p^(-4a) (babuska1981), so that order p misses r = 1 / ((p/(p-1))^(4a) - 1) of the change from p - 1 to p. Waves that
these elements follow well share in that change but not in the error: SHARE r of it is taken, and as much is uncertain.
"""

from __future__ import annotations

from dataclasses import replace

from solvers.superelement.cell import MAX_SHARE, Cell, largest, metrics

# a of an edge that is clamped on one face and free on the next: 0.6 or more up to a Poisson's ratio of 0.45
EXPONENT, SHARE = 0.6, 0.6


def missed(order: int) -> float:
    """Compute what elements of an order at a clamped edge are taken to miss, relative to the change from the order below.

    Parameters
    ----------
    order : int
        p.

    Returns
    -------
    float
        SHARE r, dimensionless, also its error bar.

    References
    ----------
    .. [1] babuska1981 (docs/references.bib)
    """
    return SHARE / ((order / max(order - 1.0, 0.5)) ** (4.0 * EXPONENT) - 1.0)


def softened(cell: Cell) -> tuple[Cell, float]:
    """Take from a cell what its elements miss at a clamped edge.

    Parameters
    ----------
    cell : Cell
        Reduced cell.

    Returns
    -------
    cell : Cell
        The same degrees of freedom; the cell itself where no mesh of the order below is known for all of them.
    float
        Dimensionless fraction taken of the change from the order below, less than `missed` where K or M would lose positivity.
    """
    error = cell.mesh_error
    if error is None or not error.order or error.order_stiffness.shape != cell.stiffness.shape:
        return cell, 0.0
    changes = (
        error.order_stiffness - error.edge * error.layer_stiffness,
        error.order_mass - error.edge * error.layer_mass,
    )
    limits = [MAX_SHARE / largest(*pair) for pair in zip(changes, metrics(cell), strict=True)]
    taken = min([missed(error.order), *limits])
    stiffness, mass = (
        whole - taken * change for whole, change in zip((cell.stiffness, cell.mass), changes, strict=True)
    )
    return replace(cell, stiffness=stiffness, mass=mass), taken
