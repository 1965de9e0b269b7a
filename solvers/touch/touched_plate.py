"""A driven plate under a fingertip: moments of its pressure on a disk of the touch face, in addition to the patches.

The skin reacts locally, with the pressure -Z/A du_z/dt on a disk of area A. In polynomials Z_j that are orthonormal in the mean
over the disk (`solvers.touch.disk`) the motion's moments are u_j = mean(u_z Z_j) and the pressure's f_j = -D u_j with
D = j omega Z; with the receptance G of the free plate between patches p and moments f, (1 + G_ff D) u_f = G_fp V (Woodbury):
the plate's modes and residual vectors serve every impedance and every place.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from math import pi
from typing import Self

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from geometry.fingertips import Fingertip
from geometry.layout import Design
from solvers.errors import SolverError
from solvers.fem.eigen import factor_near
from solvers.fem.factor.factoriser import Factoriser
from solvers.piezo.forced import ForcedPlate, GroupModes, residual_vectors
from solvers.piezo.patched_plate import Group
from solvers.piezo.point import face_motion
from solvers.touch import disk

FINER = 9  # further points along each direction that show how far the disk's own integrals have settled


@dataclass(frozen=True)
class Finger:
    """A fingertip at a place on the touch face, (x, y) in m from the plate's centre, with its contact's radius in m.

    degree: of the polynomials over the disk that motion and pressure are expanded in.
    """

    tip: Fingertip
    at_m: tuple[float, float]
    radius_m: float
    degree: int = disk.DEGREES[0]

    @property
    def area_m2(self) -> float:
        """Of the contact."""
        return pi * self.radius_m**2

    def rows(self, group: Group, finer: int = 0) -> FloatArray:
        """Moments of u_z over the contact per degree of freedom of a group, (moments, dof)."""
        points, weights = disk.means(self.degree, finer)
        return np.asarray(face_motion(group, np.array(self.at_m) + self.radius_m * points, means=weights).toarray())

    def dynamic_stiffness(self, frequency_hz: complex) -> complex:
        """D = j omega Z = k + j omega c - omega^2 m of the whole contact, N/m, at a frequency that may be complex."""
        omega = 2.0 * pi * frequency_hz
        resistance = self.tip.resistance_n_s_m(self.area_m2)
        return self.tip.stiffness_n_m + 1j * omega * resistance - omega**2 * self.tip.mass_kg

    def wavenumber_per_m(self, design: Design, frequency_hz: float) -> float:
        """Bound on the wavenumber of the plate's flexural motion under the contact, its pressure included.

        k^4 = (omega^2 rho h + |D|/A) / (E h^3 / (12 (1 - nu^2))), the larger of plate wave and local foundation.
        """
        material, thickness = design.material, design.thickness_m
        bending = material.young_pa * thickness**3 / (12.0 * (1.0 - material.poisson**2))
        inertia = (2.0 * pi * frequency_hz) ** 2 * material.density_kg_m3 * thickness
        return float(((inertia + abs(self.dynamic_stiffness(frequency_hz)) / self.area_m2) / bending) ** 0.25)

    def following(self, design: Design, frequency_hz: float) -> Finger:
        """The same finger with the degree that the plate's waves up to a frequency need."""
        reach = self.radius_m * self.wavenumber_per_m(design, frequency_hz)
        return replace(self, degree=disk.degree_of(reach))


