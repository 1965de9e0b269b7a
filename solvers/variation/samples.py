"""Plates whose pillars differ one by one, drawn from seeds and solved in a space of the nominal plate's motions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy.linalg
from scipy.linalg import eigh
from scipy.stats import norm

from geometry.elements import ComplexArray, FloatArray, IntArray
from geometry.tiling import Signature, signature
from solvers.errors import SolverError
from solvers.fem.eigen import factor_near
from solvers.measures.target_mode import Verdict, verdict
from solvers.piezo.forced import Curve, ForcedPlate, GroupModes, quadratic, rms, touched
from solvers.superelement.bond import mirror_signs
from solvers.variation.cells import PARAMETERS, STIFFNESS, CellFamily

# -- plate on few motions ----------------------------------------------------------------------------------------------
# A driven plate on few motions: its modes about the band and its answers to the loads, for changed K and M.
# Rayleigh-Ritz: frequencies err by the square of the part of a changed plate's mode outside those motions, fields by
# that itself; shapes that the changes bring (`_derivative_shapes`) make both small. The response follows by
# superposition.

SAME = 1e-10  # of the largest: directions that are combinations of the others


class PlateSpace:
    """M-orthonormal motions of a driven plate (`bases`, all groups), and K, loads and integrals of u_z^2 over zone and passive
    face in them.

    shapes: further motions (dof, k) of each of the groups, which modes about the band do not hold.
    """

    def __init__(self, forced: ForcedPlate, shapes: Sequence[FloatArray] | None = None) -> None:
        more = shapes or [np.zeros((len(basis.columns), 0)) for basis in forced.all_modes]
        raw = list(zip(forced.all_modes, more, strict=True))
        self.forced, self.bases = forced, [_orthonormal(basis, own) for basis, own in raw]
        self.starts = np.cumsum([0, *(basis.columns.shape[1] for basis in self.bases)])
        self.size = int(self.starts[-1])
        place = forced.target_place()
        self.target = None if place is None else int(self.starts[place[0]]) + place[1]
        self.stiffness = scipy.linalg.block_diag(*(basis.projected[0] for basis in self.bases))
        self.loads = np.vstack([_gains(basis) for basis in self.bases])
        pairs = [touched(basis.group, basis.columns, forced.design).grams for basis in self.bases]
        self.inside, self.outside = (scipy.linalg.block_diag(*parts) for parts in zip(*pairs, strict=True))
        self._static = [_static(own, basis, extra) for own, (basis, extra) in zip(self.bases, raw, strict=True)]

    def is_wider(self, band_hz: tuple[float, float]) -> bool:
        """Whether it has modes outside two frequencies."""
        tones = np.concatenate([basis.frequency_hz for basis in self.bases])
        return bool(((tones <= band_hz[0]) | (tones >= band_hz[1])).any())

    def within(self, band_hz: tuple[float, float]) -> FloatArray:
        """The space that modes between two frequencies and the static answers alone would span, (n, m) in this one.

        Answers hold the discarded modes' part at rest, as they would if those had never been solved.
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
        if self.target is not None:
            alike = (self.inside[self.target] @ vectors) ** 2 / self.inside[self.target, self.target]
            share = vectors[self.target] ** 2 / (vectors**2).sum(axis=0)
        return ChangedPlate(self.forced, values, vectors.T @ self.loads, grams[0], grams[1], alike, share)


