"""Read off a forced response: motion at points, peaks, admittance, resonances, and the errors of modes and peaks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol
from weakref import WeakKeyDictionary

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from scipy.optimize import minimize_scalar

from geometry.elements import ComplexArray, FloatArray
from solvers.accuracy.reduction import MARGIN, by_degrees, by_mesh, by_modes, last_degree
from solvers.control.identification import half_power_quality_factor
from solvers.measures.confinement import ratio_db
from solvers.piezo.forced import SETTLING, Curve, ForcedPlate, GroupModes, whitened
from solvers.piezo.patched_plate import Group
from solvers.superelement.bond import Contact, displacement_at, mirror_signs
from solvers.superelement.plate import WHOLE

PER_WIDTH = 6  # points over a resonance's half-power width about a peak
SAME = 1e-3  # of the reach about a peak: points so near to it are the peak itself, but for the precision of its search
SHARP = 1e-3  # of a half-power width: tolerance of a peak
SAME_WIDTHS = 1.0  # half-power widths: closer peaks count as one

_KNOWN: WeakKeyDictionary[GroupModes, FrequencyErrors] = WeakKeyDictionary()  # every peak of a response needs them


class Driven(Protocol):
    """Interface of a driven structure that can be swept."""

    def loss_at(self, frequency_hz: float) -> float:
        """1/Q of the mode nearest to a frequency."""
        ...

    def curve(self, frequency_hz: FloatArray) -> Curve:
        """Response at frequencies in Hz."""
        ...


@dataclass(frozen=True)
class Peak:
    """The response at one frequency: rms |u_z| of zone and passive face (m/V, or m/N), and the curve's quality factor there.

    confinement_db: 20 log10 of their ratio. None where there is no passive face, or the curve has no half-power points.
    """

    frequency_hz: float
    zone_rms: float
    passive_rms: float | None
    quality_factor: float | None

    @property
    def confinement_db(self) -> float | None:
        """20 log10 of zone over passive rms."""
        return None if self.passive_rms is None else float(ratio_db(self.zone_rms, self.passive_rms))

    def is_at(self, frequency_hz: float, loss: float) -> bool:
        """Whether it lies within a half-power width of a frequency."""
        return abs(self.frequency_hz - frequency_hz) <= SAME_WIDTHS * loss * frequency_hz


@dataclass(frozen=True)
class CircuitShift:
    """The target mode with every patch short and with some open: Hz, and the share of it in that open mode.

    coupling = (f_open^2 - f_short^2)/f_open^2, the effective coupling factor squared (ieee176).
    """

    short_hz: float
    open_hz: float
    share: float

    @property
    def coupling(self) -> float:
        """Effective electromechanical coupling factor squared."""
        return 1.0 - (self.short_hz / self.open_hz) ** 2


@dataclass(frozen=True)
class FrequencyErrors:
    """Relative half-widths, (k,) each: by the plate's mesh, by its reduction, by the mesh and yielding of the bond.

    NaN where nothing shows one.
    """

    mesh: FloatArray
    reduction: FloatArray
    bonding: FloatArray

    @property
    def total(self) -> FloatArray:
        """Sum of all."""
        return self.mesh + self.reduction + self.bonding


def point_response(forced: ForcedPlate, point_m: tuple[float, float], frequency_hz: FloatArray) -> ComplexArray:
    """Compute u_z per volt of drive at a point of the touch face.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.
    point_m : tuple of float
        x and y.
    frequency_hz : ndarray, shape (n,)
        Frequencies of the drive.

    Returns
    -------
    ndarray, shape (n,)
        In m/V.
    """
    return point_responses(forced, np.array([point_m]), frequency_hz)[0]


def point_responses(forced: ForcedPlate, points_m: FloatArray, frequency_hz: FloatArray) -> ComplexArray:
    """Compute u_z per volt of drive at points of the touch face.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.
    points_m : ndarray, shape (p, 2)
        The points.
    frequency_hz : ndarray, shape (n,)
        Frequencies of the drive.

    Returns
    -------
    ndarray, shape (p, n)
        In m/V.
    """
    at = forced.plate.scale.eigenvalue(np.asarray(frequency_hz))
    volts = forced.volts_over(at)
    parts = [_rows(basis, points_m) @ basis.amplitudes(at, volts).T for basis in forced.modes]
    return np.asarray(np.sum(parts, axis=0))


def loudest_point(forced: ForcedPlate, frequency_hz: float) -> tuple[float, float]:
    """Find the point of the zone with the largest |u_z| of the operating shape.

    Of equal ones, the first with x and y not below those of the zone's centre.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.
    frequency_hz : float
        Frequency of the drive.

    Returns
    -------
    tuple of float
        x and y from the plate's centre, in m.
    """
    points, values = forced.shape(frequency_hz)
    size = np.where(forced.design.in_zone(points), np.abs(values), 0.0)
    equal = np.flatnonzero(size >= (1.0 - 1e-6) * size.max())
    from_centre = points[equal] - np.asarray(forced.design.centre_m)
    best = equal[np.lexsort((points[equal, 0], from_centre.min(axis=1) < 0.0))[0]]
    return float(points[best, 0]), float(points[best, 1])


def face_motion(group: Group, points_m: FloatArray, axis: int = 2, means: FloatArray | None = None) -> sp.csr_array:
    """Build the rows that give u along an axis at points of the touch face.

    Parameters
    ----------
    group : Group
        The coupled classes.
    points_m : ndarray, shape (q, 2)
        The points.
    axis : int, optional
        0, 1 or 2 (u_z).
    means : ndarray, shape (b, q), optional
        Weights of sums over the points, which the rows then give.

    Returns
    -------
    sparse array, shape (q, dof) or (b, dof)
        Rows.
    """
    contact = Contact(points_m, np.eye(len(points_m)) if means is None else means, back=False)
    parts = [displacement_at(plate, contact)[axis::3] for plate in group.plates]
    return sp.csr_array(sp.hstack(parts, format="csr"))


def highest_hz(driven: Driven, low: float, high: float, points: int, resonances_hz: FloatArray | None = None) -> float:
    """Find the frequency of the zone's largest response: on a grid and at the resonances, then finer, then between points.

    A resonance may be narrower than the grid: each one of the plate with its patches as they are wired has to be among
    `resonances_hz`, within the band.

    Parameters
    ----------
    driven : Driven
        The driven plate.
    low, high : float
        Ends of the band, in Hz.
    points : int
        Number of points of the grid.
    resonances_hz : ndarray, shape (m,), optional
        Resonances.

    Returns
    -------
    float
        In Hz.
    """
    even = np.union1d(np.linspace(low, high, points), [] if resonances_hz is None else resonances_hz)
    top = float(even[int(np.argmax(driven.curve(even).zone_rms_m_per_v))])
    for reach in (2.0 * (high - low) / points, 2.0 * top * driven.loss_at(top)):
        top = _top_of(driven, max(low, top - reach), min(high, top + reach), top)
    return _between(driven, top, low, high)


def near_hz(driven: Driven, mode_hz: float) -> float:
    """Find the peak of a mode, where the response is largest within a half-power width.

    A stronger neighbour's flank, which rises to one end of that interval, does not count as a peak.

    Parameters
    ----------
    driven : Driven
        The driven plate.
    mode_hz : float
        Frequency of the mode.

    Returns
    -------
    float
        In Hz; the mode's own frequency if it has no peak.
    """
    reach = mode_hz * driven.loss_at(mode_hz)
    top = _top_of(driven, mode_hz - reach, mode_hz + reach, mode_hz)
    inside = abs(top - mode_hz) < reach * (1.0 - 1.0 / (2.0 * PER_WIDTH))
    return _between(driven, top, mode_hz - reach, mode_hz + reach) if inside else mode_hz


def own_or(driven: Driven, mode_hz: float, highest_hz: float) -> float:
    """Find the peak of a mode, as `near_hz`, or return the highest one's frequency if both are one peak.

    Parameters
    ----------
    driven : Driven
        The driven plate.
    mode_hz, highest_hz : float
        Frequencies of the mode and of the highest peak.

    Returns
    -------
    float
        In Hz.
    """
    own = near_hz(driven, mode_hz)
    apart = 2.0 * SHARP * highest_hz * driven.loss_at(highest_hz)
    return highest_hz if abs(own - highest_hz) <= apart else own


def curve_about(driven: Driven, low: float, high: float, points: int, peaks_hz: list[float]) -> Curve:
    """Compute the response on an even grid that is finer around each peak, by its damping.

    Parameters
    ----------
    driven : Driven
        The driven plate.
    low, high : float
        Ends of the band, in Hz.
    points : int
        Number of points of the even grid.
    peaks_hz : list of float
        The peaks.

    Returns
    -------
    Curve
        Response over frequency.
    """
    tones = np.linspace(low, high, points)
    for peak in peaks_hz:
        reach = 2.0 * peak * driven.loss_at(peak)
        fine = np.linspace(max(low, peak - reach), min(high, peak + reach), 4 * PER_WIDTH + 1)
        tones = np.union1d(tones, fine)
        tones = np.union1d(tones[np.abs(tones - peak) > SAME * reach], [peak])  # two points as high would hide it
    return driven.curve(tones)


def peak_of(curve: Curve, frequency_hz: float) -> Peak:
    """Read a peak off a curve that contains its frequency.

    Parameters
    ----------
    curve : Curve
        Response over frequency.
    frequency_hz : float
        Frequency of the peak.

    Returns
    -------
    Peak
        Frequency, rms values in m/V and quality factor.
    """
    at = int(np.argmin(np.abs(curve.frequency_hz - frequency_hz)))
    passive = curve.passive_rms_m_per_v
    return Peak(
        float(curve.frequency_hz[at]),
        float(curve.zone_rms_m_per_v[at]),
        None if passive is None else float(passive[at]),
        half_power_quality_factor(curve.frequency_hz, curve.zone_rms_m_per_v, at) if _is_top(curve, at) else None,
    )


def open_modes(forced: ForcedPlate, opened: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Compute the modes with some patches open and the others short; only those within the band are meaningful.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.
    opened : sequence of int
        Numbers of the open patches.

    Returns
    -------
    frequency_hz : ndarray, shape (modes,)
        Ascending.
    coordinates : ndarray, shape (modes, columns)
        Of each mode on the groups' modes and residuals, group after group: M times its vector.
    """
    stiffness, mass, loads = _projected(forced)
    plate = forced.plate
    charge = loads[:, list(opened)]
    capacitance = plate.capacitance_f[list(opened)] / plate.stiffness_unit
    stiffness = stiffness + (charge / capacitance) @ charge.T
    eigenvalue, vectors = ritz_modes(stiffness, mass)
    return plate.scale.frequency(_with_own_moduli(forced, eigenvalue, vectors)), np.asarray((mass @ vectors).T)


