"""Effects of a finger: the target mode under it, the finger at every place of the face, and friction.

With the contact's moments u_f = g q + R f and f = -D u_f, the modes' coordinates q obey N(lambda) q = 0,
N = Lambda (1 + i/Q) - lambda + g' T g, T = (1 + D R)^-1 D, all at the complex lambda = omega^2. Loss is uniform,
K (1 + i/Q): a real mass keeps 1/Q exactly, a spring dilutes it, a damper adds to it. Beyond the band R = sum g g' /
(l (1 + i/Q) - lambda) over the Ritz modes of the residual vectors, which match four terms about the band's middle and have no
root that the plate lacks. N linearised about lambda gives the mode that holds most of the free one; inverse iteration on N
(ruhe1973) settles it.

One lattice of points carries the contacts of all places, as dense as finger and wave need; a point and its mirror images share
the residual vectors of their symmetry class. Each place is then a solve of the points of its contact, whose loads are scaled by
the roots of their weights.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product
from math import acos, cos, gamma, pi, sin, sqrt

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from geometry.elements import ComplexArray, FloatArray, IntArray
from geometry.layout import Design
from solvers.errors import SolverError
from solvers.piezo.forced import GroupModes
from solvers.piezo.patched_plate import Group
from solvers.piezo.responses import face_motion, ritz_modes
from solvers.superelement.bond import mirror_signs
from solvers.superelement.plate import WHOLE
from solvers.touch import touched_plate
from solvers.touch.touched_plate import BLOCK, TouchedPlate, with_points

PASSES, STEPS = 30, 12  # steps: of the linearised problem, of inverse iteration
SLIGHT = 1e-6  # relative step of a derivative
NEAR, SETTLED = 1e-4, 1e-12  # relative change of an eigenvalue between them

COPIES = 6  # of a group's loads that are held where losses differ: loads, residual vectors, slopes, and these stacked
# complex matrices of a group's loads that are held at once: with one loss for all modes, and else
SQUARES, ALL_SQUARES = 3, 48

SPAN = (2, 6)  # of a map's lattice over a radius, at least and at most
RULE_ENOUGH = 1e-2  # of a map's mean over a contact
EDGE = 0.1  # of a lattice's spacing: from its outermost points to the disk's rim
LEAST = 0.1  # of an even share: the smallest weight of a rule

PRESSURE_PA = 101325.0
VISCOSITY_PA_S = 1.81e-5  # of air at 20 C
FREE_PATH_M = 68e-9  # of its molecules at 1 atm
MIN_SQUEEZE_NUMBER = 10.0  # below it, air escapes at the rim within a period
MAX_KNUDSEN = 0.1  # above it the film is not a continuum
MAX_WAVE_SHARE = 0.5  # of a wavelength: widest contact that does not span crests and troughs


@dataclass(frozen=True)
class LoadedMode:
    """The mode under the finger that holds most of the free plate's target mode, all patches short.

    lambda = (2 pi frequency)^2 (1 + i loss), loss = 1/Q, is the complex eigenvalue omega^2 of the plate with the finger on it;
    the free vibration exp(i omega t) has the frequency Re(omega)/2 pi, higher by about 1/(8 Q^2). share: of the free target
    mode in it, of 1. Below one half the mode is mixed with its neighbours. eigenvalue, vector: scaled, for a further solve.
    """

    free_hz: float
    frequency_hz: float
    free_loss: float
    loss: float
    share: float
    eigenvalue: complex = 0j
    vector: ComplexArray | None = None

    @property
    def shift_hz(self) -> float:
        """Detuning by the finger."""
        return self.frequency_hz - self.free_hz

    @property
    def quality_factor(self) -> float | None:
        """Quality factor under the finger; None where nothing is lost."""
        return 1.0 / self.loss if self.loss > 0.0 else None

    @property
    def added_loss(self) -> float:
        """Increase of 1/Q by the finger."""
        return self.loss - self.free_loss


class _Problem:
    """N(lambda) of a touched plate, (modes, modes), and its derivative."""

    def __init__(self, touched: TouchedPlate, slopes: bool) -> None:
        self.touched = touched
        self.unit, count = touched.plate.stiffness_unit, len(touched.plate.patches)
        counts = [len(basis.eigenvalue) for basis in touched.modes]
        damping = [basis.damping[:count, :count] for basis, count in zip(touched.modes, counts, strict=True)]
        own = [np.diag(basis.eigenvalue) + 1j * lost for basis, lost in zip(touched.modes, damping, strict=True)]
        self.own: ComplexArray = scipy.linalg.block_diag(*own)
        self.parted = next((basis.parted for basis in touched.modes if basis.parted is not None), None)
        known = [basis.parted.parts for basis in touched.modes if basis.parted is not None]
        blocks = [[part[:count, :count] for part in parts] for parts, count in zip(known, counts, strict=False)]
        self.parts: FloatArray = np.array([scipy.linalg.block_diag(*each) for each in zip(*blocks, strict=True)])
        self.gain: FloatArray = np.vstack([basis.gain[:, count:] for basis in touched.modes])
        if slopes not in touched.beyond:
            touched.beyond[slopes] = [_beyond(basis, count, slopes) for basis in touched.modes]
        beyond = touched.beyond[slopes]
        self.beyond = (1.0 + 1j * touched.loss) * np.concatenate([values for values, _ in beyond])
        self.beyond_gain = np.vstack([gain for _, gain in beyond])

    def at(self, value: complex) -> tuple[ComplexArray, ComplexArray]:
        """N and dN/dlambda."""
        stiffness, stiffening = self._finger(value)
        residual, slope = self._residual(value)
        # T = (1 + D R)^-1 D has the derivative (1 + D R)^-1 (D' - D^2 R') (1 + D R)^-1
        turn = np.linalg.inv(np.eye(len(residual)) + stiffness * residual)
        change = turn @ (stiffening * np.eye(len(residual)) - stiffness**2 * slope) @ turn
        matrix, derivative = (self.unit * self.gain @ each @ self.gain.T for each in (stiffness * turn, change))
        one, (stiffer, slope_of_moduli) = np.eye(len(self.own)), self._moduli(value)
        return matrix + self.own - value * one + stiffer, derivative - one + slope_of_moduli

    def _moduli(self, value: complex) -> tuple[ComplexArray, ComplexArray]:
        """What moduli at the frequency of an eigenvalue change of the modes' K + i H, and its derivative, (modes, modes)."""
        if self.parted is None:
            return np.zeros_like(self.own), np.zeros_like(self.own)
        here, ahead = (self.parted.steps(factor * value.real) for factor in (1.0, 1.0 + SLIGHT))
        slope = (ahead - here) / (SLIGHT * value.real)
        stiffer, derivative = (np.tensordot(each, self.parts, 1) for each in (here, slope))
        return np.asarray(stiffer), np.asarray(derivative)

    def _finger(self, value: complex) -> tuple[complex, complex]:
        """D and dD/dlambda."""
        finger, per_hz = self.touched.finger, self.touched.plate.scale.eigenvalue(1.0)
        omega = 2.0 * np.pi * np.sqrt(complex(value) / per_hz)
        resistance, mass = finger.tip.resistance_n_s_m(finger.area_m2), finger.tip.mass_kg
        slope = (1j * resistance - 2.0 * omega * mass) * omega / (2.0 * value)
        return finger.dynamic_stiffness(omega / (2.0 * np.pi)), slope

    def _residual(self, value: complex) -> tuple[ComplexArray, ComplexArray]:
        """Part of the modes beyond the band in the receptance, damped as the others, and its derivative."""
        stiffer = 1.0 if self.parted is None else 1.0 + complex(self.parted.steps(value.real)[-1])
        inverse, gain = 1.0 / (stiffer * self.beyond - value), self.beyond_gain
        residual, slope = (self.unit * gain.T @ (each[:, None] * gain) for each in (inverse, inverse**2))
        missing = self.touched.missing
        return residual if missing is None else residual + missing, slope

    def shares(self, values: ComplexArray, vectors: ComplexArray, row: int) -> FloatArray:
        """Share of a free mode in motions (modes, k) at eigenvalues (k,), of 1, including their motion beyond the band."""
        out = np.empty(len(values))
        for place, (value, vector) in enumerate(zip(values, vectors.T, strict=True)):
            stiffness, _ = self._finger(value)
            residual, _ = self._residual(value)
            push = np.linalg.solve(np.eye(len(residual)) + stiffness * residual, stiffness * (self.gain.T @ vector))
            beyond = self.unit * (self.beyond_gain @ push) / (self.beyond - value)
            whole = np.linalg.norm(vector) ** 2 + np.linalg.norm(beyond) ** 2
            out[place] = np.abs(vector[row]) ** 2 / whole
        return out

    def settled(self, value: complex, vector: ComplexArray) -> tuple[complex, ComplexArray]:
        """Eigenvalue and vector by inverse iteration; NaN where it does not settle."""
        for _ in range(STEPS):
            matrix, slope = self.at(value)
            try:
                further = np.linalg.solve(matrix, slope @ vector)
            except np.linalg.LinAlgError:
                return value, vector
            step = (vector @ vector) / (vector @ further)
            value, vector = complex(value - step), np.asarray(further / np.linalg.norm(further))
            if abs(step) <= SETTLED * abs(value):
                return value, vector
        return complex(np.nan), vector