def _orthonormal(basis: GroupModes, more: FloatArray) -> GroupModes:
    """The basis with M-orthonormal columns: modes as they are, answers and `more` (dof, k) as what they add to them."""
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

    w the nominal plate's target mode, alike (n,): <u, w>^2 / <w, w> over the active touch face; target_share (n,): w's share in
    the mode, of 1, by the nominal plate's mass. Both zero where it has none.
    """

    forced: ForcedPlate
    eigenvalue: FloatArray
    gain: FloatArray
    inside: FloatArray
    outside: FloatArray
    alike: FloatArray
    target_share: FloatArray

    def loss_at(self, frequency_hz: float) -> float:
        """1/Q of the nominal plate's mode nearest to a frequency."""
        return self.forced.loss_at(frequency_hz)

    @property
    def tracked(self) -> Verdict:
        """Mode that the nominal plate's target mode has become (`solvers.measures.target_mode`): that with most of it,
        among those of its shape in the zone. Others of that shape, and the answers to the loads, hold none of it.
        """
        inside, outside = np.diag(self.inside), np.diag(self.outside)
        share = inside / np.maximum(inside + outside, 1e-300)
        return verdict(self.target_share, share, self.alike / np.maximum(inside, 1e-300))

    @property
    def tracked_hz(self) -> float | None:
        """Its frequency; None where no mode is like it."""
        at = self.tracked.index
        return None if at is None else float(self.forced.plate.scale.frequency(self.eigenvalue[at : at + 1])[0])

    def curve(self, frequency_hz: FloatArray) -> Curve:
        """Response at frequencies in Hz."""
        forced, count = self.forced, len(frequency_hz)

        def charge(denominator: ComplexArray) -> ComplexArray:
            return np.asarray(self.gain.T @ (self.gain / denominator[:, None]) * forced.plate.stiffness_unit)

        amplitudes = np.zeros((len(self.eigenvalue), count), dtype=complex)
        sensors = np.zeros((count, len(forced.sensors)), dtype=complex)
        for row, frequency in enumerate(frequency_hz):
            at = forced.plate.scale.eigenvalue(float(frequency))
            denominator = np.asarray(self.eigenvalue * (1.0 + 1j * self.loss_at(float(frequency))) - at, dtype=complex)
            volts = forced.patch_volts(partial(charge, denominator))
            sensors[row] = volts[forced.sensors]
            amplitudes[:, row] = (self.gain @ volts) / denominator
        energies = [quadratic(gram, amplitudes) for gram in (self.inside, self.outside)]
        return Curve(np.asarray(frequency_hz), *rms(energies[0], energies[1], forced.areas_m2), sensors)


# -- shapes that changes bring -----------------------------------------------------------------------------------------
# Change of the target mode's field with each pillar: static answers to the forces of a changed cell.
# In K u = l M u a change dK, dM of one cell adds du = -(K - l M)^-1 (dK - l dM) u to u: a field about
# that cell, of modes far beyond any band. In a space of modes alone frequencies err in second order, fields and
# levels in first (fox1968).

BESIDE = 1e-3  # of the target mode's eigenvalue: a shift at which its own class has an answer
LEFT = 1e-4  # of the target mode: a field that the shapes left out may add up to where every pillar is off by one deviation
Pulls = list[tuple[int, FloatArray]]


def _derivative_shapes(
    forced: ForcedPlate, families: Mapping[Signature, CellFamily], deviations: float
) -> list[FloatArray]:
    """Answers of every group, (dof, k) each, to a change of each pillar by a standard deviation; none without a target mode."""
    place = forced.target_place()
    if place is None:
        return [np.zeros((len(basis.columns), 0)) for basis in forced.all_modes]
    basis, index = forced.modes[place[0]], place[1]
    value = float(basis.eigenvalue[index])
    pulls = _pulls(basis, index, families, deviations)
    return [_answers(each, pulls, value) for each in forced.all_modes]


def _pulls(basis: GroupModes, index: int, families: Mapping[Signature, CellFamily], deviations: float) -> Pulls:
    """Numbers of the placed cells with a pillar, and the forces (cell dof, k) of their changes in the target mode."""
    group, value = basis.group, float(basis.eigenvalue[index])
    parts = group.split(basis.columns[:, [index]])
    tiling, grid = group.plates[0].tiling, group.plates[0].grid
    out = []
    for number, (i, j) in enumerate(grid.representative_cells()):
        if (i, j) not in tiling.feet:
            continue
        family = families[signature(tiling.panel(i, j))]
        pairs = zip(group.plates, parts, strict=True)
        moved = np.hstack([plate.cell_vectors(plate.placed_cells[number], part) for plate, part in pairs])
        forces = []
        for axis in np.flatnonzero(family.reach):
            weights = family.weights(np.eye(PARAMETERS)[axis] * family.reach / deviations)
            stiffness, mass = (np.tensordot(weights, each, axes=1) for each in (family.stiffness, family.mass))
            forces.append((stiffness - value * mass) @ moved)
        out.append((number, np.hstack(forces)))
    return out


