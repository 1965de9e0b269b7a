"""How a wave of the plate is polarised: flexural, shear or longitudinal, and how much of it moves in the pillar.

Along the cell's boundary lines the Legendre layer 0 is the mean through the thickness. Flexural waves carry it in u_z;
in-plane ones are compared with plane waves along k + G, u || k + G (longitudinal) and u perpendicular to it (shear), so
that a label does not depend on which of the equivalent wavevectors names the wave.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.superelement.cell import Cell
from solvers.superelement.interface import Interface

NAMES = ("flexural", "shear", "longitudinal", "pillar")
HALF = 0.5
FELT = 0.25  # share of u_z in the square: its rms is half of the whole motion's, what a finger notices
TIED = 1e-6  # relative: what symmetry makes equal; equal parts of both count as shear
FOLDS = 2  # reciprocal vectors tried along each axis: -2 to 2


@dataclass(frozen=True)
class Label:
    """A wave's polarisation: `plate` is that of the plate, `name` is "pillar" instead where asked and mostly there.

    flexural_share: of u_z in the mean square of the thickness-mean motion on the boundary lines; longitudinal_share:
    of the in-plane motion; pillar_share: of the kinetic energy.
    """

    name: str
    plate: str
    flexural_share: float
    longitudinal_share: float
    pillar_share: float


def label_of(cell: Cell, dofs: ComplexArray, wavevector: ComplexArray, with_pillars: bool = False) -> list[Label]:
    """Labels of waves with degrees of freedom (cell dof, n) at wavevectors (2, n) in rad/m, complex where they decay.

    Flexural: <|u_z|^2> above a quarter of <|u|^2> (pillars on one face mix in-plane motion into every wave), means
    through the thickness and along the boundary lines. Else longitudinal
    when the plane wave exp(i (k + G).r) that u resembles most has u || k + G, else shear; at k = 0 give a short
    vector for the direction meant. "pillar" with `with_pillars` where the pillar has over half of the kinetic energy.
    """
    motion, weights = _line_motion(cell, dofs)
    square = np.einsum("p,pck->ck", weights, np.abs(motion) ** 2)
    flexural = square[2] / np.maximum(square.sum(axis=0), np.finfo(float).tiny)
    longitudinal = _longitudinal(cell, motion, np.asarray(wavevector, dtype=complex))
    pillar = pillar_share(cell, dofs)
    return [
        _label(float(out), float(along), float(moving), with_pillars)
        for out, along, moving in zip(flexural, longitudinal, pillar, strict=True)
    ]


def pillar_share(cell: Cell, dofs: ComplexArray) -> FloatArray:
    """The pillar's share of the kinetic energy, u^H M_pillar u / u^H M u, (n,)."""
    part, whole = (np.einsum("ik,ik->k", dofs.conj(), matrix @ dofs).real for matrix in (cell.pillar_mass, cell.mass))
    return np.asarray(np.clip(part / whole, 0.0, 1.0))


def _label(flexural: float, longitudinal: float, pillar: float, with_pillars: bool) -> Label:
    in_plane = "longitudinal" if longitudinal > HALF + TIED else "shear"
    plate = "flexural" if flexural > FELT else in_plane
    return Label("pillar" if with_pillars and pillar > HALF else plate, plate, flexural, longitudinal, pillar)


def _line_motion(cell: Cell, dofs: ComplexArray) -> tuple[ComplexArray, FloatArray]:
    """Thickness means (points, 3, n) at quadrature points of the four sides, and the points' weights (sum 1)."""
    face = cell.interface
    _, weights, values = _lines(face, cell.size_m[:2])
    layer = dofs[: face.count].reshape(-1, 3, dofs.shape[1])[:: face.layers]
    return np.tensordot(values, layer, axes=1), weights


def line_gram(face: Interface) -> FloatArray:
    """The mean along a square cell's sides of the products of boundary functions of layer 0, (m, m)."""
    _, weights, values = _lines(face, (1.0, 1.0))
    return np.asarray(values.T @ (weights[:, None] * values))


@lru_cache(maxsize=8)
def _lines(face: Interface, size_m: tuple[float, float]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gauss points (p, 2) in m on the sides, weights by length (p,), boundary functions of layer 0 there (p, m)."""
    s, w = np.polynomial.legendre.leggauss(face.along + 6)
    one, zero = np.ones_like(s), np.zeros_like(s)
    sides = [(-one, s, zero), (one, s, zero), (s, -one, zero), (s, one, zero)]
    points = np.concatenate([np.column_stack(side) for side in sides])
    weights = np.repeat(np.array(size_m)[[1, 1, 0, 0]], len(s)) * np.tile(w, 4)
    values = face.evaluate(points)[:, :: face.layers]
    return points[:, :2] * np.array(size_m) / 2.0, weights / weights.sum(), values


def _longitudinal(cell: Cell, motion: ComplexArray, wavevector: ComplexArray) -> FloatArray:
    """|<l, u>|^2 / (|<l, u>|^2 + |<t, u>|^2) for the k + G that has the plane wave, l or t, that u resembles most, (n,).

    Where several are equally like, as at corners of the Brillouin zone, their squares are added up.
    """
    along, across = (overlap.reshape(len(overlap), -1) for overlap in _resemblance(cell, motion, wavevector))
    like = np.maximum(along, across)
    best = like >= (1.0 - TIED) * like.max(axis=1, keepdims=True)
    along, across = (np.where(best, overlap, 0.0).sum(axis=1) for overlap in (along, across))
    return np.asarray(along / np.maximum(along + across, np.finfo(float).tiny))


def _resemblance(cell: Cell, motion: ComplexArray, wavevector: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """|<w, u>|^2 / <w, w> for plane waves w with u || k + G, and with u perpendicular to it, (n, folds, folds) each."""
    points, weights, _ = _lines(cell.interface, cell.size_m[:2])
    fold = 2.0 * np.pi * np.arange(-FOLDS, FOLDS + 1)
    kx, ky = (wavevector[axis][:, None] + fold / cell.size_m[axis] for axis in (0, 1))
    phase_x, phase_y = (np.exp(1j * k[..., None] * points[:, axis]) for axis, k in enumerate((kx, ky)))
    energy = np.einsum("kap,kbp->kab", weights * np.abs(phase_x) ** 2, np.abs(phase_y) ** 2)
    weighted = weights[:, None, None] * motion[:, :2]
    sideways = phase_x.conj()[None] * weighted.transpose(1, 2, 0)[:, :, None]  # (2, n, folds, points)
    overlap = sideways @ phase_y.conj().transpose(0, 2, 1)
    x, y = np.broadcast_arrays(kx[:, :, None], ky[:, None, :])
    scale = energy * np.maximum(np.abs(x) ** 2 + np.abs(y) ** 2, np.finfo(float).tiny)
    along = np.abs(x.conj() * overlap[0] + y.conj() * overlap[1]) ** 2 / scale
    across = np.abs(y.conj() * overlap[0] - x.conj() * overlap[1]) ** 2 / scale
    return np.asarray(along), np.asarray(across)
