"""Error bars of a column of cells: of its modes' frequencies, and of the level of its forced motion.

Frequencies: as those of an assembled plate (`plate_error`), summed over the column's cells. Levels: the exact stiffness
differs from the column's by d with |d_jj| <= 2 e_j l_j, l_j the eigenvalue of mode j and e_j the relative bar of its
frequency, and |d_ij| <= 2 e_j w_i w_j. Each d_jj changes the modal amplitude s_j = f_j / (l_j (1 + i/Q) - l), by much near a
resonance; each d_ij adds d_ij s_j / (l_i (1 + i/Q) - l) to that of mode i, of which a calibrated share is expected.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import log
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray, IntArray
from solvers.superelement.plate_error import EDGE_LAYER, Assembly, ModeErrors, by_mesh
from solvers.waves.evanescent import Row

DECIBELS = 20.0 / log(10.0)
MOST = 0.45  # relative: eigenvalues stay positive


def mode_errors(
    column: Assembly, pencil: tuple[ComplexArray, ComplexArray], value: FloatArray, vectors: ComplexArray
) -> ModeErrors:
    """Estimate the errors of M-orthonormal modes (dof, k) of a column and its K and M with scaled eigenvalues (k,).

    What they lose by discarded fixed-interface modes is l u^H D u / 2, D the residual flexibility; what the last degree on the
    sides brought bounds the next ones.
    """
    modes = np.zeros_like(value)
    for place in column.placed_cells:
        local = np.where(place.dofs[:, None] >= 0, vectors[np.maximum(place.dofs, 0)], 0.0)
        with np.errstate(invalid="ignore"):
            growth = place.cell.residual.growth(value)
            modes += 0.5 * value * growth * _energy(local, place.row.flexibility @ local)
    modes = np.nan_to_num(modes, nan=np.inf, posinf=np.inf)
    along, layer = (_brought(column, pencil, value, vectors, part) for part in (_last_bubbles, _last_layer))
    return ModeErrors(modes, along, EDGE_LAYER * layer, *by_mesh(column, value, vectors, 1.0))


def _brought(
    column: Assembly,
    pencil: Sequence[ComplexArray],
    value: FloatArray,
    vectors: ComplexArray,
    part: Callable[[Row], IntArray],
) -> FloatArray:
    """Relative rise of each frequency without some functions of every row, to first order, (k,)."""
    where = np.unique(np.concatenate([place.dofs[part(place.row)] for place in column.placed_cells]))
    where = where[where >= 0]
    stiff, heavy = (_energy(vectors[where], matrix[np.ix_(where, where)] @ vectors[where]) for matrix in pencil)
    moving, rise = value > 0.0, np.zeros_like(value)
    rise[moving] = np.maximum(stiff - value * heavy, 0.0)[moving] / (2.0 * value[moving])
    return rise


def _last_layer(row: Row) -> IntArray:
    """The functions of the highest degree through the thickness, among [lower, upper, inner]."""
    face = row.cell.interface
    return np.flatnonzero(np.arange(2 * row.edge + face.side_block) // 3 % face.layers == face.through)


def _last_bubbles(row: Row) -> IntArray:
    """The bubbles of the highest degree on a row's lower and upper edge and on the side within, among [lower, upper, inner]."""
    face = row.cell.interface
    own = np.arange(-3 * face.layers, 0)
    return np.concatenate([own + row.edge, own + 2 * row.edge, own + 2 * row.edge + face.side_block])


def _energy(vectors: ComplexArray, images: ComplexArray) -> FloatArray:
    """u^H v of each pair of columns, (k,)."""
    return np.asarray(np.einsum("ik,ik->k", vectors.conj(), images).real)


def forced_bars(
    parts: Sequence[tuple[Any, Any]],
    force: ComplexArray,
    value: FloatArray,
    moved: FloatArray,
    quality_factor: float,
    error: FloatArray,
    mixed: float,
) -> FloatArray:
    """Half-widths of the bars of the level of one part over another of a motion forced on M-orthonormal modes, dB.

    Parameters
    ----------
    parts : two of (weights (q,), values (q, k))
        The faces whose rms are compared: areas of their points, and the modes there.
    force, value, error : ndarray, shape (k,)
        Modal forces, scaled eigenvalues, and relative half-widths of the bars of the frequencies.
    moved : ndarray, shape (t,)
        Scaled eigenvalues of the driving frequencies.
    quality_factor : float
    mixed : float
        Expected share of the bound on what modes mix.

    Returns
    -------
    ndarray, shape (t,)
    """
    lossy = 1.0 + 1j / quality_factor
    stiff, error = value[:, None] * lossy, np.minimum(error, MOST)
    share = force[:, None] / (stiff - moved)
    projected = [values.conj().T @ (weights[:, None] * (values @ share)) for weights, values in parts]
    own = [np.einsum("q,qk->k", weights, np.abs(values) ** 2)[:, None] for weights, values in parts]
    squares = [np.maximum(np.einsum("kt,kt->t", share.conj(), each).real, 1e-300) for each in projected]
    single = np.zeros_like(moved)
    for sign in (-1.0, 1.0):
        change = force[:, None] / ((1.0 + sign * error[:, None]) ** 2 * stiff - moved) - share
        grown = [
            np.maximum(1.0 + (2.0 * (change.conj() * each).real + np.abs(change) ** 2 * norm) / whole, 1e-12)
            for each, norm, whole in zip(projected, own, squares, strict=True)
        ]
        single = np.maximum(single, DECIBELS / 2.0 * np.abs(np.log(grown[0] / grown[1])).sum(axis=0))
    source = 2.0 * error[:, None] * np.sqrt(np.abs(value))[:, None] * np.abs(share)
    others = np.sqrt(np.maximum((source**2).sum(axis=0) - source**2, 0.0))
    added = np.sqrt(np.abs(value))[:, None] * others / np.abs(stiff - moved)
    unlike = np.abs(projected[0] / squares[0] - projected[1] / squares[1])
    return np.asarray(single + mixed * DECIBELS * np.linalg.norm(added * unlike, axis=0))
