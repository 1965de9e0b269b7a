"""A reduced cell's error by its mesh, told by nested meshes or by its own stresses, and most of it taken away.

A coarser mesh lacks the innermost layer of elements at the foot's rim, where displacements go as r^a and the energy's error
therefore as h^(2a): the finer mesh still errs by a share r of the difference that follows from a, the order and the layers
(babuska1981). K = K_fine - r (K_coarse - K_fine), M likewise, over the same boundary functions; the fixed-interface modes of
the coarser mesh are turned onto those of the finer one, Q = U V' from (M_fine P Phi_coarse)' Phi_fine = U S V'
(schoenemann1966). A mesh of one order less tells what is left away from the rim.

Tetrahedra have no coarser mesh nested in them: what continuous stresses lose of K_r (`StressRecovery`) stands for its error.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh, eigvalsh

from geometry.elements import FloatArray
from solvers.accuracy.mesh import Nested, Shares, StressRecovery
from solvers.fem.assembly import on_components
from solvers.fem.factor.factoriser import side_by_side
from solvers.superelement.cell import Cell, MeshError, check_rigid
from solvers.superelement.reduction import CellBuilder, SymmetryClass
from solvers.threads import one_thread

WIDER = 1.15  # modes of the coarser mesh are sought so much higher: they lie above their partners
MAX_SHARE = 0.9  # of K or M in any direction that is taken away: they stay positive
SLIGHT = 1e-9
NOTHING = 1e-10  # of the mean stiffness or mass of a function: rounding
NestedBuilder = Nested[CellBuilder]
ALIKE = 0.5  # singular value of the modal overlap from which a direction has its partner on the coarser mesh


def extrapolated(
    cell: Cell,
    fine: tuple[CellBuilder, list[SymmetryClass]],
    lower: NestedBuilder,
    layer: NestedBuilder | None,
    shares: Shares,
    top_hz: float,
) -> Cell:
    """The cell of the finer mesh less the share of what the mesh without its innermost layer adds to K_r and M_r.

    lower: the mesh of one order less; layer: the mesh without the layer, None where nothing is singular. No more is taken
    than leaves K and M positive; what is not taken counts as uncertain.
    """
    builder, parts = fine
    meshes = [lower, layer] if layer else [lower]
    with one_thread():
        changes = side_by_side(lambda mesh: _change(builder, parts, mesh, WIDER * top_hz, cell), meshes)
    none = np.zeros_like(cell.stiffness), np.zeros_like(cell.mass)
    return _lowered(cell, builder, changes[1] if layer else none, changes[0], shares)


def recovered(cell: Cell, builder: CellBuilder, parts: list[SymmetryClass], recovery: StressRecovery) -> Cell:
    """The cell of a mesh of tetrahedra less most of what continuous stresses lose of K_r."""
    none, loss = np.zeros_like(cell.mass), np.zeros_like(cell.stiffness)
    with one_thread():
        for part, place in zip(parts, builder.places(parts), strict=True):
            own = builder.projected(part)[0] - recovery.energy(part.shapes)
            loss += builder.copies * place @ own @ place.T
    return _lowered(cell, builder, ((loss + loss.T) / 2.0, none), (none, none), recovery.shares)


def _lowered(
    cell: Cell,
    builder: CellBuilder,
    by_layer: tuple[FloatArray, FloatArray],
    by_order: tuple[FloatArray, FloatArray],
    shares: Shares,
) -> Cell:
    """The cell less the share of its changes by the layer, as far as K and M stay positive; the rest counts as uncertain."""
    limits = [
        MAX_SHARE / _largest(change, whole)
        for change, whole in zip(by_layer, _metrics(cell), strict=True)
        if change.any()
    ]
    taken = min([shares.taken, *limits])
    error = MeshError(*by_layer, *by_order, taken, shares.spread + shares.taken - taken, shares.edge, shares.order)
    stiffness, mass = (
        whole - taken * change for whole, change in zip((cell.stiffness, cell.mass), by_layer, strict=True)
    )
    better = replace(cell, stiffness=stiffness, mass=mass, mesh_error=error)
    check_rigid(better, float(builder.system.mass.sum()) * builder.copies)
    return better


def _change(
    fine: CellBuilder, parts: list[SymmetryClass], nested: NestedBuilder, top_hz: float, cell: Cell
) -> tuple[FloatArray, FloatArray]:
    """What a coarser mesh adds to K_r and M_r, (dof, dof) each."""
    stiffness, mass = np.zeros_like(cell.stiffness), np.zeros_like(cell.mass)
    known: dict[int, list[FloatArray]] = {}
    others = nested.body.classes(top_hz, bounded=False)
    for part, other, place in zip(parts, others, fine.places(parts), strict=True):
        key = id(part.turned or part)
        if key not in known:
            known[key] = _class_change(fine, part, nested, other)
        for total, own in zip((stiffness, mass), known[key], strict=True):
            total += fine.copies * place @ own @ place.T
    return (stiffness + stiffness.T) / 2.0, (mass + mass.T) / 2.0


def _class_change(
    fine: CellBuilder, part: SymmetryClass, nested: NestedBuilder, other: SymmetryClass
) -> list[FloatArray]:
    """The same of one symmetry class in its own degrees of freedom: nothing where a mode has no partner."""
    theirs, ours = _alignment(part, other, fine, nested.transfer)
    pairs = zip(nested.body.projected(other)[:2], fine.projected(part)[:2], strict=True)
    return [ours @ (theirs.T @ coarser @ theirs - ours.T @ finer @ ours) @ ours.T for coarser, finer in pairs]


def _alignment(
    part: SymmetryClass, other: SymmetryClass, fine: CellBuilder, transfer: sp.csr_array
) -> tuple[FloatArray, FloatArray]:
    """Turns (their dof, k) and (own dof, k) of both bases to directions that belong together.

    Boundary functions keep their names, in whatever combinations each mesh takes them: one that is its own image under
    x <-> y splits them once more. What the coarser mesh's shapes differ by is given to its modes as far as they can clamp it,
    so that almost massless combinations stay so.
    """
    width = part.basis.shape[1]
    renamed = other.basis.T @ part.basis  # both are orthonormal and span the same
    prolonged = on_components(transfer, other.shapes)
    heavy = on_components(fine.system.mass, prolonged[:, width:])
    left, overlap, right = np.linalg.svd(heavy.T @ part.shapes[:, width:], full_matrices=False)
    alike = overlap > ALIKE
    lent = heavy.T @ (part.shapes[:, :width] - prolonged[:, :width] @ renamed)
    own = np.zeros((len(right.T), width))
    return _widened(renamed, lent, left[:, alike]), _widened(np.eye(width), own, right[alike].T)


def _widened(named: FloatArray, lent: FloatArray, turn: FloatArray) -> FloatArray:
    """The boundary's degrees of freedom with what the modes lend them, beside a turn of the modes."""
    return np.block([[named, np.zeros((len(named), turn.shape[1]))], [lent, turn]])


def _metrics(cell: Cell) -> tuple[FloatArray, FloatArray]:
    """What the changes of K and M are measured by; K with a little mass, since rigid-body modes have no stiffness."""
    slight = SLIGHT * cell.stiffness.trace() / cell.mass.trace()
    return cell.stiffness + slight * cell.mass, cell.mass


def _largest(change: FloatArray, metric: FloatArray) -> float:
    """Largest eigenvalue of a change beside a metric, at least MAX_SHARE; functions that carry nothing are left out, those of
    free sides and those that a coarse mesh of tetrahedra cannot tell from others.
    """
    prolonged = np.flatnonzero(np.diag(metric) > 0.0)
    square, unit = np.ix_(prolonged, prolonged), np.sqrt(np.diag(metric)[prolonged])
    values, turn = eigh(metric[square] / np.outer(unit, unit))
    kept = values > NOTHING
    turn = turn[:, kept] / np.sqrt(values[kept]) / unit[:, None]
    return max(MAX_SHARE, float(eigvalsh(turn.T @ change[square] @ turn)[-1]))
