"""The target mode under a finger: its complex eigenvalue, and how much of the free mode it keeps.

With the contact's moments u_f = g q + R f and f = -D u_f, the modes' coordinates q obey N(lambda) q = 0,
N = Lambda (1 + i/Q) - lambda + g' T g, T = (1 + D R)^-1 D, all at the complex lambda = omega^2. Loss is uniform,
K (1 + i/Q): a real mass keeps 1/Q exactly, a spring dilutes it, a damper adds to it. Beyond the band R = sum g g' /
(l (1 + i/Q) - lambda) over the Ritz modes of the residual vectors, which match four terms about the band's middle and have no
root that the plate lacks. N linearised about lambda gives the mode that holds most of the free one; inverse iteration on N
(ruhe1973) settles it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from geometry.elements import ComplexArray, FloatArray
from solvers.piezo.forced import GroupModes
from solvers.piezo.responses import ritz_modes
from solvers.touch.touched_plate import TouchedPlate

PASSES, STEPS = 30, 12  # of the linearised problem, of inverse iteration
NEAR, SETTLED = 1e-4, 1e-12  # relative change of an eigenvalue between them


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
        """What the finger adds to 1/Q."""
        return self.loss - self.free_loss


def loaded_mode(touched: TouchedPlate, start: LoadedMode | None = None, slopes: bool = True) -> LoadedMode | None:
    """The target mode under the finger, from that of a plate hardly different where it is known; None when the band holds
    none, or the finger leaves none among the modes about it.

    slopes: with the slopes of the residual vectors; without them R matches two terms, and what changes bounds what four miss.
    """
    free_hz, row = touched.free.target_hz(), touched.target_row
    if free_hz is None or row is None:
        return None
    if touched.finger.tip.is_nothing:
        return LoadedMode(free_hz, free_hz, touched.loss, touched.loss, 1.0)
    problem, (low, high) = _Problem(touched, slopes), known_range(touched)
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


def known_range(touched: TouchedPlate) -> tuple[float, float]:
    """Scaled eigenvalues between which all modes are summed."""
    scale = touched.plate.scale
    low, high = (scale.eigenvalue(share * end) for share, end in zip(touched.margin, touched.band_hz, strict=True))
    return low, high


def _likeliest(problem: _Problem, row: int, low: float, high: float) -> tuple[complex, ComplexArray] | None:
    """Among eigenvalues between two the one whose vector holds most of a mode, to NEAR."""
    value = complex(problem.own[row])
    for _ in range(PASSES):
        matrix, slope = problem.at(value)
        values, vectors = scipy.linalg.eig(matrix - value * slope, -slope)
        known = np.flatnonzero((values.real >= low) & (values.real <= high))
        if not len(known):
            return None
        best = known[int(np.argmax(problem.shares(values[known], vectors[:, known], row)))]
        before, value = value, complex(values[best])
        if abs(value - before) <= NEAR * abs(value):
            return value, vectors[:, best]
    return None


class _Problem:
    """N(lambda) of a touched plate, (modes, modes), and its derivative."""

    def __init__(self, touched: TouchedPlate, slopes: bool) -> None:
        self.touched, self.loss = touched, 1.0 + 1j * touched.loss
        self.unit, count = touched.plate.stiffness_unit, len(touched.plate.patches)
        self.own: ComplexArray = np.concatenate([basis.eigenvalue for basis in touched.modes]) * self.loss
        self.gain: FloatArray = np.vstack([basis.gain[:, count:] for basis in touched.modes])
        if slopes not in touched.beyond:
            touched.beyond[slopes] = [_beyond(basis, count, slopes) for basis in touched.modes]
        beyond = touched.beyond[slopes]
        self.beyond = self.loss * np.concatenate([values for values, _ in beyond])
        self.beyond_gain = np.vstack([gain for _, gain in beyond])

    def at(self, value: complex) -> tuple[ComplexArray, ComplexArray]:
        """N and dN/dlambda."""
        stiffness, stiffening = self._finger(value)
        residual, slope = self._residual(value)
        turn = np.linalg.inv(np.eye(len(residual)) + stiffness * residual)
        change = turn @ (stiffening * np.eye(len(residual)) - stiffness**2 * slope) @ turn
        matrix, derivative = (self.unit * self.gain @ each @ self.gain.T for each in (stiffness * turn, change))
        return np.asarray(matrix + np.diag(self.own - value)), np.asarray(derivative - np.eye(len(self.own)))

    def _finger(self, value: complex) -> tuple[complex, complex]:
        """D and dD/dlambda."""
        finger, per_hz = self.touched.finger, self.touched.plate.scale.eigenvalue(1.0)
        omega = 2.0 * np.pi * np.sqrt(complex(value) / per_hz)
        resistance, mass = finger.tip.resistance_n_s_m(finger.area_m2), finger.tip.mass_kg
        slope = (1j * resistance - 2.0 * omega * mass) * omega / (2.0 * value)
        return finger.dynamic_stiffness(omega / (2.0 * np.pi)), slope

    def _residual(self, value: complex) -> tuple[ComplexArray, ComplexArray]:
        """What modes beyond the band add to the receptance, damped as the others, and its derivative."""
        inverse, gain = 1.0 / (self.beyond - value), self.beyond_gain
        residual, slope = (self.unit * gain.T @ (each[:, None] * gain) for each in (inverse, inverse**2))
        missing = self.touched.missing
        return residual if missing is None else residual + missing, slope

    def shares(self, values: ComplexArray, vectors: ComplexArray, row: int) -> FloatArray:
        """Share of a free mode in motions (modes, k) at eigenvalues (k,), of 1, with what they move beyond the band."""
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


def _beyond(basis: GroupModes, patches: int, slopes: bool) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues (k,) and gains (k, loads) of the Ritz modes of the residual vectors of the loads after the patches."""
    count, loads = len(basis.eigenvalue), basis.group.loads.shape[1]
    own = np.arange(patches, loads)
    columns = np.concatenate([own, loads + own] if slopes else [own]) + count
    stiffness, mass = (each[np.ix_(columns, columns)] for each in basis.projected)
    gain = np.vstack([each[patches:, patches:].T for each in basis.residual_gain[: 2 if slopes else 1]])
    eigenvalue, vectors = ritz_modes(stiffness, mass)
    return eigenvalue, vectors.T @ gain
