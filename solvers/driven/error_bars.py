"""Error bars of what a driven plate does: those of its resonances, and what they make of any figure computed from them.

A stiffness that is wrong by d, |d_ij| <= 2 e (l_i l_j)^(1/2) of M-orthonormal modes with eigenvalues l and relative frequency
errors e (parlett1998), moves each resonance and mixes the modes. A figure is computed again on plates that differ so: every
resonance moved to either end of its bar, the pairs of a resonating mode and each other one mixed. It is nonlinear where modes
lie close to each other or to the tone; the changes of independent sources add up by their squares.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from copy import copy
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from geometry.elements import FloatArray
from solvers.piezo import frequency_bar
from solvers.piezo.forced import ForcedPlate, GroupModes, PlateMode

Plate = TypeVar("Plate", bound=ForcedPlate)
Varied = TypeVar("Varied")  # a Variation, a Louder, or how a plate so changed is driven
CACHED = ("all_modes", "_touched")  # what follows from modes and is computed again when asked for


def frequency_errors(forced: ForcedPlate) -> list[FloatArray]:
    """Half-width of the bar of every resonance about the band by mesh, reduction and bonding, relative, (modes,) a group in the
    order of `bases`; NaN where nothing shows it.
    """
    return [frequency_bar.frequency_errors(basis).total for basis in bases(forced)]


def bases(forced: ForcedPlate) -> list[GroupModes]:
    """Groups of modes that move: those that the patches drive, under a finger all."""
    free: ForcedPlate | None = getattr(forced, "free", None)
    if free is None or forced.modes is free.modes:
        return forced.modes
    return free.all_modes


def frequency_error(forced: ForcedPlate, frequency_hz: float, errors: list[FloatArray]) -> float | None:
    """Half-width of the bar of the resonance nearest to a frequency, relative; None where it is not known."""
    tones = np.concatenate([basis.frequency_hz for basis in bases(forced)])
    if not len(tones):
        return None
    error = float(np.concatenate(errors)[int(np.argmin(np.abs(tones - frequency_hz)))])
    return error if np.isfinite(error) else None


@dataclass(frozen=True)
class Variation:
    """A plate within its bars: new eigenvalues of some modes of a group, and the pair that turns into each other by an angle.

    own: factor on the frequency of the resonance in question.
    """

    basis: GroupModes
    places: tuple[int, ...]
    values: tuple[float, ...]
    turn: FloatArray | None = None
    own: float = 1.0

    def of(self, plate: Plate) -> Plate:
        """A plate with these modes, free or under a finger; what is fed to it stays."""
        other = copy(plate)
        for name in CACHED:
            other.__dict__.pop(name, None)
        free: ForcedPlate | None = getattr(plate, "free", None)
        if free is not None:
            bare = self.of(free)
            other.__dict__["free"] = bare
            if plate.modes is free.modes:
                other.modes = bare.modes
                if self.turn is not None:
                    self._turn_kept(plate, other)
                return other
        other.modes = [self.of_basis(each) for each in plate.modes]
        if (found := plate.__dict__.get("target")) is not None:  # the same mode stays the target mode
            other.__dict__["target"] = replace(found, modes=tuple(map(self._mode, found.modes)))
        if self.turn is not None:
            self._turn_kept(plate, other)
        return other

    def _turn_kept(self, plate: Plate, other: Plate) -> None:
        """Gram matrices and rows of the contact that the plate keeps, in the new modes."""
        other.__dict__["grams"] = [
            (self._turned(gram[0], True), self._turned(gram[1], True)) if self._is_in(basis) else gram
            for basis, gram in zip(plate.modes, plate.grams, strict=True)
        ]
        if "contact_rows" in plate.__dict__:
            pairs = zip(plate.modes, plate.__dict__["contact_rows"], strict=True)
            other.__dict__["contact_rows"] = [
                self._turned(rows) if self._is_in(basis) else rows for basis, rows in pairs
            ]

    def of_columns(self, basis: GroupModes, values: FloatArray) -> FloatArray:
        """Values (..., columns) of a group's columns in the new modes."""
        return self._turned(values) if self._is_in(basis) else values

    def of_basis(self, basis: GroupModes) -> GroupModes:
        """A group's new modes."""
        if not self._is_in(basis):
            return basis
        eigenvalue, tones = basis.eigenvalue.copy(), basis.frequency_hz.copy()
        places = list(self.places)
        tones[places] *= np.sqrt(np.array(self.values) / eigenvalue[places])
        eigenvalue[places] = self.values
        other = replace(basis, eigenvalue=eigenvalue, frequency_hz=tones)
        if self.turn is None:
            return other
        return replace(other, gain=self._turned(basis.gain.T).T, columns=self._turned(basis.columns))

    def _is_in(self, basis: GroupModes) -> bool:
        return basis.group.plates is self.basis.group.plates

    def _mode(self, mode: PlateMode) -> PlateMode:
        if mode.place not in self.places or mode.group.plates is not self.basis.group.plates:
            return mode
        place = self.places.index(mode.place)
        moved = float(np.sqrt(self.values[place] / self.basis.eigenvalue[mode.place]))
        return replace(mode, frequency_hz=mode.frequency_hz * moved)

    def _turned(self, values: FloatArray, both: bool = False) -> FloatArray:
        """Columns of the pair, and rows of a Gram matrix, in the new modes."""
        if self.turn is None:
            return values
        out, places = values.copy(), list(self.places)
        out[..., places] = out[..., places] @ self.turn
        if both:
            out[..., places, :] = self.turn.T @ out[..., places, :]
        return out