@dataclass(frozen=True)
class TouchMap:
    """Results on a grid of places x_m (nx,), y_m (ny,): rms of u_z over the contact, m per volt, free and touched, (nx, ny).

    field: the free plate's u_z at the places, complex; sensor_v: sensor voltages per volt of drive, (nx, ny, sensors).
    under: the touched plate's mean u_z over the contact, slope_change: change of its slope along x by the finger, complex.
    """

    frequency_hz: float
    x_m: FloatArray
    y_m: FloatArray
    field: ComplexArray
    free_m: FloatArray
    touched_m: FloatArray
    sensor_v: ComplexArray
    under: ComplexArray
    slope_change: ComplexArray


@dataclass(frozen=True)
class Lattice:
    """Points i spacing along x and y from the plate's centre, whose contacts lie on the plate: steps (nx,), (ny,).

    steps (p, 2), weights (p,): the points of a contact about its own, and their shares of its mean.
    """

    spacing_m: float
    along: IntArray
    across: IntArray
    steps: IntArray
    weights: FloatArray

    @property
    def reach(self) -> int:
        """Steps from a contact's middle to its outermost point: this number of lines at each end carries no middle."""
        return int(self.steps.max())

    @property
    def places(self) -> tuple[IntArray, IntArray]:
        """The lines of points that carry middles, along x and y."""
        inner = slice(self.reach, -self.reach)
        return self.along[inner], self.across[inner]

    @property
    def points_m(self) -> FloatArray:
        """All points of the lattice, (nx ny, 2), y fastest."""
        grid = np.meshgrid(self.spacing_m * self.along, self.spacing_m * self.across, indexing="ij")
        return np.stack(grid, axis=-1).reshape(-1, 2)

    @property
    def slope_weights(self) -> FloatArray:
        """Weights (p,) that give the mean slope along x from motions of a contact's points, 1/m."""
        arms = self.spacing_m * self.steps[:, 0]
        return np.asarray(self.weights * arms / (self.weights @ arms**2))

    def contact(self, i: int, j: int) -> IntArray:
        """Numbers of the points of the contact about point (i, j), counted from 0."""
        return np.asarray((i + self.steps[:, 0]) * len(self.across) + j + self.steps[:, 1])


