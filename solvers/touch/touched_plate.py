"""A driven plate under a fingertip: points of impedance on its touch face, beside the patches that drive it.

The skin reacts locally, with the pressure -Z/A du_z/dt on a disk of area A. At n points of equal share the finger's forces are
f = -D u with D = j omega Z/n; with the receptance G of the free plate between patches p and points f,
(1 + G_ff D) u_f = G_fp V (Woodbury): the plate's modes and residual vectors serve every impedance and every place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi, sqrt

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from geometry.fingertips import Fingertip
from solvers.errors import SolverError
from solvers.fem.eigen import factor_near
from solvers.fem.factor.factoriser import Factoriser
from solvers.piezo.forced import ForcedPlate, GroupModes, residual_vectors
from solvers.piezo.point import face_motion

STEPS = np.array([(i, j) for i in range(-2, 3) for j in range(-2, 3) if i * i + j * j <= 4])
STEP = sqrt(len(STEPS) / (2.0 * float((STEPS**2).sum())))  # of the radius: 13 points with the second moment of the disk


@dataclass(frozen=True)
class Finger:
    """A fingertip at a place on the touch face, (x, y) in m from the plate's centre, with its contact's radius in m."""

    tip: Fingertip
    at_m: tuple[float, float]
    radius_m: float

    @property
    def area_m2(self) -> float:
        """Of the contact."""
        return pi * self.radius_m**2

    @property
    def points_m(self) -> FloatArray:
        """Points of equal share of the contact, (13, 2): the disk's integrals up to the third degree are exact."""
        return np.array(self.at_m) + self.spacing_m * STEPS

    @property
    def spacing_m(self) -> float:
        """Between two neighbouring points of the contact."""
        return STEP * self.radius_m

    def stiffness_n_m(self, frequency_hz: float) -> complex:
        """Dynamic stiffness of one point, D = j omega Z/n."""
        impedance = self.tip.impedance_n_s_m(frequency_hz, self.area_m2)
        return 2j * pi * frequency_hz * impedance / len(STEPS)


class TouchedPlate(ForcedPlate):
    """The plate of a forced response with a finger on it; the finger's points are loads after the patches.

    A finger without stiffness, damping and mass adds none: every figure is then the free plate's, digit by digit. Raises
    SolverError for a point outside the plate.
    """

    def __init__(self, forced: ForcedPlate, finger: Finger) -> None:
        self.free, self.finger = forced, finger
        self.plate, self.design, self.band_hz, self.circuit = (
            forced.plate,
            forced.design,
            forced.band_hz,
            forced.circuit,
        )
        self.drivers, self.sensors, self.loss = forced.drivers, forced.sensors, forced.loss
        self.margin, self.signs = forced.margin, forced.signs
        self.modes = forced.modes
        if not finger.tip.is_nothing:
            loads = [face_motion(basis.group, finger.points_m).T.toarray() for basis in forced.all_modes]
            unit = self.plate.stiffness_unit
            self.modes = [with_loads(basis, load / unit) for basis, load in zip(forced.all_modes, loads, strict=True)]

    @property
    def wanted_row(self) -> int | None:
        """Row of the free plate's wanted mode among the modes of all groups, one after another."""
        place = self.free.wanted_place()
        if place is None:
            return None
        plates, before = self.free.modes[place[0]].group.plates, 0
        for basis in self.modes:
            if basis.group.plates is plates:
                return before + place[1]
            before += len(basis.frequency_hz)
        raise SolverError("the wanted mode is in no group of the touched plate")

    def receptance(self, eigenvalue: float) -> ComplexArray:
        """Charge of patches (C) and motion of points (m), per volt and per newton, of the free plate: (p + f, p + f)."""
        parts = [basis.receptance(eigenvalue, self.loss) for basis in self.modes]
        return np.asarray(np.sum(parts, axis=0) * self.plate.stiffness_unit)

    def volts(self, eigenvalue: float) -> ComplexArray:
        """Voltages of the patches, then the finger's forces in N, per volt of drive."""
        frequency = float(self.plate.scale.frequency(np.array(eigenvalue)))
        return self.loads_of(self.receptance(eigenvalue), self.finger.stiffness_n_m(frequency))

    def loads_of(self, receptance: ComplexArray, stiffness_n_m: complex) -> ComplexArray:
        """The same from a receptance of patches and points and the points' dynamic stiffness."""
        count = len(self.plate.patches)
        charge, moved = receptance[:count, :count], receptance[count:, :count]
        push = -stiffness_n_m * np.linalg.solve(np.eye(len(moved)) + stiffness_n_m * receptance[count:, count:], moved)
        volts = self.patch_volts(lambda: charge + receptance[:count, count:] @ push)
        return np.concatenate([volts, push @ volts])


def contact_motion(plate: ForcedPlate, finger: Finger, frequency_hz: float) -> ComplexArray:
    """u_z at the points of a finger's contact, (13,) in m per volt of drive, on a free or a touched plate."""
    eigenvalue = plate.plate.scale.eigenvalue(frequency_hz)
    loads = plate.volts(eigenvalue)
    moved = [
        face_motion(basis.group, finger.points_m) @ (basis.columns @ basis.amplitudes(eigenvalue, plate.loss, loads))
        for basis in plate.modes
    ]
    return np.asarray(np.sum(moved, axis=0))


def rms(motion: ComplexArray) -> float:
    """Root of the mean square of peak amplitudes."""
    return float(np.sqrt(np.mean(np.abs(motion) ** 2)))


def with_loads(basis: GroupModes, loads: FloatArray) -> GroupModes:
    """A group's modes with further loads (dof, more) after its own, and their residual vectors about the same middle."""
    count, own = len(basis.frequency_hz), basis.group.loads.shape[1]
    vectors, residuals, slopes = np.split(basis.columns, [count, count + own], axis=1)
    factor, middle = factor_near(basis.group.pencil, basis.middle, Factoriser())
    gain, residual, slope = residual_vectors(basis.group, factor, middle, (basis.eigenvalue, vectors), loads)
    everything, residuals, slopes = (
        np.hstack(pair) for pair in ((basis.group.loads, loads), (residuals, residual), (slopes, slope))
    )
    return replace(
        basis,
        group=replace(basis.group, loads=everything),
        gain=np.hstack([basis.gain, gain]),
        columns=np.hstack([vectors, residuals, slopes]),
        residual_gain=(everything.T @ residuals, everything.T @ slopes),
    )
