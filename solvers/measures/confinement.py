"""Confinement of a motion in dB, of the target mode and of several zones, and its error due to mixed neighbours."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from math import log
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from geometry.elements import BoolArray, FloatArray, IntArray
from geometry.layout import Design
from solvers.analytic.beams import zone_mode
from solvers.errors import SolverError
from solvers.measures.target_mode import Verdict, verdict

LARGEST_DB = 3000.0  # largest error bar: ten to the power of a tenth of more would overflow
CONFINED_DB = 10.0  # rms on the active face over rms on the passive one
NEGLIGIBLE = 1e-9  # of the larger part's area: a smaller part is rounding
BESIDE = (0.75, 1.3)  # of a window's ends: modes within move driven zones
FINE = 6  # points per half-power width

DECIBELS = 20.0 / log(10.0)


@dataclass(frozen=True)
class Confinement:
    """Measures per mode, (k,) each; NaN where the plate has no such part.

    zone_share: of |u_z|^2 over the touch face, on its active part. confinement_db, extension_db: 20 log10 of rms |u_z| on the
    active touch face over that on the passive one, and over that beyond the last row. mac: with the target shape on the active
    face. strength: rho h <u_z, shape>^2 / (<shape, shape> modal mass), NaN where the modal mass is not known.
    """

    zone_share: FloatArray
    confinement_db: FloatArray
    mac: FloatArray
    extension_db: FloatArray
    strength: FloatArray

    @property
    def target(self) -> Verdict:
        """The target mode among them, by the rule of `solvers.measures.target_mode`."""
        return verdict(self.strength, self.zone_share, self.mac)


@dataclass(frozen=True)
class AcrossModes:
    """Modes across a plate at one wavenumber along it, u_z even about y = 0, ascending: frequency_hz (k,) and how well each is
    confined.
    """

    frequency_hz: FloatArray
    confinement: Confinement


@dataclass(frozen=True)
class TouchField:
    """u_z at quadrature points of the touch face: points (q, 2) in m, weights (q,) in m2, values (q, k).

    modal_mass_kg: of each field, where it is a mode; NaN where that is not known, as of a measured map.
    """

    points: FloatArray
    weights: FloatArray
    values: FloatArray
    modal_mass_kg: float = np.nan

    def is_active(self, design: Design) -> BoolArray:
        """Mask of the points on the active face, (q,)."""
        return design.in_zone(self.points)


@dataclass(frozen=True)
class Profile:
    """u_z over y: places y_m (q,), weights (q,), values (q, k) real or complex, and the target motion there, shape (q,).

    modal_mass: of each mode, kg over the weights' unit (kg/m for weights in m, kg for weights in m2).
    """

    y_m: FloatArray
    weights: FloatArray
    values: NDArray[Any]
    shape: NDArray[Any]
    modal_mass: float


@dataclass(frozen=True)
class DrivenZones:
    """Results of every driven zone: its peak in Hz, the rms of every zone and of the passive face over its own in dB, (zones,
    zones + 1), and its motion's MAC with the target shape, (zones,).
    """

    peak_hz: FloatArray
    level_db: FloatArray
    mac: FloatArray

    @property
    def isolation_db(self) -> float:
        """Least level of a driven zone over another one, dB."""
        return float(np.min(-self.level_db[:, :-1][~np.eye(len(self.mac), dtype=bool)]))

    @property
    def confinement_db(self) -> float:
        """Least level of a driven zone over the passive face, dB."""
        return float(np.min(-self.level_db[:, -1]))


AT_ONCE = 4_000  # points whose motion is weighed at once: of all of them it would be a second copy


def _parted(weights: FloatArray, points: FloatArray, design: Design) -> list[FloatArray]:
    """Weights (q,) of the points (q, 2) in the zone, on the passive face and beyond the last row, 0 elsewhere."""
    masks = design.in_zone(points), design.passive(points), design.beyond_rows(points)
    return [weights * mask for mask in masks]


def _blocks(parts: Sequence[FloatArray], values: Any) -> Iterator[tuple[FloatArray, Any]]:
    """Weights (parts, q) and values (q, k) of some points after others."""
    for first in range(0, len(values), AT_ONCE):
        at = slice(first, first + AT_ONCE)
        yield np.array([part[at] for part in parts]), values[at]


def _products(parts: Sequence[FloatArray], values: Any) -> list[FloatArray]:
    """Sum of w_q conj(v_qi) v_qj over the points q, (k, k), for the weights (q,) of each part, 0 outside it."""
    sums = [np.zeros((values.shape[1],) * 2, dtype=values.dtype) for _ in parts]
    for weights, some in _blocks(parts, values):
        for total, heavy in zip(sums, weights, strict=True):
            if (within := heavy != 0.0).any():
                own = some if within.all() else some[within]
                total += own.conj().T @ (heavy[within, None] * own)
    return sums


def _squares(parts: Sequence[FloatArray], values: Any) -> list[FloatArray]:
    """Sum of w_q |v_qi|^2 over the points q, (k,), for the weights of each part."""
    sums = np.zeros((len(parts), values.shape[1]))
    for weights, some in _blocks(parts, values):
        sums += weights @ (some.conj() * some).real
    return list(sums)


@dataclass(frozen=True)
class Overlaps:
    """Products of the u_z of every two modes of a class over the active and the passive touch face, (k, k) each, m2.

    projection: of each mode on the target shape of unit square, (k,) in m; strength: over its square, 1/m2.
    """

    active: FloatArray
    passive: FloatArray
    projection: FloatArray = field(default_factory=lambda: np.zeros(0))
    strength: float = np.nan

    @classmethod
    def between(cls, active: FloatArray, passive: FloatArray, values: Any) -> Overlaps:
        """Overlaps from the weights (q,) of both parts, 0 outside them, and values (q, k)."""
        of_active, of_passive = _products((active, passive), values)
        return cls(of_active, of_passive)

    def among(self, modes: Sequence[int]) -> Overlaps:
        """Overlaps of some of the modes."""
        square, shapes = np.ix_(modes, modes), self.projection[list(modes)] if len(self.projection) else self.projection
        return Overlaps(self.active[square], self.passive[square], shapes, self.strength)

    def mixing_db(self, frequency_hz: FloatArray, index: int, error: float, ends_hz: tuple[float, ...] = ()) -> float:
        """Bound the change of a mode's confinement by mixing with neighbours, from relative frequency errors (parlett1998).

        A stiffness too high by d >= 0 with d_jj <= 2 error w_j^2 has |d_ij| <= 2 error w_i w_j, and adds to mode i of its
        neighbours c_j = d_ij / (w_i^2 - w_j^2), one at most. Each moves the level by (20 / ln 10) c_j (A_ij/A_ii - P_ij/P_ii)
        with the overlaps A and P. Neighbours add up by their squares.

        Parameters
        ----------
        frequency_hz : (k,) array
            Of the modes.
        index : int
            The mode whose level it is.
        error : float
            Relative error of the frequencies.
        ends_hz : tuple of float
            Of the interval in which all modes are known; beyond each one more may lie, as unlike as the most unlike of these.

        Returns
        -------
        float
            Decibels.
        """
        inside, outside = (part[index] / part[index, index] for part in (self.active, self.passive))
        unlike = np.abs(inside - outside)
        unlike = np.append(unlike, [np.delete(unlike, index).max(initial=0.0)] * len(ends_hz))
        return float(DECIBELS * np.linalg.norm(mixed_shares(frequency_hz, index, error, ends_hz) * unlike))

    def mixing_shape(
        self, frequency_hz: FloatArray, index: int, error: float, ends_hz: tuple[float, ...] = (), share: float = 1.0
    ) -> tuple[float, float]:
        """Bound the change of a mode's MAC and strength by the same neighbours, each counted by `share`.

        With c of mode j mixed in, of either sign, the MAC is (q_i + c q_j)^2 / (A_ii + 2 c A_ij + c^2 A_jj) and the strength
        s (q_i + c q_j)^2 / (1 + c^2), with the projections q on the target shape. Parameters as of `mixing_db`.
        """
        mixed = share * mixed_shares(frequency_hz, index, error, ends_hz)
        others = np.delete(np.arange(len(frequency_hz)), index)
        if not len(others):
            return np.nan, np.nan
        known = self._moved(index, others, mixed[others])
        beyond = [self._moved(index, others, own).max(axis=-1) for own in mixed[len(frequency_hz) :]]
        mac, strength = np.linalg.norm(np.column_stack([known, *beyond]), axis=-1)
        return float(mac), float(strength)

    def _moved(self, index: int, others: IntArray, mixed: FloatArray | float) -> FloatArray:
        """Changes (2, k) of a mode's MAC and strength by a share of each of the others, of the sign that moves them most."""
        own = self.active[index, index]
        signed = np.multiply.outer([1.0, -1.0, 0.0], np.broadcast_to(mixed, len(others)))
        projected = (self.projection[index] + signed * self.projection[others]) ** 2
        inside = own + 2.0 * signed * self.active[index, others] + signed**2 * self.active[others, others]
        both = np.array([projected / np.maximum(inside, 1e-300), self.strength * projected / (1.0 + signed**2)])
        return np.asarray(np.abs(both[:, :2] - both[:, 2:]).max(axis=1))