@dataclass(frozen=True, eq=False)
class Places:
    """A touched plate seen from its patches and the points of a lattice at one frequency.

    The loads are p patches, then q points.
    """

    touched: TouchedPlate
    points: Lattice
    frequency_hz: float
    groups: list[FoldedLoads]

    @classmethod
    def of(cls, touched: TouchedPlate, points: Lattice, frequency_hz: float) -> Places:
        """Places from a plate's own modes and the residual vectors of all points."""
        return cls(touched, points, frequency_hz, folded_loads(touched, points.points_m, frequency_hz))

    def receptance(self, rows: IntArray, columns: IntArray) -> ComplexArray:
        """Charges of patches and motions of points (..., r) per volt or newton of loads (..., c), by number, in SI."""
        return np.sum([group.among(rows, columns) for group in self.groups], axis=0)

    def gains(self, loads: IntArray) -> FloatArray:
        """Gains (..., n, l) of loads (..., l) on the modes of all groups."""
        return np.concatenate([group.gains(loads) for group in self.groups], axis=-2)

    @property
    def shape(self) -> tuple[int, int]:
        """Places along x and y."""
        along, across = self.points.places
        return len(along), len(across)

    @property
    def rule_error(self) -> float:
        """Share of the mean of a product of two motions over a contact that the lattice's points may miss."""
        finger = self.touched.finger
        reach = finger.radius_m * finger.wavenumber_per_m(self.touched.design, self.frequency_hz)
        return touched_plate.left_beyond(2.0 * reach, 2 * self.points.reach - 1)

    def loads(self, numbers: IntArray) -> tuple[IntArray, FloatArray]:
        """Numbers (t, l) among patches and points of the loads at places, x first, and the roots of the weights (l,)."""
        count, reach = len(self.touched.plate.patches), self.points.reach
        contacts = [
            self.points.contact(i + reach, j + reach) for i, j in zip(*np.divmod(numbers, self.shape[1]), strict=True)
        ]
        patches = np.broadcast_to(np.arange(count), (len(numbers), count))
        return np.hstack([patches, count + np.array(contacts)]), np.append(np.ones(count), np.sqrt(self.points.weights))

    def map(self) -> TouchMap:
        """Map over every place; a finger without impedance leaves the free plate's motion."""
        touched, points = self.touched, self.points
        count, stiffness = len(touched.plate.patches), touched.finger.dynamic_stiffness(self.frequency_hz)
        patches, every = np.arange(count), count + np.arange(len(points.points_m))
        free = touched.patch_volts(lambda: self.receptance(patches, patches))
        field, root, reach = self.receptance(every, patches) @ free, np.sqrt(points.weights), points.reach
        x_m, y_m = (points.spacing_m * each for each in points.places)
        nx, ny = self.shape
        moved, before = np.zeros((nx, ny)), np.zeros((nx, ny))
        heard = np.zeros((nx, ny, len(touched.sensors)), dtype=complex)
        under, change = np.zeros((nx, ny), dtype=complex), np.zeros((nx, ny), dtype=complex)
        for number, (i, j) in enumerate(np.ndindex(nx, ny)):
            (loads,), scaled = self.loads(np.array([number]))
            own = field[loads[count:] - count]
            block = scaled[:, None] * self.receptance(loads, loads) * scaled
            answer = touched.loads_of(block, stiffness)
            motion = block[count:] @ answer
            before[i, j], moved[i, j] = np.linalg.norm(root * own), np.linalg.norm(motion)
            under[i, j], change[i, j] = root @ motion, points.slope_weights @ (motion / root - own)
            heard[i, j] = answer[touched.sensors]
        inner = field.reshape(nx + 2 * reach, ny + 2 * reach)[reach:-reach, reach:-reach]
        return TouchMap(self.frequency_hz, np.asarray(x_m), np.asarray(y_m), inner, before, moved, heard, under, change)