class TouchedPlate(ForcedPlate):
    """The plate of a forced response with a finger on it; the moments of the finger's pressure are loads after the patches.

    A finger without stiffness, damping and mass adds none: every figure is then the free plate's, digit by digit. Raises
    SolverError for a contact that reaches outside the plate.

    missing: flexibility under the contact in addition to that of modes and residual vectors, (moments, moments) in m/N.

    beyond: Ritz modes of the residual vectors, eigenvalues and gains a group, with slopes or without: as soon as asked for, and
    the same on plates within the bars.
    """

    missing: FloatArray | None = None

    def __init__(self, forced: ForcedPlate, finger: Finger) -> None:
        self.free, self.finger = forced, finger
        self.beyond: dict[bool, list[tuple[FloatArray, FloatArray]]] = {}
        self.plate, self.design, self.band_hz, self.circuit = (
            forced.plate,
            forced.design,
            forced.band_hz,
            forced.circuit,
        )
        self.drivers, self.sensors, self.loss = forced.drivers, forced.sensors, forced.loss
        self.margin, self.signs = forced.margin, forced.signs
        self.modes = forced.modes
        if finger.tip.is_nothing:
            return
        rows = [finger.rows(basis.group) for basis in forced.all_modes]
        unit = self.plate.stiffness_unit
        self.modes = [with_loads(basis, row.T / unit) for basis, row in zip(forced.all_modes, rows, strict=True)]

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

    @cached_property
    def contact_rows(self) -> list[FloatArray]:
        """Moments of u_z over the contact per unit of each column, (moments, columns), group by group."""
        count, unit = len(self.plate.patches), self.plate.stiffness_unit
        if self.modes is not self.free.modes:
            return [unit * basis.group.loads[:, count:].T @ basis.columns for basis in self.modes]
        return [self.finger.rows(basis.group) @ basis.columns for basis in self.modes]

    def lesser(self, degree: int) -> Self:
        """The same with the finger's moments up to a lower degree only: what those beyond it are worth is the difference."""
        other = copy(self)
        other.finger, other.beyond = replace(self.finger, degree=degree), {}
        for name in ("contact_rows", "grams", "_touched"):
            other.__dict__.pop(name, None)
        if self.modes is not self.free.modes:
            kept = len(self.plate.patches) + disk.count_of(degree)
            other.modes = [_first_loads(basis, kept) for basis in self.modes]
        return other

    def stiffer(self, factor: float) -> Self:
        """The same with so many times the finger's impedance."""
        other = copy(self)
        tip = self.finger.tip
        names = ("stiffness_n_m", "damping_n_s_m", "mass_kg", "specific_n_s_m3")
        scaled = {name: factor * getattr(tip, name) for name in names}
        other.finger = replace(self.finger, tip=replace(tip, **scaled))
        return other

    def softer(self, missing: FloatArray) -> Self:
        """The same with more flexibility under the finger, (moments, moments) in m/N."""
        other = copy(self)
        other.missing = missing
        return other

    def receptance(self, eigenvalue: float | FloatArray) -> ComplexArray:
        """Charge of patches (C) and moments of motion (m), per volt and per newton, of the free plate at eigenvalues (...),
        (..., p + f, p + f).
        """
        parts = [basis.receptance(eigenvalue, self.loss) for basis in self.modes]
        whole, count = np.asarray(np.sum(parts, axis=0) * self.plate.stiffness_unit), len(self.plate.patches)
        if self.missing is not None:
            whole[..., count:, count:] += self.missing
        return whole

    def volts_over(self, eigenvalues: FloatArray) -> ComplexArray:
        """Voltages of the patches, then the moments of the finger's force in N, per volt of drive, (n, loads)."""
        tones = self.plate.scale.frequency(eigenvalues)
        stiffness = np.array([self.finger.dynamic_stiffness(float(tone)) for tone in tones])
        return self.loads_of(self.receptance(eigenvalues), stiffness)

    def loads_of(self, receptance: ComplexArray, stiffness_n_m: complex | ComplexArray) -> ComplexArray:
        """The same from receptances (..., p + f, p + f) of patches and moments and the contact's dynamic stiffness (...)."""
        count, stiffness = len(self.plate.patches), np.asarray(stiffness_n_m)[..., None, None]
        charge, moved = receptance[..., :count, :count], receptance[..., count:, :count]
        own = np.eye(moved.shape[-2]) + stiffness * receptance[..., count:, count:]
        push = -stiffness * np.linalg.solve(own, moved)
        volts = self.patch_volts(lambda: charge + receptance[..., :count, count:] @ push)
        forces = (push @ volts[..., None])[..., 0]
        return np.concatenate([np.broadcast_to(volts, (*forces.shape[:-1], count)), forces], axis=-1)

    def contact_motion(self, frequency_hz: float) -> ComplexArray:
        """Moments of u_z over the contact, m per volt of drive."""
        eigenvalue = self.plate.scale.eigenvalue(frequency_hz)
        loads = self.volts(eigenvalue)
        pairs = zip(self.modes, self.contact_rows, strict=True)
        moved = np.sum([rows @ b.amplitudes(eigenvalue, self.loss, loads) for b, rows in pairs], axis=0)
        return np.asarray(moved if self.missing is None else moved + self.missing @ loads[len(self.plate.patches) :])


def contact_motion(plate: ForcedPlate, finger: Finger, frequency_hz: float) -> ComplexArray:
    """Moments of u_z over a finger's contact, m per volt of drive, on a free or a touched plate."""
    eigenvalue = plate.plate.scale.eigenvalue(frequency_hz)
    loads = plate.volts(eigenvalue)
    moved = [
        finger.rows(basis.group) @ (basis.columns @ basis.amplitudes(eigenvalue, plate.loss, loads))
        for basis in plate.modes
    ]
    return np.asarray(np.sum(moved, axis=0))


def rms(moments: ComplexArray) -> float:
    """Root of the mean square over the contact from the moments of peak amplitudes."""
    return float(np.linalg.norm(moments))


def integration_error(plate: TouchedPlate, frequency_hz: float) -> float:
    """Relative error of the motion's moments over the contact at a frequency: what the rule of points and the polynomials miss.

    The kinks of a coarse mesh's field lie beyond every degree.
    """
    own, (points, weights) = plate.contact_motion(frequency_hz), disk.means(plate.finger.degree, FINER)
    places = np.array(plate.finger.at_m) + plate.finger.radius_m * points
    eigenvalue = plate.plate.scale.eigenvalue(frequency_hz)
    loads = plate.volts(eigenvalue)
    moved = np.sum(
        [
            face_motion(basis.group, places) @ (basis.columns @ basis.amplitudes(eigenvalue, plate.loss, loads))
            for basis in plate.modes
        ],
        axis=0,
    )
    square = float(weights[0] @ np.abs(moved) ** 2)  # the first polynomial is 1
    if not square:
        return 0.0
    by_rule, missed = rms(weights @ moved - own) / np.sqrt(square), 1.0 - rms(own) / np.sqrt(square)
    return float(by_rule + abs(missed))


def _first_loads(basis: GroupModes, kept: int) -> GroupModes:
    """A group's modes with the first of its loads alone."""
    count, own = len(basis.frequency_hz), basis.group.loads.shape[1]
    columns = np.concatenate([np.arange(count), count + np.arange(kept), count + own + np.arange(kept)])
    return replace(
        basis,
        group=replace(basis.group, loads=basis.group.loads[:, :kept]),
        gain=basis.gain[:, :kept],
        columns=basis.columns[:, columns],
        residual_gain=(basis.residual_gain[0][:kept, :kept], basis.residual_gain[1][:kept, :kept]),
    )


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
