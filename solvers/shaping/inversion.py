"""Voltages that make the signals asked for: V = T^-1 W, regularised, and within what the amplifiers give.

minimise |T V - W|^2 + (alpha sigma_1)^2 |V|^2 with |V_a| <= limit; a convex problem, its optimality conditions checked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from geometry.elements import BoolArray, ComplexArray, FloatArray
from solvers.errors import SolverError
from solvers.shaping.transfer_matrix import orthogonality

SINGULAR = 1e-12  # sigma_N/sigma_1 below which T^-1 holds rounding only
OPTIMAL = 1e-6  # relative: how far a limited solution may stand from its optimality conditions


@dataclass(frozen=True)
class Drive:
    """voltages (a,), V; achieved = T V (s,); error = |T V - W|/|W|; limited (a,): actuators at their limit."""

    voltages: ComplexArray
    achieved: ComplexArray
    error: float
    limited: BoolArray


def drive_voltages(matrix: ComplexArray, target: ComplexArray, alpha: float = 0.0, limit_v: float = np.inf) -> Drive:
    """Voltages for a target W (s,), from T (s, a). alpha: Tikhonov parameter as a share of the largest singular value.

    More sensors than actuators: least squares; fewer: the smallest voltages. Raises SolverError for a singular T without
    alpha, a target of zeros or of another length, alpha < 0, a limit that is not above 0. Source: hansen1998.
    """
    matrix, target = np.asarray(matrix, dtype=complex), np.asarray(target, dtype=complex)
    _check(matrix, target, alpha, limit_v)
    left, singular, right = np.linalg.svd(matrix, full_matrices=False)
    if not alpha:
        _refuse_singular(matrix, singular)
    weight = alpha * singular[0]
    voltages = right.conj().T @ (singular / (singular**2 + weight**2) * (left.conj().T @ target))
    if np.abs(voltages).max() > limit_v:
        voltages = _limited(matrix, target, weight, limit_v, voltages)
    achieved = matrix @ voltages
    error = float(np.linalg.norm(achieved - target) / np.linalg.norm(target))
    return Drive(voltages, achieved, error, np.abs(voltages) >= limit_v * (1.0 - 1e-6))


def _check(matrix: ComplexArray, target: ComplexArray, alpha: float, limit_v: float) -> None:
    if matrix.ndim != 2 or not matrix.size:
        raise SolverError("T has no entry: the list of actuators or of sensors is empty")
    if not (np.isfinite(matrix).all() and np.isfinite(target).all()):
        raise SolverError("T or the target holds a value that is not finite")
    if target.shape != (len(matrix),):
        raise SolverError(f"the target has shape {target.shape}, must be ({len(matrix)},), one value per sensor")
    if not np.abs(target).any():
        raise SolverError("the target is zero everywhere: ask for a vibration somewhere")
    if not (np.isfinite(alpha) and alpha >= 0.0):
        raise SolverError(f"alpha = {alpha:g}: must be 0 or more")
    if not limit_v > 0.0:
        raise SolverError(f"voltage limit = {limit_v:g} V: must be above 0 (inf for none)")


def _refuse_singular(matrix: ComplexArray, singular: FloatArray) -> None:
    if singular[-1] > SINGULAR * singular[0]:
        return
    modal_overlap = orthogonality(matrix)
    np.fill_diagonal(modal_overlap, 0.0)
    i, j = np.unravel_index(int(np.argmax(modal_overlap)), modal_overlap.shape)
    condition = singular[0] / singular[-1] if singular[-1] > 0.0 else np.inf
    raise SolverError(
        f"T is singular (condition number {condition:.2g}): sensors {min(i, j) + 1} and {max(i, j) + 1} are the most alike "
        f"({modal_overlap[i, j]:.6f} of 1); move off the resonance, move a patch, or regularise (alpha > 0)"
    )


def _limited(
    matrix: ComplexArray, target: ComplexArray, weight: float, limit_v: float, start: ComplexArray
) -> ComplexArray:
    """The constrained minimum by sequential quadratic programming in units of the limit, over real and imaginary parts."""
    size = matrix.shape[1]
    scale = float(np.linalg.norm(matrix, 2))
    gram = (matrix.conj().T @ matrix + weight**2 * np.eye(size)) / scale**2
    pull = matrix.conj().T @ target / (scale**2 * limit_v)

    def cost(x: FloatArray) -> tuple[float, FloatArray]:
        v = x[:size] + 1j * x[size:]
        slope = gram @ v - pull
        return float((v.conj() @ (gram @ v)).real / 2.0 - (pull.conj() @ v).real), np.concatenate(
            [slope.real, slope.imag]
        )

    room = {
        "type": "ineq",
        "fun": lambda x: 1.0 - x[:size] ** 2 - x[size:] ** 2,
        "jac": lambda x: np.hstack([np.diag(-2.0 * x[:size]), np.diag(-2.0 * x[size:])]),
    }
    first = start / np.maximum(np.abs(start), limit_v)
    x0 = np.concatenate([first.real, first.imag])
    optimum = minimize(cost, x0, jac=True, constraints=[room], method="SLSQP", options={"ftol": 1e-15, "maxiter": 500})
    voltages = optimum.x[:size] + 1j * optimum.x[size:]
    voltages = voltages / np.maximum(np.abs(voltages), 1.0)
    gap = optimality_gap(gram, pull, voltages)
    if gap > OPTIMAL:
        raise SolverError(f"limited voltages: {gap:.1e} from optimal, allowed {OPTIMAL:.0e}; regularise (alpha > 0)")
    return np.asarray(limit_v * voltages)


def optimality_gap(gram: ComplexArray, pull: ComplexArray, voltages: ComplexArray) -> float:
    """Frank-Wolfe gap over the cost's size: a bound on how far the cost is above its minimum over |V_a| <= 1.

    Re<g, V> + sum |g_a| with g = gram V - pull: the linearised cost against its least value in the discs (jaggi2013).
    """
    slope = gram @ voltages - pull
    gap = float((slope.conj() @ voltages).real + np.abs(slope).sum())
    size = float(np.abs(pull).sum())
    return gap / size