class OutOfValidity(SolverError):
    """Raised outside the range of the relation; the message gives the limit and the value that breaks it."""


@dataclass(frozen=True)
class SqueezeFilm:
    """Air between a plate and a finger: mean gap in m, the contact's radius in m, the finger's normal force in N."""

    gap_m: float
    radius_m: float
    force_n: float

    def squeeze_number(self, frequency_hz: float) -> float:
        """12 eta omega R^2/(p0 gap^2)."""
        return 24.0 * pi * frequency_hz * VISCOSITY_PA_S * (self.radius_m / self.gap_m) ** 2 / PRESSURE_PA

    def lift_n(self, amplitude_m: float) -> float:
        """Mean force of the film, N, for a peak amplitude below the gap."""
        share = (amplitude_m / self.gap_m) ** 2
        return PRESSURE_PA * pi * self.radius_m**2 * (sqrt((1.0 + 1.5 * share) / (1.0 - share)) - 1.0)

    def friction_ratio(self, amplitude_m: float, frequency_hz: float) -> float:
        """mu over mu of the plate at rest, from 0 to 1, for a peak amplitude; OutOfValidity outside the relation's range."""
        gap = f"a gap of {1e6 * self.gap_m:.3g} um"
        if MAX_KNUDSEN * self.gap_m < FREE_PATH_M:
            raise OutOfValidity(
                f"{gap} is not a continuum of air: it must be above {1e6 * FREE_PATH_M / MAX_KNUDSEN:.2g} um"
            )
        number = self.squeeze_number(frequency_hz)
        if number < MIN_SQUEEZE_NUMBER:
            raise OutOfValidity(
                f"air escapes from {gap}: squeeze number {number:.2g}, must be {MIN_SQUEEZE_NUMBER:g} or more"
            )
        if amplitude_m >= self.gap_m:
            raise OutOfValidity(f"an amplitude of {1e6 * amplitude_m:.3g} um is not below {gap}")
        lift = self.lift_n(amplitude_m)
        if lift > self.force_n:
            raise OutOfValidity(
                f"at an amplitude of {1e6 * amplitude_m:.3g} um {gap} would carry {lift:.3g} N, more than the finger's "
                f"{self.force_n:g} N: the finger floats, and the gap differs from the given one"
            )
        return 1.0 - lift / self.force_n


