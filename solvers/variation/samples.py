"""Plates whose pillars differ one by one: seeded deviations, and the response of each plate in the nominal one's space.

K = K_0 + sum over pillars of the change of its cell, alike M, both projected on the nominal plate's modes about the band,
of every symmetry class, its answers to the patches and to each pillar's change (`plate_space`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from geometry.elements import FloatArray, IntArray
from solvers.errors import SolverError
from solvers.piezo.forced import ForcedPlate
from solvers.superelement.tiling import Signature, signature
from solvers.variation.derivative_shapes import derivative_shapes
from solvers.variation.parametric_cell import HEIGHT, SIDE, CellFamily, X, Y
from solvers.variation.plate_space import ChangedPlate, PlateSpace

CUT = 3.0  # standard deviations: a part beyond is no part of the batch
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

    stiffness, mass: the cell's changes at the nodes of its family, (nodes, r, r); missed: of both, (r, r), as the family's.
    """

    family: CellFamily
    numbers: IntArray
    signs: FloatArray
    motions: FloatArray
    stiffness: FloatArray
    mass: FloatArray
    missed: tuple[FloatArray, FloatArray]

    def changes(self, change_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What K and M of each pillar's cell change by where it is off by (p, 4) m in the cell's own directions, (p, r, r)."""
        weights = self.family.weights(change_m)
        stiffness, mass = (np.tensordot(weights, nodes, axes=1) for nodes in (self.stiffness, self.mass))
        return stiffness, mass


class VariedPlate:
    """The nominal plate as driven, and what each pillar's change adds to it; `pillars` (n, 2) in m are where they stand."""

    def __init__(self, forced: ForcedPlate, families: Mapping[Signature, CellFamily]) -> None:
        self.forced = forced
        self.space = PlateSpace(forced, derivative_shapes(forced, families, CUT))
        self.pillars, self._kinds = self._placed(families)

    def sample(self, change_m: FloatArray, within_hz: tuple[float, float] | None = None) -> ChangedPlate:
        """The plate with deviations (pillars, 4) in m: height, side, x, y, in the order of `pillars`.

        within_hz: take only the modes between these frequencies into the space, besides the static answers.
        """
        if change_m.shape != (len(self.pillars), 4):
            raise SolverError(f"deviations of shape {change_m.shape}: must be ({len(self.pillars)}, 4)")
        changes = [kind.changes(change_m[kind.numbers] * kind.signs) for kind in self._kinds]
        return self._changed(changes, None if within_hz is None else self.space.within(within_hz))

    def checked(self) -> tuple[ChangedPlate, ChangedPlate]:
        """The plate whose pillars are all off by what each family was checked at: as interpolated, and from the reductions."""
        interpolated, reduced = [], []
        for kind in self._kinds:
            own = kind.changes(np.broadcast_to(kind.family.checked_m, kind.signs.shape))
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
        for start, basis in zip(self.space.starts, self.space.bases, strict=False):
            group = basis.group
            for plate, part in zip(group.plates, group.split(basis.columns), strict=True):
                parts.append((int(start), plate.symmetry, plate.cell_vectors(plate.placed_cells[place], part)))
        return parts

    def _turned(self, parts: list[tuple[int, str, FloatArray]], turn: list[float]) -> FloatArray:
        """The motions of the cell's mirror image, seen in that mirror."""
        out = np.zeros((len(parts[0][2]), self.space.size))
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
    """Statistics of at least one value; one alone tells no deviation."""
    deviation = float(np.std(values, ddof=1)) if len(values) > 1 else None
    return Spread(float(np.mean(values)), deviation, float(np.min(values)), float(np.max(values)))


__all__ = ["CUT", "HEIGHT", "SIDE", "Deviations", "Spread", "VariedPlate", "X", "Y", "spread"]
