"""A driven plate on few motions: its modes about the band and its answers to the loads, changed by what is added to K and M.

Rayleigh-Ritz: frequencies err by the square of what a mode of the changed plate lacks of those motions, fields by that itself;
shapes that the changes bring (`derivative_shapes`) make both small. The response follows by superposition.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy.linalg

from geometry.elements import ComplexArray, FloatArray
from solvers.measures.wanted_mode import Verdict, verdict
from solvers.piezo.forced import Curve, ForcedPlate, GroupModes, quadratic, rms, touched

SAME = 1e-10  # of the largest: directions that are combinations of the others


class PlateSpace:
    """M-orthonormal motions of a driven plate (`bases`, all groups), and K, loads and integrals of u_z^2 over zone and passive
    face in them.

    shapes: further motions (dof, k) of each of the groups, which modes about the band do not hold.
    """

    def __init__(self, forced: ForcedPlate, shapes: Sequence[FloatArray] | None = None) -> None:
        more = shapes or [np.zeros((len(basis.columns), 0)) for basis in forced.all_modes]
        raw = list(zip(forced.all_modes, more, strict=True))
        self.forced, self.bases = forced, [orthonormal(basis, own) for basis, own in raw]
        self.starts = np.cumsum([0, *(basis.columns.shape[1] for basis in self.bases)])
        self.size = int(self.starts[-1])
        place = forced.wanted_place()
        self.wanted = None if place is None else int(self.starts[place[0]]) + place[1]
        self.stiffness = scipy.linalg.block_diag(*(basis.projected[0] for basis in self.bases))
        self.loads = np.vstack([_gains(basis) for basis in self.bases])
        pairs = [touched(basis.group, basis.columns, forced.design).grams for basis in self.bases]
        self.inside, self.outside = (scipy.linalg.block_diag(*parts) for parts in zip(*pairs, strict=True))
        self._static = [_static(own, basis, extra) for own, (basis, extra) in zip(self.bases, raw, strict=True)]

    def is_wider(self, band_hz: tuple[float, float]) -> bool:
        """Whether it has modes that do not lie between two frequencies."""
        tones = np.concatenate([basis.frequency_hz for basis in self.bases])
        return bool(((tones <= band_hz[0]) | (tones >= band_hz[1])).any())

    def within(self, band_hz: tuple[float, float]) -> FloatArray:
        """The space that modes between two frequencies and the static answers alone would span, (n, m) in this one.

        Answers hold what the modes left out bring at rest, as they would if those had never been solved.
        """
        parts = []
        for basis, static in zip(self.bases, self._static, strict=True):
            tone = basis.frequency_hz
            kept = np.flatnonzero((tone > band_hz[0]) & (tone < band_hz[1]))
            answers = static.copy()
            answers[kept] = 0.0
            parts.append(np.hstack([np.eye(len(static))[:, kept], _independent(answers)]))
        return np.asarray(scipy.linalg.block_diag(*parts))

    def changed(self, stiffness: FloatArray, mass: FloatArray, within: FloatArray | None = None) -> ChangedPlate:
        """The plate with other matrices (n, n) over these motions; within (n, m): the only motions that it has."""
        span = np.eye(self.size) if within is None else within
        pair = (span.T @ ((each + each.T) / 2.0) @ span for each in (stiffness, mass))
        values, vectors = scipy.linalg.eigh(*pair)
        vectors = span @ vectors
        grams = tuple(vectors.T @ gram @ vectors for gram in (self.inside, self.outside))
        alike, share = np.zeros(len(values)), np.zeros(len(values))
        if self.wanted is not None:
            alike = (self.inside[self.wanted] @ vectors) ** 2 / self.inside[self.wanted, self.wanted]
            share = vectors[self.wanted] ** 2 / (vectors**2).sum(axis=0)
        return ChangedPlate(self.forced, values, vectors.T @ self.loads, grams[0], grams[1], alike, share)


def orthonormal(basis: GroupModes, more: FloatArray) -> GroupModes:
    """The basis with M-orthonormal columns: modes stay as they are, answers to the loads and `more` (dof, k) become what they
    add to them.

    Columns of no load drop out.
    """
    pencil, modes = basis.group.pencil, len(basis.eigenvalue)
    own, residual = np.split(np.hstack([basis.columns, more]), [modes], axis=1)
    residual = residual - own @ (own.T @ pencil.apply_mass(residual))
    size = np.sqrt(np.maximum(np.einsum("ik,ik->k", residual, pencil.apply_mass(residual)), 0.0))
    residual = residual[:, size > 0.0] / size[size > 0.0]
    if residual.shape[1]:
        value, vector = scipy.linalg.eigh(residual.T @ pencil.apply_mass(residual))
        kept = value > SAME * value[-1]
        residual = residual @ (vector[:, kept] / np.sqrt(value[kept]))
    return replace(basis, columns=np.hstack([own, residual]))


def _gains(basis: GroupModes) -> FloatArray:
    """Gains of the loads on the columns, (columns, patches): the modes' own are extrapolated."""
    modes = len(basis.eigenvalue)
    return np.vstack([basis.gain, basis.columns[:, modes:].T @ basis.group.loads])