@dataclass(frozen=True)
class CrestMotion:
    """Motion of the face along x under contacts, (nx, ny): at the crest, signed, and at most within a period, m/s."""

    crest_m_s: FloatArray
    most_m_s: FloatArray

    def lag(self, i: int, j: int) -> float:
        """Angle between a crest and the moment of the largest speed, 0 (a wave that travels) to pi/2 (one that stands)."""
        most = float(self.most_m_s[i, j])
        return acos(min(1.0, abs(float(self.crest_m_s[i, j])) / most)) if most > 0.0 else pi / 2.0


def loaded_mode(touched: TouchedPlate, start: LoadedMode | None = None, slopes: bool = True) -> LoadedMode | None:
    """Compute the target mode under the finger.

    Parameters
    ----------
    touched : TouchedPlate
        The plate with the finger.
    start : LoadedMode, optional
        That of a similar plate, as the start of the iteration; by default the mode that holds most of the free one.
    slopes : bool, optional
        With the slopes of the residual vectors. Without them R matches two terms; the change bounds the error of four.

    Returns
    -------
    LoadedMode or None
        None when the band holds no target mode, or the finger leaves none among the modes about it.
    """
    free_hz, row = touched.free.target_hz(), touched.target_row
    if free_hz is None or row is None:
        return None
    if touched.finger.tip.is_nothing:
        return LoadedMode(free_hz, free_hz, touched.loss, touched.loss, 1.0)
    problem, (low, high) = _Problem(touched, slopes), _known_range(touched)
    known = start.vector if start else None
    found = (start.eigenvalue, known) if start and known is not None else _likeliest(problem, row, low, high)
    if found is None:
        return None
    value, vector = problem.settled(*found)
    if not (low <= value.real <= high and value.imag > 0.0):
        return None
    frequency = float(touched.plate.scale.frequency(np.array(value.real)))
    share = float(problem.shares(np.array([value]), vector[:, None], row)[0])
    return LoadedMode(free_hz, frequency, touched.loss, value.imag / value.real, share, value, vector)