Pair: TypeAlias = "tuple[Overlaps | None, Overlaps | None]"


@dataclass(frozen=True)
class Weighed:
    """Integrals of the u_z of modes over zone, passive face and the plate beyond the last row: products of every two (3, k, k)
    and areas (3,), m2.

    projection: of each mode on the target shape of unit square, (k,) in m; per_mass: mass per area over the modal mass.
    """

    products: FloatArray
    areas: FloatArray
    projection: FloatArray
    per_mass: float

    @classmethod
    def over(cls, fields: Iterable[TouchField], design: Design, symmetry: str | None = None) -> Weighed:
        """Integrate over a touch face, of which each field holds some of the points."""
        products, areas, projection, square = np.zeros(()), np.zeros(3), np.zeros(()), 0.0
        for touch in fields:
            parts = _parted(touch.weights, touch.points, design)
            products = products + np.array(_products(parts, touch.values))
            areas += [part.sum() for part in parts]
            heavy = touch.weights * (shape := _shape_at(touch, design, symmetry))
            projection, square = projection + heavy @ touch.values, square + float(heavy @ shape)
            per_mass = design.stack.mass_kg_m2 / touch.modal_mass_kg
        return cls(products, areas, projection / np.sqrt(max(square, 1e-300)), per_mass)

    @property
    def measures(self) -> Confinement:
        """Measures of every mode."""
        squares = list(np.einsum("pkk->pk", self.products))
        return confined(squares, list(self.areas), self.projection**2, self.per_mass)

    @property
    def overlaps(self) -> Pair:
        """Overlaps with the passive face, and with the plate beyond the last row; None without such a part.

        The latter lack what belongs to the target shape.
        """
        active, passive, beyond = self.products
        return (
            Overlaps(active, passive, self.projection, self.per_mass) if self.areas[1] > 0.0 else None,
            Overlaps(active, beyond) if self.areas[2] > NEGLIGIBLE * self.areas[0] else None,
        )