def _answers(basis: GroupModes, pulls: Pulls, value: float) -> FloatArray:
    """Answers of a group's classes, class by class, in as few fields as span them."""
    pencil, starts = basis.group.pencil, np.cumsum([0, *(plate.dof for plate in basis.group.plates)])
    plates = list(zip(starts, basis.group.plates, strict=False))
    loads = np.zeros((pencil.dof, len(plates) * sum(forces.shape[1] for _, forces in pulls)))
    if not loads.shape[1]:
        return loads
    at = 0
    for start, plate in plates:
        for number, forces in pulls:
            cell = plate.placed_cells[number]
            live, own = cell.coefficient != 0.0, loads[:, at : at + forces.shape[1]]
            np.add.at(own, start + cell.dofs[live], cell.coefficient[live, None] * forces[live])
            at += forces.shape[1]
    factor, _ = factor_near(pencil, value * (1.0 + BESIDE), basis.group.factorise)
    answers = factor.solve(loads)
    del loads, factor  # each as large as the answers: the peak of a plate's memory
    modes = basis.columns[:, : len(basis.eigenvalue)]
    answers -= modes @ (modes.T @ pencil.apply_mass(answers))
    energy, turn = eigh(answers.T @ pencil.apply_mass(answers))
    kept = np.cumsum(np.maximum(energy, 0.0)) > LEFT**2
    return np.asarray(answers @ turn[:, kept])


# -- samples -----------------------------------------------------------------------------------------------------------
# Plates whose pillars differ one by one: seeded deviations, and the response of each plate in the nominal one's space.
# K = K_0 + sum over pillars of the change of its cell, alike M, both projected on the nominal plate's modes about the
# band, of every symmetry class, its answers to the patches and to each pillar's change.

CUT = 3.0  # standard deviations: a pillar beyond is not in the batch
ENERGY = 1e-14  # of the largest: neglected part of a cell's motions, square of 1e-7 of an amplitude


@dataclass(frozen=True)
class Deviations:
    """Standard deviations of a pillar's height, its side and each coordinate of its foot, m, and of its stiffness, relative."""

    height_m: float
    side_m: float
    position_m: float
    stiffness: float = 0.0

    @property
    def sizes(self) -> FloatArray:
        """Per parameter: height, side, x, y, stiffness."""
        return np.array([self.height_m, self.side_m, self.position_m, self.position_m, self.stiffness])

    @property
    def reach(self) -> tuple[float, ...]:
        """Largest deviation per parameter."""
        return tuple(float(CUT * size) for size in self.sizes)

    def draw(self, pillars: int, samples: int, seed: int) -> FloatArray:
        """Deviations (samples, pillars, 5): normal, cut at three standard deviations, the same for the same seed.

        Stiffness is drawn last: sizes and places do not depend on whether it varies.
        """
        random = np.random.default_rng(seed)
        edge = norm.cdf(CUT)
        placed, stiff = (random.uniform(1.0 - edge, edge, (samples, pillars, count)) for count in (STIFFNESS, 1))
        return np.asarray(norm.ppf(np.concatenate([placed, stiff], axis=-1)) * self.sizes)