def _known_range(touched: TouchedPlate) -> tuple[float, float]:
    """Scaled eigenvalues between which all modes are summed: the band's ends, each times its margin."""
    scale = touched.plate.scale
    low, high = (scale.eigenvalue(share * end) for share, end in zip(touched.margin, touched.band_hz, strict=True))
    return low, high


def lattice(design: Design, touched: TouchedPlate, high_hz: float | None = None) -> Lattice:
    """Lay a lattice of points whose contacts lie on the plate, clear of pillars on its touch face.

    Parameters
    ----------
    design : Design
        The plate.
    touched : TouchedPlate
        The plate with the finger, whose radius and impedance set the spacing.
    high_hz : float, optional
        Highest frequency of the waves in Hz; by default the band's upper end.

    Returns
    -------
    Lattice
        Points about the plate's centre, with the rule of a contact's mean.
    """
    radius = touched.finger.radius_m
    wavenumber = touched.finger.wavenumber_per_m(design, high_hz or touched.band_hz[1])
    steps, weights, share = _lattice_rule(_steps_of(radius * wavenumber))
    spacing, reach = share * radius, int(steps.max())
    ends = (design.half_length_m - radius, design.bare_touch_m - radius)
    counts = [int(max(end, 0.0) / spacing) + reach for end in ends]
    along, across = (np.arange(-count, count + 1) for count in counts)
    return Lattice(spacing, along, across, steps, weights)


def needed_bytes(touched: TouchedPlate, points: Lattice) -> float:
    """Estimate the memory of a map: the residual vectors of the largest group, and the receptances of all.

    Parameters
    ----------
    touched : TouchedPlate
        The plate with the finger.
    points : Lattice
        Points of all contacts.

    Returns
    -------
    float
        Memory in bytes.
    """
    count, distinct = len(points.points_m), len(_distinct(points.points_m)[0])
    held, largest = 0.0, 0.0
    for basis in touched.free.all_modes:
        group = basis.group
        loads = count if group.symmetries == (WHOLE,) else distinct * len(group.plates)
        columns, squares = (loads + 3 * BLOCK, SQUARES) if basis.has_one_loss else (COPIES * loads, ALL_SQUARES)
        largest = max(largest, 8.0 * group.pencil.dof * columns + 16.0 * squares * loads**2)
        held += 16.0 * loads**2
    return held + largest


@dataclass(frozen=True, eq=False)
class FoldedLoads:
    """Receptance of a group between its patches and unit forces at the distinct mirror images of points, class by class.

    receptance (p + k, p + k) in SI, gain (n, p + k). numbers, signs (classes, p + q): where the loads of the whole plate are
    among these, and the signs of their motion; patches count in the first class alone.
    """

    receptance: ComplexArray
    gain: FloatArray
    numbers: IntArray
    signs: FloatArray

    def among(self, rows: IntArray, columns: IntArray) -> ComplexArray:
        """Receptance (..., r, c) between loads of the whole plate (..., r) and (..., c)."""
        pairs = product(zip(self.numbers, self.signs, strict=True), repeat=2)
        return np.sum(
            [
                one_sign[rows][..., None]
                * self.receptance[one[rows][..., None], other[columns][..., None, :]]
                * other_sign[columns][..., None, :]
                for (one, one_sign), (other, other_sign) in pairs
            ],
            axis=0,
        )

    def gains(self, loads: IntArray) -> FloatArray:
        """Gains (..., n, l) of loads of the whole plate (..., l)."""
        each = [sign[loads] * self.gain[:, own[loads]] for own, sign in zip(self.numbers, self.signs, strict=True)]
        return np.moveaxis(np.sum(each, axis=0), 0, -2)


