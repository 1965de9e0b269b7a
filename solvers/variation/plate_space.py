"""A driven plate on few motions: its modes about the band and its answers to the loads, changed by what is added to K and M.

Rayleigh-Ritz: frequencies err by the square of what a mode of the changed plate lacks of those motions, which is the smaller
the wider the band; the response follows by superposition of the projected modes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy.linalg

from geometry.elements import ComplexArray, FloatArray, IntArray
from solvers.measures.wanted_mode import Verdict, verdict
from solvers.piezo.forced import Curve, ForcedPlate, GroupModes, quadratic, rms, touch_grams

SAME = 1e-10  # of the largest: directions that are combinations of the others


class PlateSpace:
    """M-orthonormal motions of a driven plate (`bases`, all groups), and K, loads and integrals of u_z^2 over zone and passive
    face in them.
    """

    def __init__(self, forced: ForcedPlate) -> None:
        self.forced, self.bases = forced, [orthonormal(basis) for basis in forced.all_modes]
        self.starts = np.cumsum([0, *(basis.columns.shape[1] for basis in self.bases)])
        self.size = int(self.starts[-1])
        place = forced.wanted_place()
        self.wanted = None if place is None else int(self.starts[place[0]]) + place[1]
        self.stiffness = scipy.linalg.block_diag(*(basis.projected[0] for basis in self.bases))
        self.loads = np.vstack([basis.columns.T @ basis.group.loads for basis in self.bases])
        pairs = [touch_grams(basis.group.touch(basis.columns), forced.design) for basis in self.bases]
        self.inside, self.outside = (scipy.linalg.block_diag(*parts) for parts in zip(*pairs, strict=True))

    def changed(self, stiffness: FloatArray, mass: FloatArray, kept: IntArray | None = None) -> ChangedPlate:
        """The plate with other matrices (n, n) over these motions; `kept`: numbers of the only motions that it has."""
        within = np.arange(self.size, dtype=np.int64) if kept is None else kept
        cut = np.ix_(within, within)
        values, vectors = scipy.linalg.eigh((stiffness + stiffness.T)[cut] / 2.0, (mass + mass.T)[cut] / 2.0)
        grams = tuple(vectors.T @ gram[cut] @ vectors for gram in (self.inside, self.outside))
        alike, share = np.zeros(len(values)), np.zeros(len(values))
        if self.wanted is not None:
            alike = (self.inside[self.wanted, within] @ vectors) ** 2 / self.inside[self.wanted, self.wanted]
            share = (vectors[within == self.wanted] ** 2).sum(axis=0) / (vectors**2).sum(axis=0)
        return ChangedPlate(self.forced, values, vectors.T @ self.loads[within], grams[0], grams[1], alike, share)


def orthonormal(basis: GroupModes) -> GroupModes:
    """The basis with M-orthonormal columns: modes stay as they are, answers to the loads become what they add to them.

    Columns of no load drop out.
    """
    pencil, columns, modes = basis.group.pencil, basis.columns, len(basis.eigenvalue)
    residual = columns[:, modes:]
    residual = residual - columns[:, :modes] @ (columns[:, :modes].T @ pencil.apply_mass(residual))
    size = np.sqrt(np.maximum(np.einsum("ik,ik->k", residual, pencil.apply_mass(residual)), 0.0))
    residual = residual[:, size > 0.0] / size[size > 0.0]
    if residual.shape[1]:
        value, vector = scipy.linalg.eigh(residual.T @ pencil.apply_mass(residual))
        kept = value > SAME * value[-1]
        residual = residual @ (vector[:, kept] / np.sqrt(value[kept]))
    return replace(basis, columns=np.hstack([columns[:, :modes], residual]))


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