@dataclass(frozen=True)
class _Kind:
    """Pillars of one kind of cell: numbers (p,), signs (p, 5) of their deviations, motions (p, r, columns).

    stiffness, mass: the cell's changes at the nodes of its family, (nodes, r, r); missed: of both, (r, r), as the family's.
    """

    family: CellFamily
    numbers: IntArray
    signs: FloatArray
    motions: FloatArray
    stiffness: FloatArray
    mass: FloatArray
    missed: tuple[FloatArray, FloatArray]

    def changes(self, change: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Changes of K and M of each pillar's cell for deviations (p, 5) in the cell's own directions, (p, r, r)."""
        weights = self.family.weights(change)
        stiffness, mass = (np.tensordot(weights, nodes, axes=1) for nodes in (self.stiffness, self.mass))
        return stiffness, mass


class VariedPlate:
    """The nominal plate as driven, and the change due to each pillar; `pillars` (n, 2) in m are where they stand."""

    def __init__(self, forced: ForcedPlate, families: Mapping[Signature, CellFamily]) -> None:
        self.forced = forced
        self.space = PlateSpace(forced, _derivative_shapes(forced, families, CUT))
        self.pillars, self._kinds = self._placed(families)

    def sample(self, change: FloatArray, within_hz: tuple[float, float] | None = None) -> ChangedPlate:
        """The plate with deviations (pillars, 5): height, side, x, y (m), relative stiffness, in the order of `pillars`.

        within_hz: take only the modes between these frequencies into the space, besides the static answers.
        """
        if change.shape != (len(self.pillars), PARAMETERS):
            raise SolverError(f"deviations of shape {change.shape}: must be ({len(self.pillars)}, {PARAMETERS})")
        changes = [kind.changes(change[kind.numbers] * kind.signs) for kind in self._kinds]
        return self._changed(changes, None if within_hz is None else self.space.within(within_hz))

    def checked(self) -> tuple[ChangedPlate, ChangedPlate]:
        """The plate with all pillars at their families' checked deviations: interpolated, and from the reductions."""
        interpolated, reduced = [], []
        for kind in self._kinds:
            own = kind.changes(np.broadcast_to(kind.family.checked, kind.signs.shape))
            interpolated.append(own)
            reduced.append((own[0] + kind.missed[0], own[1] + kind.missed[1]))
        return self._changed(interpolated), self._changed(reduced)

    def _changed(self, changes: list[tuple[FloatArray, FloatArray]], within: FloatArray | None = None) -> ChangedPlate:
        """The plate with these changes of each kind's cells, in a part of the space alone."""
        space = self.space
        totals = space.stiffness.copy(), np.eye(space.size)
        for kind, own in zip(self._kinds, changes, strict=True):
            for total, changes_of in zip(totals, own, strict=True):
                for change, motion in zip(changes_of, kind.motions, strict=True):
                    total += motion.T @ (change @ motion)
        return space.changed(*totals, within)

    def _placed(self, families: Mapping[Signature, CellFamily]) -> tuple[FloatArray, list[_Kind]]:
        plate = self.space.bases[0].group.plates[0]
        tiling, grid = plate.tiling, plate.grid
        gathered: dict[Signature, list[tuple[tuple[float, float], FloatArray, FloatArray]]] = {}
        for place, (i, j) in enumerate(grid.representative_cells()):
            foot = tiling.feet.get((i, j))
            if foot is None:
                continue
            own = [2 * i == grid.nx - 1, 2 * j == grid.ny - 1]  # the cell is its own image
            parts = self._cell_motions(place)
            for flip in np.ndindex(2, 2):
                # of a plate solved whole, every panel is one of its own
                if any(turned and (same or grid.whole) for turned, same in zip(flip, own, strict=True)):
                    continue
                turn = [-1.0 if turned else 1.0 for turned in flip]
                motion = self._turned(parts, turn)
                entry = ((turn[0] * foot[0], turn[1] * foot[1]), np.array([1.0, 1.0, *turn, 1.0]), motion)
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
        for start, basis in zip(self.space.starts, self.space.bases, strict=False):
            group = basis.group
            for plate, part in zip(group.plates, group.split(basis.columns), strict=True):
                parts.append((int(start), plate.symmetry, plate.cell_vectors(plate.placed_cells[place], part)))
        return parts

    def _turned(self, parts: list[tuple[int, str, FloatArray]], turn: list[float]) -> FloatArray:
        """The motions of the cell's mirror image, seen in that mirror."""
        out = np.zeros((len(parts[0][2]), self.space.size))
        for start, symmetry, values in parts:
            out[:, start : start + values.shape[1]] += mirror_signs(symmetry, np.array(turn))[2] * values
        return out


def _kind(family: CellFamily, numbers: IntArray, signs: list[FloatArray], motions: list[FloatArray]) -> _Kind:
    """The cells' motions and changes in the few directions that the motions span."""
    gram = sum((motion @ motion.T for motion in motions), start=np.zeros((family.cell.dof,) * 2))
    energy, basis = np.linalg.eigh(gram)
    basis = basis[:, energy > ENERGY * energy[-1]]
    stiffness, mass, *missed = (
        basis.T @ changes @ basis for changes in (family.stiffness, family.mass, *family.missed)
    )
    own = np.array([basis.T @ motion for motion in motions])
    return _Kind(family, numbers, np.array(signs), own, stiffness, mass, (missed[0], missed[1]))


@dataclass(frozen=True)
class Spread:
    """Mean, standard deviation (of a sample) and extremes of a figure over the samples."""

    mean: float
    deviation: float | None
    lowest: float
    highest: float


def spread(values: FloatArray) -> Spread:
    """Compute mean, standard deviation and extremes of a figure.

    Parameters
    ----------
    values : ndarray, shape (n,)
        At least one value, of any unit.

    Returns
    -------
    Spread
        In the unit of the values; a single one has no standard deviation.
    """
    deviation = float(np.std(values, ddof=1)) if len(values) > 1 else None
    return Spread(float(np.mean(values)), deviation, float(np.min(values)), float(np.max(values)))
