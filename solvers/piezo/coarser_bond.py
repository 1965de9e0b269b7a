"""Modes of a patched plate, extrapolated from two meshes of its patches and of what yields beneath them.

At a patch's edges stresses are singular, so the finer mesh leaves a known share t of what the coarser one lacks beside it
(decision 7). That holds for eigenvalues and gains, in which the plate has yielded to either mesh, and not for stiffness
matrices: motions as short as an element meet many times the stiffness on the coarser mesh, the more so the stiffer the
ceramic is beside its plate, and a share of that taken from K softens the plate by more than there is. Modes of the coarser
mesh, aligned with those of the finer one (schoenemann1966), have K there; with A and g its matrices in modal coordinates

    Lambda = A - t (A_c - A)+,    gains = g + t (g - g_c).

A mesh nested in another one is no softer: of A_c - A only the positive part + is of the edges. Where the coarser mesh is the
softer one, something else differs, and what a share of that would change is in the bar.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, svd

from geometry.elements import FloatArray
from solvers.accuracy.mesh import amid
from solvers.fem.eigen import factor_near
from solvers.piezo.patched_plate import CoarserBond, Group, gains_at

ALIKE = 0.5  # of a direction among the modes: less of it on the coarser mesh is none of its modes about the band


@dataclass(frozen=True)
class BondErrors:
    """Half-widths of the bars by the mesh of the bond: of frequencies, relative, (k,); of gains, (k, patches). NaN where a mode
    has no counterpart on the coarser mesh.
    """

    frequency: FloatArray
    gain: FloatArray


@dataclass(frozen=True)
class ExtrapolatedModes:
    """Scaled eigenvalues (k,), ascending, M-orthonormal modes (dof, k) and gains (k, patches); errors None without a mesh that
    shows them.

    images: K and M of the finer mesh times the modes, (dof, k) each.
    """

    eigenvalue: FloatArray
    vectors: FloatArray
    gain: FloatArray
    errors: BondErrors | None
    images: tuple[FloatArray, FloatArray]


def extrapolated_modes(group: Group, values: FloatArray, vectors: FloatArray) -> ExtrapolatedModes:
    """Extrapolate a group's modes about the band from its two meshes of the patches.

    Parameters
    ----------
    group : Group
        The classes with their patches.
    values, vectors : ndarray, shapes (k,), (dof, k)
        Scaled eigenvalues and M-orthonormal modes of the finer mesh.

    Returns
    -------
    ExtrapolatedModes
        Within the span of `vectors`.
    """
    coarser, gain, heavy = group.coarser, group.gain(vectors, values), group.pencil.apply_mass(vectors)
    if coarser is None or not len(values):
        return ExtrapolatedModes(values, vectors, gain, None, (heavy * values, heavy))
    stiffness, coarse_gain, known = _aligned(group, coarser, (values, heavy), gain)
    share, spread = coarser.shares.taken, coarser.shares.spread
    stiffer, softer = _signed(stiffness - np.diag(values))
    better, turn = eigh(np.diag(values) - share * stiffer)
    change, against = (np.einsum("ij,ik,kj->j", turn, each, turn) for each in (stiffer + softer, softer))
    gains, coarse_gains = turn.T @ gain, turn.T @ coarse_gain
    unknown = np.where((turn**2).T @ known > ALIKE, 1.0, np.nan)
    errors = BondErrors(
        unknown * (spread * np.abs(change) + share * np.abs(against)) / (2.0 * better),
        unknown[:, None] * spread * np.abs(gains - coarse_gains),
    )
    images = heavy @ (values[:, None] * turn), heavy @ turn
    return ExtrapolatedModes(better, vectors @ turn, gains + share * (gains - coarse_gains), errors, images)


def _signed(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The positive and the negative part of a symmetric matrix, whose sum it is."""
    values, vectors = eigh(matrix)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T, (vectors * np.minimum(values, 0.0)) @ vectors.T


def _aligned(
    group: Group, coarser: CoarserBond, modes: tuple[FloatArray, FloatArray], gain: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """K (k, k) and gains (k, patches) of the coarser mesh in its modes, turned onto the finer one's, and how much of each of
    those is there, (k,).

    modes: eigenvalues (k,) of the finer mesh, and its M times its modes, (dof, k). Both meshes move the same degrees of
    freedom, so that one symbolic analysis serves them. Directions without a counterpart stay as the finer mesh has them.
    """
    pencil, (values, heavy) = coarser.join(), modes
    factor, shift = factor_near(pencil, amid(values), group.factorise)
    force = heavy * (values - shift)  # of answers as long as the modes
    moved = factor.solve(force)
    factor.free()
    mass = moved.T @ pencil.apply_mass(moved)
    stiffness = moved.T @ force + shift * mass  # (K - shift M) moved = force
    eigenvalues, own = eigh((stiffness + stiffness.T) / 2.0, (mass + mass.T) / 2.0)
    moved = moved @ own
    fine, overlap, coarse = svd(heavy.T @ moved)
    alike = overlap > ALIKE
    fine, turn = fine[:, alike], coarse[alike].T
    own = np.diag(values)
    change = (turn.T * eigenvalues) @ turn - fine.T @ own @ fine
    growth = eigenvalues / group.eigenvalue if group.eigenvalue else None
    other = turn.T @ gains_at(moved, growth, coarser.loads, coarser.inertia) - fine.T @ gain
    known = (fine**2).sum(axis=1)
    return own + fine @ change @ fine.T, gain + fine @ other, known
