"""Error bars of a driven plate: of its resonances, of any figure computed from them, and of a peak's quality factor."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from copy import copy
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.piezo import responses
from solvers.piezo.forced import ForcedPlate, GroupModes, PlateMode
from solvers.piezo.responses import open_patches

# -- any figure --------------------------------------------------------------------------------------------------------
# Error bars of a driven plate: those of its resonances, and those of any figure computed from them.
# A stiffness with an error d, |d_ij| <= 2 e (l_i l_j)^(1/2) of M-orthonormal modes with eigenvalues l and relative
# frequency errors e (parlett1998), moves each resonance and mixes the modes. A figure is computed again on plates
# with these differences: every resonance moved to either end of its bar, the pairs of a resonating mode and each other one
# mixed. It is nonlinear where modes lie close to each other or to the frequency; the changes of independent sources add up
# by their squares.

Plate = TypeVar("Plate", bound=ForcedPlate)
Varied = TypeVar("Varied")  # a Variation, a Louder, or how a plate so changed is driven
CACHED = ("all_modes", "_touched")  # values derived from modes, computed again on demand


def frequency_errors(forced: ForcedPlate) -> list[FloatArray]:
    """Estimate the errors of the resonances around the band due to mesh, reduction and bonding.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.

    Returns
    -------
    list of ndarray, shape (modes,)
        Relative half-widths per group in the order of `bases`; NaN without an estimate.
    """
    return [responses.frequency_errors(basis).total for basis in bases(forced)]


def bases(forced: ForcedPlate) -> list[GroupModes]:
    """List the groups of modes that move: those that the patches drive, or all under a finger.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.

    Returns
    -------
    list of GroupModes
        One per group of symmetry classes.
    """
    free: ForcedPlate | None = getattr(forced, "free", None)
    if free is None or forced.modes is free.modes:
        return forced.modes
    return free.all_modes


def frequency_error(forced: ForcedPlate, frequency_hz: float, errors: list[FloatArray]) -> float | None:
    """Return the error bar of the resonance nearest to a frequency.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.
    frequency_hz : float
        The frequency.
    errors : list of ndarray, shape (modes,)
        As from `frequency_errors`.

    Returns
    -------
    float or None
        Relative half-width, dimensionless; None without an estimate.
    """
    tones = np.concatenate([basis.frequency_hz for basis in bases(forced)])
    if not len(tones):
        return None
    error = float(np.concatenate(errors)[int(np.argmin(np.abs(tones - frequency_hz)))])
    return error if np.isfinite(error) else None


@dataclass(frozen=True)
class Variation:
    """A plate within its error bars: new eigenvalues of some modes of a group, and the pair mixed by an angle.

    own: factor on the frequency of the resonance in question.
    """

    basis: GroupModes
    places: tuple[int, ...]
    values: tuple[float, ...]
    turn: FloatArray | None = None
    own: float = 1.0

    def of(self, plate: Plate) -> Plate:
        """A plate with these modes, free or under a finger, with the same drive."""
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
    """Yield plates within the error bars around the resonance nearest to a frequency, those of one source together.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.
    errors : list of ndarray, shape (modes,)
        As from `frequency_errors`.
    resonating_hz : float
        Frequency near the resonance.
    share : float
        Expected fraction of the bound on mixing (`solvers.accuracy.calibration`).

    Yields
    ------
    tuple of Variation
        Both ends of one source.
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
    """Select those of the `variations` that mix another mode into the resonance nearest to a frequency.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.
    errors : list of ndarray, shape (modes,)
        As from `frequency_errors`.
    resonating_hz : float
        Frequency near the resonance.
    share : float
        Expected fraction of the bound on mixing.

    Returns
    -------
    iterator of tuple of Variation
        Both signs of one pair.
    """
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
        """Values of a group's columns, unchanged."""
        return values

    def of_basis(self, basis: GroupModes, patches: int | None = None) -> GroupModes:
        """A group's modes with these loads; patches: how many of the loads are such, all where it is not given."""
        gain, where = basis.gain.copy(), slice(0, patches) if self.patch is None else self.patch
        gain[:, where] *= self.factor
        return replace(basis, gain=gain)