def ratio_db(inside: Any, outside: Any) -> FloatArray:
    """Express the ratio of rms values as a level, 20 log10(inside/outside).

    Parameters
    ----------
    inside, outside : array_like, any shape
        Rms values in one unit.

    Returns
    -------
    ndarray, same shape
        In dB; infinite where nothing moves outside.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(20.0 * np.log10(np.asarray(inside) / np.asarray(outside)))


def share_error(share: float | None, level_error_db: float | None) -> float | None:
    """Bound the error of a part's share of the squares by the error of its level.

    For given areas, share / (1 - share) is proportional to 10^(level/10), so that an error e of the level puts the share
    at share g / (1 - share + share g) with g = 10^(+-e/10). The farther of both counts.

    Parameters
    ----------
    share : float or None
        Share of the part, 0 to 1 (dimensionless).
    level_error_db : float or None
        Half-width of the level's error bar.

    Returns
    -------
    float or None
        Half-width of the share's error bar, dimensionless; None if one is unknown.

    Examples
    --------
    >>> from solvers.measures.confinement import share_error
    >>> round(share_error(0.9, 0.1), 4), share_error(1.0, 0.1), share_error(0.9, None)
    (0.0021, 0.0, None)
    """
    if share is None or level_error_db is None:
        return None
    factor = 10.0 ** (min(level_error_db, LARGEST_DB) / 10.0)
    moved = (share * g / (1.0 - share + share * g) for g in (factor, 1.0 / factor))
    return max(abs(each - share) for each in moved)


def target_shape(design: Design, points: FloatArray) -> FloatArray:
    """Evaluate the analytic (0, N) shape: half a sine across the zone times a beam mode along it.

    The beam is free where the zone ends with the plate, and pinned where the plate goes on.

    Parameters
    ----------
    design : Design
        The plate with its zone.
    points : ndarray, shape (q, 2) or (q, 3)
        Points in m from the centre of the plate.

    Returns
    -------
    ndarray, shape (q,)
        The shape, 1 at the crest across; along it as `BeamMode.shape`.
    """
    x, y = points[:, 0] - design.centre_m[0], points[:, 1] - design.centre_m[1]
    across = np.sin(np.pi * (y + design.width_m / 2.0) / design.width_m)
    along = zone_mode(design.nodal_lines, *design.goes_on).shape(x / design.length_m + 0.5)
    return np.asarray(across * along)


def target_symmetry(nodal_lines: int) -> str:
    """Return the symmetry class (x, y) of u_z of the target mode.

    A free-free beam with N nodes is even for even N; half a sine is even.

    Parameters
    ----------
    nodal_lines : int
        N.

    Returns
    -------
    str
        "SS" or "AS".
    """
    return ("S" if nodal_lines % 2 == 0 else "A") + "S"


def measure(touch: TouchField, design: Design, symmetry: str | None) -> Confinement:
    """Measure the confinement of modes from their normal displacement on the touch face.

    Parameters
    ----------
    touch : TouchField
        Points, weights and modes.
    design : Design
        The plate with its zone.
    symmetry : str or None
        Symmetry class of a halved model, in which a target shape of another class is 0; None for a whole plate.

    Returns
    -------
    Confinement
        Zone share, level in dB, MAC and strength of every mode, (k,) each.
    """
    shape = _shape_at(touch, design, symmetry)
    profile = Profile(touch.points[:, 1], touch.weights, touch.values, shape, touch.modal_mass_kg)
    return _measured(profile, design, touch.points)


def strength_force(touch: TouchField, design: Design, symmetry: str | None) -> FloatArray:
    """Compute the forces whose work on a mode, squared, is its strength.

    Parameters
    ----------
    touch : TouchField
        Points and weights of the touch face.
    design : Design
        The plate with its zone.
    symmetry : str or None
        Symmetry class of a halved model; None for a whole plate.

    Returns
    -------
    ndarray, shape (q,)
        Forces at the points, scaled by the modal mass.
    """
    shape = _shape_at(touch, design, symmetry)
    heavy = touch.weights * shape
    own = float(heavy @ shape)
    surface = design.stack.mass_kg_m2
    return np.asarray(heavy * np.sqrt(surface / (own * touch.modal_mass_kg))) if own > 0.0 else np.zeros(len(heavy))


def _shape_at(touch: TouchField, design: Design, symmetry: str | None) -> FloatArray:
    """Return the target shape at the points, (q,), 0 on the passive face and in a class that lacks it."""
    shape = np.zeros(len(touch.points))
    if symmetry in (None, target_symmetry(design.nodal_lines)):
        active = touch.is_active(design)
        shape[active] = target_shape(design, touch.points[active])
    return shape


def measure_profile(profile: Profile, design: Design) -> Confinement:
    """Measure the confinement of a motion that is known over y.

    Parameters
    ----------
    profile : Profile
        Places, weights, values (q, k) and target shape.
    design : Design
        The plate with its zone.

    Returns
    -------
    Confinement
        Of every motion, (k,) each; the MAC is 0 where the target shape is zero.
    """
    return _measured(profile, design, np.column_stack([np.zeros(len(profile.y_m)), profile.y_m]))


def _measured(profile: Profile, design: Design, points: FloatArray) -> Confinement:
    """Measure motions at points (q, 2) of the touch face."""
    weights, active = profile.weights, design.in_zone(points)
    parts = _parted(weights, points, design)
    shape, values = profile.shape[active], profile.values[active]
    own = weights[active] @ np.abs(shape) ** 2
    projection = np.abs((weights[active] * shape.conj()) @ values) ** 2 / np.maximum(own, 1e-300)
    surface = design.stack.mass_kg_m2
    areas = [float(part.sum()) for part in parts]
    return confined(_squares(parts, profile.values), areas, projection, surface / profile.modal_mass)


def confined(
    squares: Sequence[FloatArray], areas: Sequence[float], projection: FloatArray, per_mass: float
) -> Confinement:
    """Compute the confinement from integrals of |u_z|^2 over zone, passive face and the plate beyond the last row.

    Parameters
    ----------
    squares : three of ndarray, shape (k,)
        The integrals.
    areas : three of float
        The areas of these parts, in the unit of the integrals.
    projection : ndarray, shape (k,)
        Square of the zone's motion in the target shape.
    per_mass : float
        Mass per area divided by the modal mass.

    Returns
    -------
    Confinement
        Of every motion, (k,) each.
    """
    (inside, passive, beyond), (zone, aside, outer) = squares, areas
    level, further = _level_db(inside, zone, passive, aside), _level_db(inside, zone, beyond, outer)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(np.isnan(level), np.nan, inside / (inside + passive))
    return Confinement(share, level, projection / np.maximum(inside, 1e-300), further, per_mass * projection)


def zone_parts(design: Design, points: FloatArray) -> list[BoolArray]:
    """Find the points in each zone, and in none.

    Parameters
    ----------
    design : Design
        The plate with its zones.
    points : ndarray, shape (q, 2)
        Points in m from the centre of the plate.

    Returns
    -------
    list of ndarray of bool, shape (q,)
        One mask per zone, then the mask of the passive face.
    """
    inside = [each.in_zone(points) for each in design.views]
    return [*inside, ~np.logical_or.reduce(inside)]


def peak_hz(
    moved: Callable[[FloatArray], FloatArray], resonances_hz: FloatArray, band_hz: tuple[float, float], loss: float
) -> float:
    """Find the frequency of the largest motion in a band: at resonances and ends first, then on a finer grid.

    Parameters
    ----------
    moved : callable
        Motion (n,) at frequencies (n,) in Hz.
    resonances_hz : ndarray, shape (m,)
        Resonances of the plate.
    band_hz : tuple of float
        Ends of the band, in Hz.
    loss : float
        Relative width of a resonance, 1/Q.

    Returns
    -------
    float
        In Hz.
    """
    low, high = band_hz
    tones = np.concatenate([resonances_hz[(resonances_hz >= low) & (resonances_hz <= high)], [low, high]])
    for _ in range(2):
        top = float(tones[int(np.argmax(moved(tones)))])
        tones = np.clip(np.linspace(top * (1.0 - loss), top * (1.0 + loss), 4 * FINE + 1), low, high)
    return float(tones[int(np.argmax(moved(tones)))])


def drive_zones(
    design: Design, frequency_hz: FloatArray, profile: Profile, band_hz: tuple[float, float], quality_factor: float
) -> DrivenZones:
    """Drive each zone in turn by a pressure of the target shape, each at its own peak within a band.

    With M-orthonormal modes over the whole width of the plate: a_k = phi_k' f / (f_k^2 (1 + i/Q) - f^2).

    Parameters
    ----------
    design : Design
        The plate with its zones.
    frequency_hz : ndarray, shape (k,)
        Frequencies of the modes.
    profile : Profile
        The modes over y.
    band_hz : tuple of float
        Ends of the band, in Hz.
    quality_factor : float
        Of every mode, dimensionless.

    Returns
    -------
    DrivenZones
        Peaks in Hz, levels of every part in dB, and MAC of each zone.

    Raises
    ------
    SolverError
        If the plate has no mode there.
    """
    if not len(frequency_hz):
        raise SolverError("the plate has no mode around the frequency of its isolated zone")
    parts = [
        np.where(part, profile.weights, 0.0)
        for part in zone_parts(design, np.column_stack([0.0 * profile.y_m, profile.y_m]))
    ]
    adjoint = profile.values.conj().T
    grams = np.array([adjoint @ (part[:, None] * profile.values) / part.sum() for part in parts])
    forces = [adjoint @ (part * profile.shape) for part in parts[:-1]]

    def shares(zone: int, tones: FloatArray) -> FloatArray:
        return np.asarray(forces[zone][:, None] / (frequency_hz[:, None] ** 2 * (1.0 + 1j / quality_factor) - tones**2))

    def squares(zone: int, tones: FloatArray) -> FloatArray:
        moved = shares(zone, tones)
        return np.einsum("it,zit->zt", moved.conj(), grams @ moved).real

    peaks, levels, macs = [], [], []
    for zone, (part, force) in enumerate(zip(parts, forces, strict=False)):
        top = peak_hz(lambda tones, zone=zone: squares(zone, tones)[zone], frequency_hz, band_hz, 1.0 / quality_factor)  # type: ignore[misc]
        (at,) = squares(zone, np.array([top])).T
        own = part @ np.abs(profile.shape) ** 2 * part.sum() * at[zone]
        peaks.append(top)
        levels.append(ratio_db(np.sqrt(at), np.sqrt(at[zone])))
        macs.append(float(abs(force.conj() @ shares(zone, np.array([top]))[:, 0]) ** 2 / own))
    return DrivenZones(np.array(peaks), np.array(levels), np.array(macs))


def mixed_shares(frequency_hz: FloatArray, index: int, error: float, ends_hz: tuple[float, ...] = ()) -> FloatArray:
    """Bound how much of every other mode an error of the stiffness adds to a mode.

    Parameters
    ----------
    frequency_hz : ndarray, shape (k,)
        Frequencies of the modes.
    index : int
        The mode in question.
    error : float
        Relative error of the frequencies, dimensionless.
    ends_hz : tuple of float, optional
        Frequencies at which further modes may lie, one each.

    Returns
    -------
    ndarray, shape (k + ends,)
        Amplitudes relative to the mode, at most 1.
    """
    own, tones = frequency_hz[index], np.append(frequency_hz, ends_hz)
    apart = np.abs(tones**2 - own**2)
    apart[index] = np.inf
    return np.minimum(2.0 * error * own * tones / np.maximum(apart, 1e-300), 1.0)


def mixed_energy(
    share_of: Callable[[FloatArray], FloatArray], vectors: FloatArray, index: int, mixed: FloatArray
) -> tuple[float, float]:
    """Compute a mode's share of a part's energy, and what its neighbours change of it.

    Each neighbour is added with the worse sign; the changes are combined as the root of the sum of their squares.

    Parameters
    ----------
    share_of : callable
        Shares (k,) of M-orthonormal motions (dof, k).
    vectors : ndarray, shape (dof, k)
        The modes.
    index : int
        The mode whose share it is.
    mixed : ndarray, shape (k,)
        Amplitudes of each of the others.

    Returns
    -------
    share, change : float
        Both dimensionless.
    """
    own, others = vectors[:, [index]], np.delete(np.arange(vectors.shape[1]), index)
    added = [
        (own + sign * mixed[others] * vectors[:, others]) / np.sqrt(1.0 + mixed[others] ** 2) for sign in (1.0, -1.0)
    ]
    shares = share_of(np.hstack([own, *added]))
    moved = np.abs(shares[1:] - shares[0]).reshape(2, -1).max(axis=0, initial=0.0)
    return float(shares[0]), float(np.linalg.norm(moved))


def _level_db(inside: FloatArray, zone: float, outside: FloatArray, area: float) -> FloatArray:
    """20 log10 of rms on one part over that on another, (k,); NaN where a part is empty."""
    if min(zone, area) <= NEGLIGIBLE * max(zone, area):
        return np.full(len(inside), np.nan)
    return ratio_db(np.sqrt(np.maximum(inside, 0.0) / zone), np.sqrt(np.maximum(outside, 0.0) / area))
