"""Plates whose pillars differ one by one: seeded deviations, and the response of each plate in the nominal one's space.

K = K_0 + sum over pillars of the change of its cell, alike M, both projected on the nominal plate's modes about the band,
of every symmetry class, and its answers to the patches (Rayleigh-Ritz): frequencies err by the square of what a mode lacks of
that space, which is the smaller the wider the band; the response follows by superposition of the projected modes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.linalg
from scipy.stats import norm

from geometry.elements import ComplexArray, FloatArray, IntArray
from solvers.errors import SolverError
from solvers.measures.wanted_mode import Verdict, verdict
from solvers.piezo.forced import Curve, ForcedPlate, GroupModes, group_modes, rms, touch_grams
from solvers.superelement.tiling import Signature, signature
from solvers.variation.parametric_cell import HEIGHT, SIDE, CellFamily, X, Y

CUT = 3.0  # standard deviations: a part beyond is no part of the batch
SAME = 1e-10  # of the largest: directions of the space that are combinations of the others
ENERGY = 1e-14  # of the largest: what a cell's motions leave out, square of 1e-7 of an amplitude


@dataclass(frozen=True)
class Deviations:
    """Standard deviations in m of a pillar's height, its side and each coordinate of its foot."""

    height_m: float
    side_m: float
    position_m: float

    @property
    def sizes_m(self) -> FloatArray:
        """Per parameter: height, side, x, y."""
        return np.array([self.height_m, self.side_m, self.position_m, self.position_m])

    @property
    def reach_m(self) -> tuple[float, float, float, float]:
        """What no pillar exceeds."""
        height, side, x, y = (float(CUT * size) for size in self.sizes_m)
        return height, side, x, y

    def draw(self, pillars: int, samples: int, seed: int) -> FloatArray:
        """Deviations (samples, pillars, 4) in m: normal, cut at three standard deviations, the same for the same seed."""
        random = np.random.default_rng(seed)
        edge = norm.cdf(CUT)
        unit = norm.ppf(random.uniform(1.0 - edge, edge, (samples, pillars, 4)))
        return np.asarray(unit * self.sizes_m)


@dataclass(frozen=True)
class _Kind:
    """Pillars of one kind of cell: numbers (p,), signs (p, 4) of what they deviate by, motions (p, r, columns).

    stiffness, mass: the cell's changes at the nodes of its family, (nodes, r, r).
    """

    family: CellFamily
    numbers: IntArray
    signs: FloatArray
    motions: FloatArray
    stiffness: FloatArray
    mass: FloatArray