def louder(forced: ForcedPlate, error: float) -> Iterator[tuple[Louder, ...]]:
    """Yield plates with loads at the upper end of an error bar: of all patches, and of each of several drivers.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its patches.
    error : float
        Relative error bar of the loads, dimensionless.

    Yields
    ------
    tuple of Louder
        One plate.
    """
    yield (Louder(1.0 + error),)
    if len(forced.drivers) > 1:
        for patch in forced.drivers:
            yield (Louder(1.0 + error, patch),)


def sources(
    forced: ForcedPlate, errors: list[FloatArray], resonating_hz: float, share: float, load: float | None
) -> Iterator[tuple[Variation | Louder, ...]]:
    """Yield every source of error of the resonance nearest to a frequency.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.
    errors : list of ndarray, shape (modes,)
        As from `frequency_errors`.
    resonating_hz : float
        Frequency near the resonance.
    share : float
        Expected fraction of the bound on mixing.
    load : float or None
        Relative error bar of the loads, dimensionless; None without an estimate.

    Yields
    ------
    tuple of Variation or Louder
        Plates of one source.
    """
    yield from variations(forced, errors, resonating_hz, share)
    yield from louder(forced, np.nan if load is None else load)


def is_known(errors: list[FloatArray]) -> bool:
    """Test whether every resonance has an error bar.

    Parameters
    ----------
    errors : list of ndarray, shape (modes,)
        As from `frequency_errors`.

    Returns
    -------
    bool
        True if all are finite.
    """
    return all(bool(np.isfinite(each).all()) for each in errors)


def half_widths(
    nominal: FloatArray,
    sources: Iterable[tuple[Varied, ...]],
    figures: Callable[[Varied], FloatArray],
) -> FloatArray:
    """Combine the changes of figures on varied plates, as the root of the sum of their squares.

    Parameters
    ----------
    nominal : ndarray, shape (n,)
        The figures, in any units.
    sources : iterable of tuple
        Varied plates, those of one source together.
    figures : callable
        Computes the figures (n,) of a varied plate.

    Returns
    -------
    ndarray, shape (n,)
        Half-widths in the units of the figures; NaN without an estimate.
    """
    squares = np.zeros_like(nominal)
    for source in sources:
        squares += np.max([np.abs(figures(each) - nominal) for each in source], axis=0) ** 2
    return np.asarray(np.sqrt(squares))


# -- quality factor ----------------------------------------------------------------------------------------------------
# First-order changes of the quality factor read from a peak, by small changes of the modes behind it.
# The zone's square z^2 = sum a^H G a has modal amplitudes a = D g'v with voltages v. A symmetric change E of the
# modes' stiffness changes it by -2 Re (1 + i/Q) s'D E a, s' = a^H G - q^H C^-1 g': q = dz^2/dv, C the charge per volt
# of the patches that no voltage holds. One adjoint per frequency so serves every E; the changes of ln z^2 on the peak and at
# its half-power points make that of the quality factor.

STEP = 0.01  # of the half-power width: frequencies on both sides of one, for derivatives


@dataclass(frozen=True, eq=False)
class WidthRates:
    """Rates of ln Q per change of the modes' stiffness, (modes, modes) per group, and each mode's largest flexibility about
    the peak, (modes,).
    """

    modes: list[GroupModes]
    rates: list[FloatArray]
    flexibility: list[FloatArray]

    def change(self, variation: Variation) -> float:
        """Relative change of the quality factor to first order."""
        number, places, stiffness = self._stiffness(variation)
        return float((stiffness * self.rates[number][np.ix_(places, places)]).sum())

    def ratio(self, variation: Variation) -> float:
        """|D E|, about by how much of the first-order change that of second order differs."""
        number, places, stiffness = self._stiffness(variation)
        root = np.sqrt(self.flexibility[number][places])
        return float(np.linalg.norm(root[:, None] * stiffness * root, 2))

    def _stiffness(self, variation: Variation) -> tuple[int, list[int], FloatArray]:
        """Group, places and change of the modal stiffness of a varied plate."""
        plates = variation.basis.group.plates
        number = next(i for i, basis in enumerate(self.modes) if basis.group.plates is plates)
        places = list(variation.places)
        turn = np.eye(len(places)) if variation.turn is None else variation.turn
        changed = (turn * np.array(variation.values)) @ turn.T - np.diag(variation.basis.eigenvalue[places])
        return number, places, changed