def folded_loads(touched: TouchedPlate, points_m: FloatArray, frequency_hz: float) -> list[FoldedLoads]:
    """Compute the receptance of a free plate between its patches and points of its touch face, group by group.

    Parameters
    ----------
    touched : TouchedPlate
        The plate.
    points_m : ndarray, shape (q, 2)
        The points.
    frequency_hz : float
        Frequency in Hz.

    Returns
    -------
    list of FoldedLoads
        One of each group of coupled symmetry classes: charges of the patches in C and u_z of the points in m, per volt and
        per newton.
    """
    plate = touched.plate
    eigenvalue, unit = plate.scale.eigenvalue(frequency_hz), plate.stiffness_unit
    out = []
    for basis in touched.free.all_modes:
        forces, numbers, signs = _folded(basis.group, points_m, len(plate.patches))
        loaded = with_points(basis, forces / unit)
        out.append(FoldedLoads(loaded.receptance(eigenvalue) * unit, loaded.gain, numbers, signs))
    return out


def crest_motion(along_m: ComplexArray, normal_m: ComplexArray, frequency_hz: float) -> CrestMotion:
    """Compute the motion of the face along x from its amplitudes, time convention e^{+j omega t}.

    Parameters
    ----------
    along_m, normal_m : ndarray, shape (nx, ny)
        Complex peak amplitudes of u_x and u_z on the touch face.
    frequency_hz : float
        Frequency in Hz.

    Returns
    -------
    CrestMotion
        Speeds in m/s; the crest's is 0 where u_z vanishes.
    """
    omega, size = 2.0 * pi * frequency_hz, np.abs(normal_m)
    # the touch face is z = 0: at its crests u_z e^{j omega t} = -|u_z|, where u_x has the speed omega Im(u_x u_z*)/|u_z|
    turning = (along_m * normal_m.conj()).imag
    crest = np.divide(turning, size, out=np.zeros_like(size), where=size > 0.0)
    return CrestMotion(np.asarray(omega * crest), np.asarray(omega * np.abs(along_m)))


def _contact_half_angle(load: float) -> float:
    """Half of the period's angle in which skin and face touch, above 0 and at most pi, of stiffness times amplitude over force.

    The mean pressure bears the force: (sin t - t cos t)/pi = 1/load; pi up to a load of 1, where they never part.
    """
    if load <= 1.0:
        return pi
    from scipy.optimize import brentq

    return float(brentq(lambda t: (sin(t) - t * cos(t)) / pi - 1.0 / load, 1e-6, pi))


def drive_share(load: float, lag: float = 0.0) -> float:
    """Compute the net shear over mu times the force, for skin that slides all the time.

    Limits of a wave that travels: 2 load/pi of a soft contact, 1 from a load of pi upwards, where only crests touch.

    Parameters
    ----------
    load : float
        Dynamic stiffness times amplitude over force, dimensionless.
    lag : float, optional
        Angle in rad as `CrestMotion.lag`: 0 for a wave that travels, pi/2 for one that stands.

    Returns
    -------
    float
        Share from 0 to 1.
    """
    if load <= 1.0:
        return 2.0 * load * cos(lag) / pi
    half = _contact_half_angle(load)
    low, high = max(-half, lag - pi / 2.0), min(half, lag + pi / 2.0)
    driving = (sin(high) - high * cos(half)) - (sin(low) - low * cos(half))
    return max(0.0, driving / (sin(half) - half * cos(half)) - 1.0)


def _likeliest(problem: _Problem, row: int, low: float, high: float) -> tuple[complex, ComplexArray] | None:
    """Eigenvalue between two limits whose vector holds most of a mode, to NEAR."""
    value = complex(problem.own[row, row])
    for _ in range(PASSES):
        matrix, slope = problem.at(value)
        # N linearised about v, (N - v N' + mu N') x = 0, has every eigenvalue near v at once
        values, vectors = scipy.linalg.eig(matrix - value * slope, -slope)
        known = np.flatnonzero((values.real >= low) & (values.real <= high))
        if not len(known):
            return None
        best = known[int(np.argmax(problem.shares(values[known], vectors[:, known], row)))]
        before, value = value, complex(values[best])
        if abs(value - before) <= NEAR * abs(value):
            return value, vectors[:, best]
    return None