class VariedPlate:
    """The nominal plate as driven, and what each pillar's change adds to it; `pillars` (n, 2) in m are where they stand."""

    def __init__(self, forced: ForcedPlate, families: Mapping[Signature, CellFamily]) -> None:
        self.forced, self.design, self.loss = forced, forced.design, forced.loss
        undriven = [group for group in forced.plate.everything if group not in forced.plate.groups]
        bases = [*forced.modes, *(group_modes(group, forced.band_hz, forced.margin) for group in undriven)]
        self._spaces = [_orthonormal(one) for one in bases]
        self._starts = np.cumsum([0, *(len(space.eigenvalue) for space in self._spaces)])
        place = forced.wanted_place()
        self.wanted = None if place is None else int(self._starts[place[0]]) + place[1]
        self.size = int(self._starts[-1])
        self.stiffness = scipy.linalg.block_diag(*(space.stiffness for space in self._spaces))
        self.loads = np.vstack([space.loads for space in self._spaces])
        pairs = [touch_grams(space.columns, self.design) for space in self._spaces]
        self.inside, self.outside = (scipy.linalg.block_diag(*parts) for parts in zip(*pairs, strict=True))
        self.pillars, self._kinds = self._placed(families)

    def sample(self, change_m: FloatArray, within_hz: tuple[float, float] | None = None) -> VariedSample:
        """The plate with deviations (pillars, 4) in m: height, side, x, y, in the order of `pillars`.

        within_hz: take only the modes between these frequencies into the space, besides the answers to the patches.
        """
        if change_m.shape != (len(self.pillars), 4):
            raise SolverError(f"deviations of shape {change_m.shape}: must be ({len(self.pillars)}, 4)")
        stiffness, mass = self.stiffness.copy(), np.eye(self.size)
        for kind in self._kinds:
            weights = kind.family.weights(change_m[kind.numbers] * kind.signs)
            flat = kind.motions.reshape(-1, self.size)
            for total, nodes in ((stiffness, kind.stiffness), (mass, kind.mass)):
                moved = np.tensordot(weights, nodes, axes=1) @ kind.motions
                total += flat.T @ moved.reshape(-1, self.size)
        within = np.arange(self.size, dtype=np.int64) if within_hz is None else self._within(within_hz)
        cut = np.ix_(within, within)
        values, vectors = scipy.linalg.eigh((stiffness + stiffness.T)[cut] / 2.0, (mass + mass.T)[cut] / 2.0)
        grams = tuple(vectors.T @ gram[cut] @ vectors for gram in (self.inside, self.outside))
        alike = self.inside[self.wanted, within] @ vectors if self.wanted is not None else np.zeros(len(values))
        own = float(self.inside[self.wanted, self.wanted]) if self.wanted is not None else 1.0
        return VariedSample(
            self.forced, values, vectors.T @ self.loads[within], grams[0], grams[1], np.asarray(alike**2 / own)
        )

    def _within(self, band_hz: tuple[float, float]) -> IntArray:
        """Numbers of the columns that are modes in the band or no modes at all."""
        kept = []
        for space in self._spaces:
            tone = space.columns.frequency_hz
            rests = np.ones(len(space.eigenvalue) - len(tone), dtype=bool)
            kept.append(np.concatenate([(tone > band_hz[0]) & (tone < band_hz[1]), rests]))
        return np.asarray(np.flatnonzero(np.concatenate(kept)), dtype=np.int64)

    def _placed(self, families: Mapping[Signature, CellFamily]) -> tuple[FloatArray, list[_Kind]]:
        plate = self._spaces[0].columns.group.plates[0]
        tiling, grid = plate.tiling, plate.grid
        gathered: dict[Signature, list[tuple[tuple[float, float], FloatArray, FloatArray]]] = {}
        for place, (i, j) in enumerate(grid.representative_cells()):
            foot = tiling.feet.get((i, j))
            if foot is None:
                continue
            own = [2 * i == grid.nx - 1, 2 * j == grid.ny - 1]  # the cell is its own image
            parts = self._cell_motions(place)
            for flip in np.ndindex(2, 2):
                if any(turned and same for turned, same in zip(flip, own, strict=True)):
                    continue
                turn = [-1.0 if turned else 1.0 for turned in flip]
                motion = self._turned(parts, turn)
                entry = ((turn[0] * foot[0], turn[1] * foot[1]), np.array([1.0, 1.0, *turn]), motion)
                gathered.setdefault(signature(tiling.panel(i, j)), []).append(entry)
        feet = np.array([foot for entries in gathered.values() for foot, _, _ in entries]).reshape(-1, 2)
        order = np.lexsort(np.round(feet, 9).T)
        numbers = np.empty(len(feet), dtype=np.int64)
        numbers[order] = np.arange(len(feet))
        kinds, start = [], 0
        for key, entries in gathered.items():
            mine = numbers[start : start + len(entries)]
            kinds.append(_kind(families[key], mine, [signs for _, signs, _ in entries], [m for _, _, m in entries]))
            start += len(entries)
        return feet[order], kinds

    def _cell_motions(self, place: int) -> list[tuple[int, str, FloatArray]]:
        """Motions (cell degrees of freedom, columns) of one cell, class by class: first column, symmetry, values."""
        parts = []
        for start, space in zip(self._starts, self._spaces, strict=False):
            group = space.columns.group
            for plate, part in zip(group.plates, group.split(space.columns.columns), strict=True):
                parts.append((int(start), plate.symmetry, plate.cell_vectors(plate.placed_cells[place], part)))
        return parts

    def _turned(self, parts: list[tuple[int, str, FloatArray]], turn: list[float]) -> FloatArray:
        """The motions of the cell's mirror image, seen in that mirror."""
        out = np.zeros((len(parts[0][2]), self.size))
        for start, symmetry, values in parts:
            sign = 1.0
            for mark, side in zip(symmetry, turn, strict=True):
                sign *= -1.0 if side < 0.0 and mark == "A" else 1.0
            out[:, start : start + values.shape[1]] += sign * values
        return out