def width_rates(forced: ForcedPlate, peak_hz: float, half_hz: tuple[float, float]) -> WidthRates:
    """Compute how a peak's quality factor changes with the stiffness of the modes.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.
    peak_hz : float
        Frequency of the peak.
    half_hz : tuple of float
        Its half-power points, in Hz.

    Returns
    -------
    WidthRates
        Rates of ln Q, and the largest flexibility of each mode around the peak.
    """
    width = half_hz[1] - half_hz[0]
    step = STEP * width
    tones = np.concatenate([tone + step * np.arange(-1, 2) for tone in (peak_hz, *half_hz)])
    at = np.array([forced.plate.scale.eigenvalue(tone) for tone in tones])
    square, adjoint, amplitude = _adjoint(forced, at)
    weights = _weights(np.log(square), peak_hz, width, step) / square
    flexible = [basis.flexibility(at) for basis in forced.modes]
    pairs = zip(forced.modes, adjoint, flexible, amplitude, strict=True)
    rates = [
        ((-2.0 * (1.0 + 1j * basis.loss) * weights[:, None] * left * mobile).T @ right).real
        for basis, left, mobile, right in pairs
    ]
    return WidthRates(forced.modes, rates, [np.abs(each).max(axis=0) for each in flexible])


def _weights(level: FloatArray, peak_hz: float, width: float, step: float) -> FloatArray:
    """Change of ln Q = ln f0 - ln (f2 - f1) per change of ln z^2, at three frequencies about each of f0, f1 and f2, (9,)."""
    top, low, high = level.reshape(3, 3)
    below, above = (side[2] - side[0] for side in (low, high))
    curving = top[0] - 2.0 * top[1] + top[2]
    out = np.zeros((3, 3))
    out[0] = np.array([0.5, 0.0, -0.5]) * step / (curving * peak_hz)
    out[:, 1] += np.array([1.0 / below - 1.0 / above, -1.0 / below, 1.0 / above]) * 2.0 * step / width
    return out.ravel()


def _adjoint(forced: ForcedPlate, at: FloatArray) -> tuple[FloatArray, list[ComplexArray], list[ComplexArray]]:
    """The zone's square (n,) at eigenvalues (n,), and group by group s and the modes' amplitudes, (n, modes) each."""
    volts, opened = forced.volts_over(at), open_patches(forced)
    columns = [basis.amplitudes(at, volts) for basis in forced.modes]
    heavy: list[ComplexArray] = [
        np.asarray(np.conj(each) @ gram[0]) for each, gram in zip(columns, forced.grams, strict=True)
    ]
    square = np.sum([(left * right).sum(axis=1).real for left, right in zip(heavy, columns, strict=True)], axis=0)
    counts = [len(basis.eigenvalue) for basis in forced.modes]
    back = _per_charge(forced, at, heavy, opened)
    own = [
        left[:, :count] - back @ basis.gain[:, opened].T
        for left, count, basis in zip(heavy, counts, forced.modes, strict=True)
    ]
    return square, own, [each[:, :count] for each, count in zip(columns, counts, strict=True)]


def _per_charge(forced: ForcedPlate, at: FloatArray, heavy: list[ComplexArray], opened: list[int]) -> ComplexArray:
    """q^H C^-1 of the patches that no voltage holds, (n, open), scaled."""
    count = len(forced.plate.patches)
    units = np.broadcast_to(np.eye(count, dtype=complex)[:, None], (count, len(at), count))
    unit = forced.plate.stiffness_unit
    per_volt = np.zeros((len(at), count), dtype=complex)
    moved = np.zeros((len(at), len(opened), len(opened)), dtype=complex)
    for basis, left in zip(forced.modes, heavy, strict=True):
        answers = basis.amplitudes(at, units)
        per_volt += np.einsum("nc,pnc->np", left, answers)
        moved += basis.receptance(at)[:, opened][:, :, opened]
    clamped = unit * moved + np.diag(forced.plate.capacitance_f[opened])
    return np.asarray(unit * np.linalg.solve(clamped.swapaxes(1, 2), per_volt[:, opened, None])[..., 0])