def _with_own_moduli(forced: ForcedPlate, eigenvalue: FloatArray, vectors: FloatArray) -> FloatArray:
    """Eigenvalues (k,) of vectors (columns of all groups, k) with the moduli at their own frequencies."""
    parted = [basis.parted for basis in forced.modes if basis.parted is not None]
    if not parted:
        return eigenvalue
    ends = np.cumsum([basis.columns.shape[1] for basis in forced.modes])[:-1]
    pairs = list(zip(parted, np.split(vectors, ends), strict=True))
    parts = np.sum([np.einsum("ik,mij,jk->mk", own, each.parts, own, optimize=True) for each, own in pairs], axis=0)
    values = eigenvalue.copy()
    for _ in range(SETTLING):
        steps = np.array([parted[0].steps(value).real for value in values.tolist()])
        values = eigenvalue + np.einsum("km,mk->k", steps, parts)
    return np.asarray(values)


def ritz_modes(stiffness: FloatArray, mass: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solve K and M in directions of which some depend on others.

    Parameters
    ----------
    stiffness, mass : ndarray, shape (n, n)
        K and M.

    Returns
    -------
    values : ndarray, shape (m,)
        Eigenvalues, ascending.
    vectors : ndarray, shape (n, m)
        M-orthonormal.
    """
    whiten = whitened(mass)
    eigenvalue, vectors = scipy.linalg.eigh(whiten.T @ stiffness @ whiten)
    return np.asarray(eigenvalue), np.asarray(whiten @ vectors)


def circuit_shift(forced: ForcedPlate, opened: Sequence[int] | None = None) -> CircuitShift | None:
    """Compute the shift of the target mode by opening patches.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.
    opened : sequence of int, optional
        Numbers of the patches; all by default.

    Returns
    -------
    CircuitShift or None
        Both frequencies in Hz; None if the band contains no target mode.
    """
    place = forced.target_column()
    short = forced.target_hz()
    if place is None or short is None:
        return None
    frequency, shares = open_modes(forced, range(len(forced.plate.patches)) if opened is None else opened)
    best = int(np.argmax(np.abs(shares[:, place])))
    return CircuitShift(short, float(frequency[best]), float(shares[best, place] ** 2))


def open_patches(forced: ForcedPlate) -> list[int]:
    """List the patches without a prescribed voltage: sensors and charge-driven actuators.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its circuits.

    Returns
    -------
    list of int
        Numbers of the patches.
    """
    return forced.sensors if forced.circuit == "short" else [*forced.drivers, *forced.sensors]


def driven_hz(forced: ForcedPlate) -> float | None:
    """Return the target mode's frequency with the patches as wired: sensors open, drivers fed.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its circuits.

    Returns
    -------
    float or None
        In Hz; None without a target mode.
    """
    shift = circuit_shift(forced, opened) if (opened := open_patches(forced)) else None
    return shift.open_hz if shift else forced.target_hz()


def resonances_hz(forced: ForcedPlate) -> FloatArray:
    """List the frequencies within the band at which the plate resonates with its patches as wired.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its circuits.

    Returns
    -------
    ndarray, shape (n,)
        In Hz, ascending.
    """
    low, high = forced.band_hz
    frequency = open_modes(forced, opened)[0] if (opened := open_patches(forced)) else np.sort(forced.resonances_hz)
    return frequency[(frequency > low) & (frequency < high)]


def admittance(forced: ForcedPlate, frequency_hz: FloatArray) -> ComplexArray:
    """Compute the current per volt into the driven patches in parallel, each with its polarisation; sensors stay open.

    The charge of a patch is theta' u + C V with its bonded face's motion u: Y = j omega s' q over the driven ones. Dielectric
    losses are left out.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its circuits.
    frequency_hz : ndarray, shape (n,)
        Frequencies of the drive.

    Returns
    -------
    ndarray, shape (n,)
        In S (siemens).
    """
    signs, driven, left = forced.signs[forced.drivers], forced.drivers, forced.sensors
    at = forced.plate.scale.eigenvalue(np.asarray(frequency_hz))
    parts = [basis.receptance(at) for basis in forced.modes]
    per_volt = np.sum(parts, axis=0) * forced.plate.stiffness_unit + np.diag(forced.plate.capacitance_f)
    to_driven = per_volt[:, driven]
    charge = to_driven[..., driven] @ signs
    if left:
        of_left = per_volt[:, left]
        volts = np.linalg.solve(of_left[..., left], -of_left[..., driven] @ signs[:, None])
        charge = charge + (to_driven[..., left] @ volts)[..., 0]
    return np.asarray(2j * np.pi * frequency_hz * (charge @ signs))


def frequency_errors(basis: GroupModes) -> FrequencyErrors:
    """Estimate the frequency errors of a group's modes.

    The plate's mesh and its truncation are estimated as for a plate without patches, with the patches' stiffness in K.
    The coarser mesh of the bond shows the error of the finer one. F is known at rest. At the mode's eigenvalue l it is
    larger by l / (L - l) at most, L the lowest eigenvalue of the panels' discarded modes. The patches' forces f lower l
    by f'F f.

    Parameters
    ----------
    basis : GroupModes
        Modes of some classes, solved together.

    Returns
    -------
    FrequencyErrors
        Relative half-widths (k,) each.
    """
    if basis not in _KNOWN:
        _KNOWN[basis] = _estimated(basis)
    return _KNOWN[basis]


def frequency_error(forced: ForcedPlate, frequency_hz: float) -> float | None:
    """Return the error bar of the peak nearest to a frequency, that of its mode: mesh, reduction and bonding together.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.
    frequency_hz : float
        The frequency.

    Returns
    -------
    float or None
        Relative half-width; None without an estimate.
    """
    basis, index = _nearest(forced, frequency_hz)
    return None if basis is None else _known(float(frequency_errors(basis).total[index]))


def height_error(forced: ForcedPlate, frequency_hz: float) -> float | None:
    """Estimate the error bar of the height of the peak nearest to a frequency.

    A resonance's height goes as phi'f / lambda: the errors of the loads f and of the mode's frequency add up. Damping is
    given and not judged. The part of the panels' discarded modes is known at rest: at the mode's eigenvalue l it may be
    larger by l / (L - l), with L the lowest discarded eigenvalue.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.
    frequency_hz : float
        The frequency.

    Returns
    -------
    float or None
        Relative half-width; None without an estimate or a mode nearby.
    """
    basis, index = _nearest(forced, frequency_hz)
    if basis is None or basis.bond is None:
        return None
    group, phi, value = basis.group, basis.columns[:, index], float(basis.eigenvalue[index])
    if group.by_modes is None:
        return None
    volts = forced.volts(forced.plate.scale.eigenvalue(frequency_hz))
    lost = basis.bond.gain[index] @ np.abs(volts) + _growth(group, value) * abs(phi @ group.by_modes @ volts)
    given = abs(basis.gain[index] @ volts)
    return _known(float(lost / given) + 2.0 * float(frequency_errors(basis).total[index])) if given else None


def load_errors(basis: GroupModes) -> FloatArray:
    """Estimate the errors of the loads' gains due to the mesh of the bond and to the panels' discarded modes.

    Parameters
    ----------
    basis : GroupModes
        Modes of a group.

    Returns
    -------
    ndarray, shape (modes, patches)
        Scaled as the gains; NaN where unknown.
    """
    if basis.bond is None or basis.group.by_modes is None:
        return np.full_like(basis.gain, np.nan)
    growth = np.asarray(_growth(basis.group, basis.eigenvalue))
    left = basis.columns[:, : len(basis.eigenvalue)].T @ basis.group.by_modes
    return np.asarray(basis.bond.gain + growth[:, None] * np.abs(left))


def _rows(basis: GroupModes, points_m: FloatArray) -> FloatArray:
    """u_z at the points per unit of each column, (points, columns): the symmetry classes of the group added up."""
    total = np.zeros((len(points_m), basis.columns.shape[1]))
    for symmetry, field in zip(basis.group.symmetries, basis.group.touch(basis.columns), strict=True):
        folded = np.abs(points_m) if symmetry != WHOLE else points_m
        nearest = [int(np.argmin(((field.points - point) ** 2).sum(axis=1))) for point in folded]
        total += mirror_signs(symmetry, points_m)[:, 2:] * field.values[nearest]
    return total


def _top_of(driven: Driven, low: float, high: float, known_hz: float) -> float:
    fine = np.append(np.linspace(low, high, 4 * PER_WIDTH + 1), known_hz)
    return float(fine[int(np.argmax(driven.curve(fine).zone_rms_m_per_v))])


def _between(driven: Driven, top: float, low: float, high: float) -> float:
    """The largest response about a point of a fine grid."""
    width = top * driven.loss_at(top)
    step = width / PER_WIDTH
    ends = (max(low, top - step), min(high, top + step))
    minimum = minimize_scalar(
        lambda hz: -float(driven.curve(np.array([hz])).zone_rms_m_per_v[0]),
        bounds=ends,
        method="bounded",
        options={"xatol": SHARP * width},
    )
    return float(minimum.x) if low < top < high else top


def _is_top(curve: Curve, at: int) -> bool:
    """Whether the curve falls to both sides: a flank has no half-power width."""
    around = curve.zone_rms_m_per_v[max(at - 1, 0) : at + 2]
    return 0 < at < len(curve.frequency_hz) - 1 and bool(around.max() == curve.zone_rms_m_per_v[at])


def _projected(forced: ForcedPlate) -> tuple[FloatArray, FloatArray, FloatArray]:
    """K, M (c, c) and the loads (c, patches) in the columns of all groups, scaled; the modes' own loads are extrapolated."""
    stiffness, mass = zip(*(basis.projected for basis in forced.modes), strict=True)
    loads = np.vstack([basis.loads for basis in forced.modes])
    return scipy.linalg.block_diag(*stiffness), scipy.linalg.block_diag(*mass), loads


def _estimated(basis: GroupModes) -> FrequencyErrors:
    group, value, count = basis.group, basis.eigenvalue, len(basis.eigenvalue)
    vectors = basis.columns[:, :count]
    pairs = list(zip(group.plates, group.split(vectors), strict=True))
    mesh, modes = np.zeros(count), np.zeros(count)
    for plate, part in pairs:
        mesh += by_mesh(plate, value, part)[1]
        modes += by_modes(plate, value, part)
    last = np.concatenate([last_degree(plate) for plate in group.plates])
    held = any(plate.holds for plate in group.plates)
    reduction = MARGIN * (modes + by_degrees(group.pencil, vectors, last, basis.images, held))
    if basis.parted is not None:
        reduction = reduction + basis.parted.missed(basis.frequency_hz)
    return FrequencyErrors(mesh, reduction, _bonding(basis, vectors))


def _bonding(basis: GroupModes, vectors: FloatArray) -> FloatArray:
    group, value = basis.group, basis.eigenvalue
    if group.yielding is None:
        return np.zeros(len(value))
    if basis.bond is None:
        return np.full(len(value), np.nan)
    unknown = _growth(group, value)
    if basis.parted is not None:  # the plate beneath the patches yields with the moduli of the reduction
        unknown = unknown + [np.abs(basis.parted.steps(each)).max() for each in value.tolist()]
    return np.asarray(basis.bond.frequency + unknown * group.yielding(vectors) / (2.0 * value))


def _growth(group: Group, value: float | FloatArray) -> Any:
    """Largest ratio of the discarded modes' answers at eigenvalues to those at rest, less 1."""
    return np.max([cell.residual.growth(value) for plate in group.plates for cell in plate.cells], axis=0) - 1.0


def _known(error: float) -> float | None:
    return error if np.isfinite(error) else None


def _nearest(forced: ForcedPlate, frequency_hz: float) -> tuple[GroupModes | None, int]:
    """The mode nearest to a frequency: its group and its number there."""
    resonant = [
        (abs(hz - frequency_hz), basis, index) for basis in forced.modes for index, hz in enumerate(basis.frequency_hz)
    ]
    if not resonant:
        return None, 0
    _, basis, index = min(resonant, key=lambda each: each[0])
    return basis, index