def _kind(family: CellFamily, numbers: IntArray, signs: list[FloatArray], motions: list[FloatArray]) -> _Kind:
    """The cells' motions and changes in the few directions that the motions span."""
    gram = sum((motion @ motion.T for motion in motions), start=np.zeros((family.cell.dof,) * 2))
    energy, basis = np.linalg.eigh(gram)
    basis = basis[:, energy > ENERGY * energy[-1]]
    shrunk = [basis.T @ changes @ basis for changes in (family.stiffness, family.mass)]
    return _Kind(family, numbers, np.array(signs), np.array([basis.T @ m for m in motions]), shrunk[0], shrunk[1])


@dataclass(frozen=True)
class _Space:
    """A group's columns made M-orthonormal, and K and the loads in them."""

    columns: GroupModes
    eigenvalue: FloatArray
    stiffness: FloatArray
    loads: FloatArray


def _orthonormal(basis: GroupModes) -> _Space:
    """Modes stay as they are, rests become what they add to them; columns of no load drop out."""
    pencil, columns = basis.group.pencil, basis.columns
    modes = len(basis.eigenvalue)
    residual = columns[:, modes:]
    residual = residual - columns[:, :modes] @ (columns[:, :modes].T @ pencil.apply_mass(residual))
    size = np.sqrt(np.maximum(np.einsum("ik,ik->k", residual, pencil.apply_mass(residual)), 0.0))
    residual = residual[:, size > 0.0] / size[size > 0.0]
    if residual.shape[1]:
        value, vector = scipy.linalg.eigh(residual.T @ pencil.apply_mass(residual))
        kept = value > SAME * value[-1]
        residual = residual @ (vector[:, kept] / np.sqrt(value[kept]))
    whole = np.hstack([columns[:, :modes], residual])
    stiffness = whole.T @ (pencil.stiffness @ whole)
    made = GroupModes(
        basis.group, basis.frequency_hz, basis.eigenvalue, basis.gain, whole, basis.middle, basis.residual_gain
    )
    return _Space(made, np.diag(stiffness).copy(), (stiffness + stiffness.T) / 2.0, whole.T @ basis.group.loads)


@dataclass(frozen=True)
class VariedSample:
    """One plate's modes in the nominal space: eigenvalues (n,), gains (n, patches), touch-face integrals (n, n) per pair.

    alike (n,): <u, w>^2 / <w, w> over the active touch face, w the nominal plate's wanted mode; zero where it has none.
    """

    forced: ForcedPlate
    eigenvalue: FloatArray
    gain: FloatArray
    inside: FloatArray
    outside: FloatArray
    alike: FloatArray

    @property
    def loss(self) -> float:
        """1/Q."""
        return self.forced.loss

    @property
    def tracked(self) -> Verdict:
        """Which mode the nominal plate's wanted one has become, by its shape (`solvers.measures.wanted_mode`)."""
        inside, outside = np.diag(self.inside), np.diag(self.outside)
        share = inside / np.maximum(inside + outside, 1e-300)
        return verdict(self.alike, share, self.alike / np.maximum(inside, 1e-300))

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
        energies = [_quadratic(gram, amplitudes) for gram in (self.inside, self.outside)]
        return Curve(np.asarray(frequency_hz), *rms(energies[0], energies[1], forced.design), sensors)

    def _charge(self, denominator: ComplexArray) -> ComplexArray:
        return np.asarray(self.gain.T @ (self.gain / denominator[:, None]) * self.forced.plate.stiffness_unit)


def _quadratic(gram: FloatArray, amplitudes: ComplexArray) -> FloatArray:
    """a* G a for each column, (columns,); rounding below zero counts as zero."""
    parts = [np.einsum("nf,nf->f", part, gram @ part) for part in (amplitudes.real, amplitudes.imag)]
    return np.asarray(np.maximum(parts[0] + parts[1], 0.0))


@dataclass(frozen=True)
class Spread:
    """Mean, standard deviation (of a sample) and extremes of a figure over the samples."""

    mean: float
    deviation: float
    lowest: float
    highest: float


def spread(values: FloatArray) -> Spread:
    """Statistics of at least one value; the deviation of one is 0."""
    deviation = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    return Spread(float(np.mean(values)), deviation, float(np.min(values)), float(np.max(values)))


__all__ = ["CUT", "HEIGHT", "SIDE", "Deviations", "Spread", "VariedPlate", "VariedSample", "X", "Y", "spread"]