def _beyond(basis: GroupModes, patches: int, slopes: bool) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues (k,) and gains (k, loads) of the Ritz modes of the residual vectors of the loads after the patches."""
    count, loads = len(basis.eigenvalue), basis.group.loads.shape[1]
    own = np.arange(patches, loads)
    columns = np.concatenate([own, loads + own] if slopes else [own]) + count
    stiffness, mass = (each[np.ix_(columns, columns)] for each in basis.projected)
    gain = np.vstack([each[patches:, patches:].T for each in basis.residual_gain[: 2 if slopes else 1]])
    eigenvalue, vectors = ritz_modes(stiffness, mass)
    return eigenvalue, vectors.T @ gain


def _folded(group: Group, points_m: FloatArray, patches: int) -> tuple[sp.csc_array, IntArray, FloatArray]:
    """Unit forces (dof, k) at the distinct mirror images of points in x, y >= 0, class by class, and where the whole plate's
    loads, its patches first, are among patches and forces: numbers and signs, (classes, p + q) each.
    """
    whole = group.symmetries == (WHOLE,)
    distinct, which = (points_m, np.arange(len(points_m))) if whole else _distinct(points_m)
    forces = [face_motion(Group((plate,), group.join, group.loads), distinct).T for plate in group.plates]
    size = patches + len(points_m)
    numbers, signs = np.tile(np.arange(size), (len(forces), 1)), np.zeros((len(forces), size))
    signs[0, :patches] = 1.0
    for number, symmetry in enumerate(group.symmetries):
        numbers[number, patches:] = patches + number * len(distinct) + which
        signs[number, patches:] = 1.0 if whole else mirror_signs(symmetry, points_m)[:, 2]
    return sp.block_diag(forces, format="csc"), numbers, signs


def _distinct(points_m: FloatArray) -> tuple[FloatArray, IntArray]:
    """Mirror images in x, y >= 0, each once, (k, 2), and which of them is each point's, (q,)."""
    folded = np.asarray(np.round(np.abs(points_m), 12), dtype=float)
    distinct, which = np.unique(folded, axis=0, return_inverse=True)
    return distinct, which.ravel()


@cache
def _lattice_rule(steps: int) -> tuple[IntArray, FloatArray, float]:
    """A rule for the mean over a disk on a square lattice: steps (p, 2) from the middle, weights (p,), spacing over the radius.

    It has all points of the disk, and the weights nearest to even ones that are exact to a degree. The degree is the
    highest that leaves each weight above LEAST of an even share.
    """
    each = range(-steps, steps + 1)
    places = np.array([(i, j) for i, j in product(each, each) if i * i + j * j <= steps * steps])
    spacing = 1.0 / (steps + EDGE)
    for degree in range(2 * steps - 1, 0, -2):
        weights = _weights(places * spacing, degree)
        if weights.min() * len(places) >= LEAST:
            break
    return places, weights, spacing


def _steps_of(wavenumber_radius: float) -> int:
    """Steps over a radius, within SPAN, for the mean of a product of two waves k R; the most may miss more than RULE_ENOUGH."""
    low, high = SPAN
    needed = (
        n for n in range(low, high) if touched_plate.left_beyond(2.0 * wavenumber_radius, 2 * n - 1) <= RULE_ENOUGH
    )
    return next(needed, high)


def _weights(points: FloatArray, degree: int) -> FloatArray:
    """Weights (p,) nearest to even ones whose means of even powers up to a degree are the disk's."""
    powers = [(a, b) for a in range(0, degree + 1, 2) for b in range(0, degree + 1 - a, 2)]
    values = np.array([points[:, 0] ** a * points[:, 1] ** b for a, b in powers])
    even = np.full(len(points), 1.0 / len(points))
    exact = np.array([_mean(a, b) for a, b in powers])
    return np.asarray(even + np.linalg.lstsq(values, exact - values @ even, rcond=None)[0])


def _mean(a: int, b: int) -> float:
    """Mean of x^a y^b over the unit disk, for even powers."""
    return 2.0 * gamma((a + 1) / 2) * gamma((b + 1) / 2) / (pi * (a + b + 2) * gamma((a + b) / 2 + 1))