def _static(own: GroupModes, basis: GroupModes, more: FloatArray) -> FloatArray:
    """Answers to the loads at rest about the band's middle, and `more`, in the M-orthonormal columns, (columns, k).

    R and R1 lack the modes: gain/(l - l_0) and gain/(l - l_0)^2 of each of them.
    """
    modes = len(basis.eigenvalue)
    answers = np.hstack([basis.columns[:, modes:], more])
    held = own.columns.T @ basis.group.pencil.apply_mass(answers)
    away, loads = (basis.eigenvalue - basis.middle)[:, None], basis.gain.shape[1]
    held[:modes, :loads] += basis.gain / away
    held[:modes, loads : 2 * loads] += basis.gain / away**2
    return np.asarray(held)


def _independent(columns: FloatArray) -> FloatArray:
    """Orthonormal columns that span the same."""
    size = np.linalg.norm(columns, axis=0)
    vectors, values, _ = np.linalg.svd(columns[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    return np.asarray(vectors[:, values**2 > SAME * values.max(initial=0.0) ** 2])


@dataclass(frozen=True)
class ChangedPlate:
    """A plate's modes in that space: eigenvalues (n,), gains (n, patches), touch-face integrals (n, n) per pair.

    w the nominal plate's wanted mode, alike (n,): <u, w>^2 / <w, w> over the active touch face; wanted_share (n,): w's share in
    the mode, of 1, by the nominal plate's mass. Both zero where it has none.
    """

    forced: ForcedPlate
    eigenvalue: FloatArray
    gain: FloatArray
    inside: FloatArray
    outside: FloatArray
    alike: FloatArray
    wanted_share: FloatArray

    @property
    def loss(self) -> float:
        """1/Q."""
        return self.forced.loss

    @property
    def tracked(self) -> Verdict:
        """Which mode the nominal plate's wanted one has become (`solvers.measures.wanted_mode`): that which holds most of it,
        among those of its shape in the zone. Others of that shape, and what the answers to the loads add, hold none of it.
        """
        inside, outside = np.diag(self.inside), np.diag(self.outside)
        share = inside / np.maximum(inside + outside, 1e-300)
        return verdict(self.wanted_share, share, self.alike / np.maximum(inside, 1e-300))

    @property
    def tracked_hz(self) -> float | None:
        """Its frequency; None where no mode is like it."""
        at = self.tracked.index
        return None if at is None else float(self.forced.plate.scale.frequency(self.eigenvalue[at : at + 1])[0])

    def curve(self, frequency_hz: FloatArray) -> Curve:
        """Response at frequencies in Hz."""
        forced, count = self.forced, len(frequency_hz)
        amplitudes = np.zeros((len(self.eigenvalue), count), dtype=complex)
        sensors = np.zeros((count, len(forced.sensors)), dtype=complex)
        for row, frequency in enumerate(frequency_hz):
            at = forced.plate.scale.eigenvalue(float(frequency))
            denominator = np.asarray(self.eigenvalue * (1.0 + 1j * self.loss) - at, dtype=complex)
            volts = forced.patch_volts(partial(self._charge, denominator))
            sensors[row] = volts[forced.sensors]
            amplitudes[:, row] = (self.gain @ volts) / denominator
        energies = [quadratic(gram, amplitudes) for gram in (self.inside, self.outside)]
        return Curve(np.asarray(frequency_hz), *rms(energies[0], energies[1], forced.areas_m2), sensors)

    def _charge(self, denominator: ComplexArray) -> ComplexArray:
        return np.asarray(self.gain.T @ (self.gain / denominator[:, None]) * self.forced.plate.stiffness_unit)