def variations(
    forced: ForcedPlate, errors: list[FloatArray], resonating_hz: float, share: float
) -> Iterator[tuple[Variation, ...]]:
    """Plates within the bars about the resonance nearest to a frequency, those of one source together.

    share: of the bound on mixing that is expected (`pipeline.planning.calibration`).
    """
    moving = bases(forced)
    number, index = _nearest(moving, resonating_hz)
    for place, (basis, error) in enumerate(zip(moving, errors, strict=True)):
        for mode, (value, half) in enumerate(zip(basis.eigenvalue, error, strict=True)):
            ends = [(1.0 + sign * half) ** 2 for sign in (-1.0, 1.0)]
            is_own = (place, mode) == (number, index)
            yield tuple(
                Variation(basis, (mode,), (value * end,), None, float(np.sqrt(end)) if is_own else 1.0) for end in ends
            )
            if place == number and not is_own:
                pair = (index, mode)
                yield tuple(_mixed(basis, pair, sign * share * max(half, error[index])) for sign in (-1.0, 1.0))


def mixings(
    forced: ForcedPlate, errors: list[FloatArray], resonating_hz: float, share: float
) -> Iterator[tuple[Variation, ...]]:
    """Those of the plates that mix another mode into the resonance nearest to a frequency."""
    return (each for each in variations(forced, errors, resonating_hz, share) if each[0].turn is not None)


def _mixed(basis: GroupModes, pair: tuple[int, int], error: float) -> Variation:
    """Two modes coupled by 2 error (l_i l_j)^(1/2)."""
    values = basis.eigenvalue[list(pair)]
    coupling = 2.0 * error * float(np.sqrt(values.prod()))
    new, turn = np.linalg.eigh(np.array([[values[0], coupling], [coupling, values[1]]]))
    order = [int(np.argmax(np.abs(turn[0]))), int(np.argmin(np.abs(turn[0])))]
    turn = turn[:, order] * np.sign(np.diag(turn[:, order]))
    return Variation(basis, pair, tuple(new[order]), turn, float(np.sqrt(new[order[0]] / values[0])))


def _nearest(moving: list[GroupModes], frequency_hz: float) -> tuple[int, int]:
    """Group and number of the mode nearest to a frequency."""
    away = [(abs(hz - frequency_hz), i, k) for i, basis in enumerate(moving) for k, hz in enumerate(basis.frequency_hz)]
    return min(away)[1:]


@dataclass(frozen=True)
class Louder:
    """A plate whose patches push harder, all or one of them."""

    factor: float
    patch: int | None = None
    own: float = 1.0

    def of(self, plate: Plate) -> Plate:
        """A plate with these loads."""
        other = copy(plate)
        free: ForcedPlate | None = getattr(plate, "free", None)
        if free is not None:
            other.__dict__["free"] = self.of(free)
        other.modes = [self.of_basis(each, len(plate.plate.patches)) for each in plate.modes]
        return other

    def of_columns(self, basis: GroupModes, values: FloatArray) -> FloatArray:
        """Values of a group's columns, which stay."""
        return values

    def of_basis(self, basis: GroupModes, patches: int | None = None) -> GroupModes:
        """A group's modes with these loads; patches: how many of the loads are such, all where it is not given."""
        gain, where = basis.gain.copy(), slice(0, patches) if self.patch is None else self.patch
        gain[:, where] *= self.factor
        return replace(basis, gain=gain)


def louder(forced: ForcedPlate, error: float) -> Iterator[tuple[Louder, ...]]:
    """All patches, and each of several that drive, with loads at the upper end of a relative bar."""
    yield (Louder(1.0 + error),)
    if len(forced.drivers) > 1:
        for patch in forced.drivers:
            yield (Louder(1.0 + error, patch),)


def sources(
    forced: ForcedPlate, errors: list[FloatArray], resonating_hz: float, share: float, load: float | None
) -> Iterator[tuple[Variation | Louder, ...]]:
    """All that may be wrong about the resonance nearest to a frequency; load: half-width of the loads' bar, relative."""
    yield from variations(forced, errors, resonating_hz, share)
    yield from louder(forced, np.nan if load is None else load)


def is_known(errors: list[FloatArray]) -> bool:
    """Whether every resonance has a bar."""
    return all(bool(np.isfinite(each).all()) for each in errors)


def half_widths(
    nominal: FloatArray,
    sources: Iterable[tuple[Varied, ...]],
    figures: Callable[[Varied], FloatArray],
) -> FloatArray:
    """Half-widths of the bars of figures (n,) that are computed again on varied plates; NaN where one of them is not known."""
    squares = np.zeros_like(nominal)
    for source in sources:
        squares += np.max([np.abs(figures(each) - nominal) for each in source], axis=0) ** 2
    return np.asarray(np.sqrt(squares))
