"""A driven plate under a fingertip: its motion with the contact's pressure, the power, and the static correction."""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace
from functools import cache, cached_property
from math import factorial, pi
from typing import Self

import numpy as np
import scipy.sparse as sp
from scipy.special import eval_jacobi, roots_legendre

from geometry.elements import ComplexArray, FloatArray
from geometry.errors import MeshError
from geometry.fingertips import Fingertip
from geometry.hex.boxes import bonded_boxes, hex_mesh
from geometry.hex.scenes import HexSettings
from geometry.layout import Design
from geometry.mesh import Mesh
from solvers.errors import SolverError, TooLarge
from solvers.fem.eigen import factor_near
from solvers.fem.factor import Factoriser
from solvers.fem.solid import constrain, free_mask
from solvers.fem.surface import SAME_M, grid_weights
from solvers.piezo.forced import ForcedPlate, GroupModes, damped, residual_vectors, with_moduli
from solvers.piezo.patch import StaticCorrection
from solvers.piezo.patched_plate import Group
from solvers.piezo.responses import face_motion
from solvers.plates.assembled import Reductions
from solvers.superelement.bond import Contact, JoinedPanels, Panels, positive_part
from solvers.superelement.plate import AssembledPlate

# -- integrals over the disk -------------------------------------------------------------------------------------------
# Integrals over a finger's disk: means against Zernike polynomials.
# Zernike polynomials Z_j are orthonormal in the mean over the disk: with c_j the mean of u Z_j, the mean of |u|^2 is
# sum |c_j|^2 as soon as their degree follows u. A wave number k on a radius R leaves (k R/2)^(n+1)/(n+1)! beyond
# degree n, the leading term of the Bessel function J_(n+1)(k R) in the expansion of a plane wave (noll1976).

ENOUGH = 1e-3  # of the motion: what the degree may miss; the error of a frequency or a loss is then its square
DEGREES = (4, 16)  # at least and at most

BLOCK = 128  # loads that are solved for at once


def left_beyond(wavenumber_radius: float, degree: int) -> float:
    """Estimate the share of a plane wave over the disk that polynomials up to a degree miss.

    Parameters
    ----------
    wavenumber_radius : float
        Wavenumber times radius, k R, dimensionless.
    degree : int
        Highest degree n of the polynomials.

    Returns
    -------
    float
        Relative amplitude (k R / 2)^(n + 1) / (n + 1)!.
    """
    return (wavenumber_radius / 2.0) ** (degree + 1) / factorial(degree + 1)


def _zernike(degree: int, points: FloatArray) -> FloatArray:
    """Zernike polynomials (m, p) up to a degree at points (p, 2) of the unit disk, orthonormal in the mean over it (noll1976).

    By ascending degree, then azimuthal order: sines for negative orders, cosines for the others.
    """
    radius, angle = np.hypot(*points.T), np.arctan2(points[:, 1], points[:, 0])
    rows = []
    for n in range(degree + 1):
        for m in range(-n, n + 1, 2):
            radial = radius ** abs(m) * eval_jacobi((n - abs(m)) // 2, 0, abs(m), 2.0 * radius**2 - 1.0)
            turn = np.cos(m * angle) if m >= 0 else np.sin(-m * angle)
            rows.append(np.sqrt((n + 1.0) * (2.0 if m else 1.0)) * radial * turn)
    return np.array(rows)


def _count_of(degree: int) -> int:
    """Number of Zernike polynomials up to a degree."""
    return (degree + 1) * (degree + 2) // 2


@cache
def _disk_means(degree: int, finer: int = 0) -> tuple[FloatArray, FloatArray]:
    """Points (p, 2) of the unit disk and weights (m, p) that give the means of u Z_j over it from u at the points.

    A Gauss rule along the squared radius times even angles, exact to three times the degree and more. A mesh's field
    has kinks: `finer` further points along each estimate the remaining error.
    """
    along, around = max(24, 2 * degree) + finer, max(72, 4 * degree + 1) + finer
    nodes, shares = roots_legendre(along)
    radius, angle = np.sqrt((nodes + 1.0) / 2.0), 2.0 * pi * (np.arange(around) + 0.5) / around
    points = np.stack([np.outer(radius, turn(angle)) for turn in (np.cos, np.sin)], axis=-1).reshape(-1, 2)
    weights = np.repeat(shares / 2.0 / around, around)
    return points, _zernike(degree, points) * weights


# -- plate and finger --------------------------------------------------------------------------------------------------
# A driven plate under a fingertip: moments of its pressure on a disk of the touch face, in addition to the patches.
# The skin reacts locally, with the pressure -Z/A du_z/dt on a disk of area A. In polynomials Z_j that are orthonormal
# in the mean over the disk the motion's moments are u_j = mean(u_z Z_j) and the pressure's f_j = -D u_j with D = j
# omega Z; with the receptance G of the free plate between patches p and moments f, (1 + G_ff D) u_f = G_fp V
# (Woodbury): the plate's modes and residual vectors serve every impedance and every place.

FINER = 9  # further points along each direction that show how far the disk's own integrals have settled


@dataclass(frozen=True)
class Finger:
    """A fingertip at a place on the touch face, (x, y) in m from the plate's centre, with its contact's radius in m.

    degree: of the polynomials over the disk that motion and pressure are expanded in.
    """

    tip: Fingertip
    at_m: tuple[float, float]
    radius_m: float
    degree: int = DEGREES[0]

    @property
    def area_m2(self) -> float:
        """Area of the contact, m2."""
        return pi * self.radius_m**2

    def rows(self, group: Group, finer: int = 0) -> FloatArray:
        """Moments of u_z over the contact per degree of freedom of a group, (moments, dof)."""
        points, weights = _disk_means(self.degree, finer)
        return np.asarray(face_motion(group, np.array(self.at_m) + self.radius_m * points, means=weights).toarray())

    def dynamic_stiffness(self, frequency_hz: complex) -> complex:
        """D = j omega Z = k + j omega c - omega^2 m of the whole contact, N/m, at a frequency that may be complex."""
        omega = 2.0 * pi * frequency_hz
        resistance = self.tip.resistance_n_s_m(self.area_m2)
        return self.tip.stiffness_n_m + 1j * omega * resistance - omega**2 * self.tip.mass_kg

    def wavenumber_per_m(self, design: Design, frequency_hz: float) -> float:
        """Bound on the wavenumber of the plate's flexural motion under the contact, its pressure included.

        k^4 = (omega^2 rho h + |D|/A) / min(D_11, D_22), the larger of plate wave and local foundation.
        """
        bending = float(design.stack.bending_n_m.diagonal()[:2].min())
        inertia = (2.0 * pi * frequency_hz) ** 2 * design.stack.mass_kg_m2
        return float(((inertia + abs(self.dynamic_stiffness(frequency_hz)) / self.area_m2) / bending) ** 0.25)

    def following(self, design: Design, frequency_hz: float) -> Finger:
        """Return the finger with the degree that the plate's waves up to a frequency need."""
        reach = self.radius_m * self.wavenumber_per_m(design, frequency_hz)
        low, high = DEGREES
        degree = next((n for n in range(low, high) if left_beyond(reach, n) <= ENOUGH), high)
        return replace(self, degree=degree)


class TouchedPlate(ForcedPlate):
    """The plate of a forced response with a finger on it; the moments of the finger's pressure are loads after the patches.

    A finger without stiffness, damping and mass adds none: every figure is then the free plate's, digit by digit. Raises
    SolverError for a contact that reaches outside the plate.

    missing: flexibility under the contact in addition to that of modes and residual vectors, (moments, moments) in m/N.

    beyond: Ritz modes of the residual vectors, eigenvalues and gains per group, with slopes or without: computed on demand, and
    the same on plates within the error bars.
    """

    missing: FloatArray | None = None

    def __init__(self, forced: ForcedPlate, finger: Finger) -> None:
        self.free, self.finger = forced, finger
        self.beyond: dict[bool, list[tuple[FloatArray, FloatArray]]] = {}
        self.plate, self.design = forced.plate, forced.design
        self.band_hz, self.circuit = forced.band_hz, forced.circuit
        self.drivers, self.sensors = forced.drivers, forced.sensors
        self.margin, self.signs = forced.margin, forced.signs
        self.modes = forced.modes
        if finger.tip.is_nothing:
            return
        rows = [finger.rows(basis.group) for basis in forced.all_modes]
        unit = self.plate.stiffness_unit
        self.modes = [with_loads(basis, row.T / unit) for basis, row in zip(forced.all_modes, rows, strict=True)]

    @property
    def loss(self) -> float:
        """1/Q of the free plate's target mode; of the mode nearest to the band's middle where it has none."""
        return self.free.loss_at(self.free.target_hz() or sum(self.band_hz) / 2.0)

    @property
    def target_row(self) -> int | None:
        """Row of the free plate's target mode among the modes of all groups, one after another."""
        place = self.free.target_place()
        if place is None:
            return None
        plates, before = self.free.modes[place[0]].group.plates, 0
        for basis in self.modes:
            if basis.group.plates is plates:
                return before + place[1]
            before += len(basis.frequency_hz)
        raise SolverError("no group of the touched plate holds the target mode")

    @cached_property
    def contact_rows(self) -> list[FloatArray]:
        """Moments of u_z over the contact per unit of each column, (moments, columns), group by group."""
        count, unit = len(self.plate.patches), self.plate.stiffness_unit
        if self.modes is not self.free.modes:
            return [unit * basis.group.loads[:, count:].T @ basis.columns for basis in self.modes]
        return [self.finger.rows(basis.group) @ basis.columns for basis in self.modes]

    def lesser(self, degree: int) -> Self:
        """Return the plate with the finger's moments up to a lower degree only, to measure the effect of the others."""
        other = copy(self)
        other.finger, other.beyond = replace(self.finger, degree=degree), {}
        for name in ("contact_rows", "grams", "_touched"):
            other.__dict__.pop(name, None)
        if self.modes is not self.free.modes:
            kept = len(self.plate.patches) + _count_of(degree)
            other.modes = [_first_loads(basis, kept) for basis in self.modes]
        return other

    def stiffer(self, factor: float) -> Self:
        """Return the plate with the finger's impedance multiplied by a factor."""
        other = copy(self)
        tip = self.finger.tip
        names = ("stiffness_n_m", "damping_n_s_m", "mass_kg", "specific_n_s_m3")
        scaled = {name: factor * getattr(tip, name) for name in names}
        other.finger = replace(self.finger, tip=replace(tip, **scaled))
        return other

    def softer(self, missing: FloatArray) -> Self:
        """Return the plate with additional flexibility under the finger, (moments, moments) in m/N."""
        other = copy(self)
        other.missing = missing
        return other

    def receptance(self, eigenvalue: float | FloatArray) -> ComplexArray:
        """Charge of patches (C) and moments of motion (m), per volt and per newton, of the free plate at eigenvalues (...),
        (..., p + f, p + f).
        """
        parts = [basis.receptance(eigenvalue) for basis in self.modes]
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
        """Loads from receptances (..., p + f, p + f) of patches and moments and the contact's dynamic stiffness (...)."""
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
        moved = np.sum([rows @ b.amplitudes(eigenvalue, loads) for b, rows in pairs], axis=0)
        return np.asarray(moved if self.missing is None else moved + self.missing @ loads[len(self.plate.patches) :])


def integration_error(plate: TouchedPlate, frequency_hz: float) -> float:
    """Estimate the error of the motion's moments over the contact due to the rule of points and to the polynomials.

    The kinks of a coarse mesh's field lie beyond every degree.

    Parameters
    ----------
    plate : TouchedPlate
        The plate with the finger.
    frequency_hz : float
        Frequency in Hz.

    Returns
    -------
    float
        Relative to the rms of u_z over the contact; 0 where nothing moves.
    """
    own, (points, weights) = plate.contact_motion(frequency_hz), _disk_means(plate.finger.degree, FINER)
    places = np.array(plate.finger.at_m) + plate.finger.radius_m * points
    moved = plate.motion_by(lambda group: face_motion(group, places), frequency_hz)
    square = float(weights[0] @ np.abs(moved) ** 2)  # the first polynomial is 1
    if not square:
        return 0.0
    by_rule, missed = (
        np.linalg.norm(weights @ moved - own) / np.sqrt(square),
        1.0 - np.linalg.norm(own) / np.sqrt(square),
    )
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
        lost=None if basis.lost is None else basis.lost[np.ix_(columns, columns)],
        parted=basis.parted and replace(basis.parted, parts=basis.parted.parts[:, columns[:, None], columns]),
    )


def with_loads(basis: GroupModes, loads: FloatArray) -> GroupModes:
    """Add loads to a group's modes, with their gains and their residual vectors about the same middle.

    Parameters
    ----------
    basis : GroupModes
        Modes of a group.
    loads : ndarray, shape (dof, more)
        Further loads in the scaled units of the group's own.

    Returns
    -------
    GroupModes
        The same modes; the further loads come after the group's own.
    """
    count, own = len(basis.frequency_hz), basis.group.loads.shape[1]
    vectors, residuals, slopes = np.split(basis.columns, [count, count + own], axis=1)
    factor, middle = factor_near(basis.group.pencil, basis.middle, Factoriser())
    gain, residual, slope = residual_vectors(basis.group, factor, middle, (basis.eigenvalue, vectors), loads)
    everything, residuals, slopes = (
        np.hstack(pair) for pair in ((basis.group.loads, loads), (residuals, residual), (slopes, slope))
    )
    loaded = replace(
        basis,
        group=replace(basis.group, loads=everything),
        gain=np.hstack([basis.gain, gain]),
        columns=np.hstack([vectors, residuals, slopes]),
        residual_gain=(everything.T @ residuals, everything.T @ slopes),
    )
    loaded = loaded if basis.lost is None else damped(loaded)
    return loaded if basis.parted is None else with_moduli(loaded, basis.parted.moduli)


def with_points(basis: GroupModes, loads: sp.csc_array) -> GroupModes:
    """Add many loads to a group's modes for receptance alone: `with_loads` without columns where one loss serves all modes.

    R' M R takes the place of L' R1 = L' (K - middle M)^-1 M R, since R is M-orthogonal to the modes: no R1 is solved for, and
    only R is held.

    Parameters
    ----------
    basis : GroupModes
        Modes of a group.
    loads : sparse array, shape (dof, more)
        Further loads in the scaled units of the group's own.

    Returns
    -------
    GroupModes
        The same modes, whose gains and residual gains have the further loads after the group's own.
    """
    if not basis.has_one_loss:
        return with_loads(basis, loads.toarray())
    modes, first = len(basis.frequency_hz), basis.group.loads.shape[1]
    vectors, heavy = basis.columns[:, :modes], basis.images[1]
    factor, _ = factor_near(basis.group.pencil, basis.middle, Factoriser())
    residual = np.empty((len(vectors), first + loads.shape[1]))
    residual[:, :first] = basis.columns[:, modes : modes + first]
    slope = np.empty((residual.shape[1],) * 2)
    slope[:first, :first] = basis.residual_gain[1]
    for part in _blocks(first, residual.shape[1]):
        answer = factor.solve(loads[:, part.start - first : part.stop - first].toarray())
        residual[:, part] = answer - vectors @ (heavy.T @ answer)
        known = slice(0, part.stop)
        slope[known, part] = residual[:, known].T @ basis.group.pencil.apply_mass(residual[:, part])
        slope[part, known] = slope[known, part].T
    both = sp.hstack([sp.csc_array(basis.group.loads), loads], format="csc")
    return replace(
        basis, gain=np.hstack([basis.gain, (loads.T @ vectors).T]), residual_gain=(np.asarray(both.T @ residual), slope)
    )


def _blocks(first: int, last: int) -> Iterator[slice]:
    """Ranges of at most BLOCK numbers from the first to before the last."""
    return (slice(start, min(start + BLOCK, last)) for start in range(first, last, BLOCK))


# -- power -------------------------------------------------------------------------------------------------------------
# Where the patches' power goes: lost in the plate, taken by the finger, lost in the ceramic's dielectric.
# Power in = Re(V* I)/2 with I = j omega (theta' u + C V) summed over the patches. Only the modes are damped: the
# plate loses omega/2 q^H H q, H the loss, the finger takes Re(Z) omega^2 mean |u|^2/2.


@dataclass(frozen=True)
class Power:
    """Means over a period, W per V^2 of drive: power in without dielectric losses, and where it ends.

    dielectric_w: None where the ceramic's tan delta is unknown. apparent_va: sum of |V| |I|/2 over the patches.
    finger_m: rms over the contact of the peak amplitude, m/V.
    """

    patches_w: float
    plate_w: float
    finger_w: float
    dielectric_w: float | None
    apparent_va: float
    finger_m: float

    @property
    def drawn_w(self) -> float | None:
        """Power drawn from a supply that recovers the reactive power, W."""
        return None if self.dielectric_w is None else self.patches_w + self.dielectric_w


def power(touched: TouchedPlate, frequency_hz: float, loss_tangent: float | None) -> Power:
    """Compute the power balance at a frequency, per volt of drive squared.

    Parameters
    ----------
    touched : TouchedPlate
        The plate with the finger.
    frequency_hz : float
        Frequency in Hz.
    loss_tangent : float or None
        Dielectric loss factor tan delta of the ceramic; None where it is unknown.

    Returns
    -------
    Power
        Power in, and the parts that plate, finger and dielectric dissipate.
    """
    plate, count, omega = touched.plate, len(touched.plate.patches), 2.0 * pi * frequency_hz
    eigenvalue = plate.scale.eigenvalue(frequency_hz)
    loads = touched.volts(eigenvalue)
    volts, answer = loads[:count], touched.receptance(eigenvalue) @ loads
    current = 1j * omega * (answer[:count] + plate.capacitance_f * volts)
    modal = 0.0
    for basis in touched.modes:
        amplitudes = basis.amplitudes(eigenvalue, loads)
        modal += float((amplitudes.conj() @ basis.lost_at(eigenvalue) @ amplitudes).real)
    finger = touched.finger
    amplitude = float(np.linalg.norm(touched.contact_motion(frequency_hz)))
    return Power(
        patches_w=0.5 * float((volts.conj() @ current).real),
        plate_w=0.5 * omega * plate.stiffness_unit * modal,
        finger_w=0.5 * finger.tip.resistance_n_s_m(finger.area_m2) * (omega * amplitude) ** 2,
        dielectric_w=None
        if loss_tangent is None
        else 0.5 * omega * loss_tangent * float(plate.capacitance_f @ np.abs(volts) ** 2),
        apparent_va=0.5 * float(np.abs(volts) @ np.abs(current)),
        finger_m=amplitude,
    )


# -- flexibility that reduced panels lack ------------------------------------------------------------------------------
# Static flexibility under a finger that the plate's reduced panels lack. It is their error bar, since no mode beyond the
# band shows it.
# F = N K^-1 N' - E K_r^-1 E': moments of u_z over the contact per moment of its pressure, on a mesh of the panels
# under it, less the same of their reduced matrices, both with the border around these panels clamped (macneal1971).

MESH = HexSettings(order=3, layers=0, through=2)


def missing_flexibility(plate: AssembledPlate, beneath: StaticCorrection, finger: Finger) -> FloatArray | None:
    """Compute the static flexibility F of a finger's moments that the plate's reduced panels lack.

    Parameters
    ----------
    plate : AssembledPlate
        Plate of reduced panels.
    beneath : StaticCorrection
        Its reductions, and the store of corrections already computed.
    finger : Finger
        Contact on the touch face.

    Returns
    -------
    ndarray, shape (moments, moments), or None
        Positive part of F in m/N; None where the panels' pillars have no hexahedral mesh or the factor is too large.

    References
    ----------
    .. [1] macneal1971 (docs/references.bib)
    """
    points, means = _disk_means(finger.degree)
    contact = Contact(np.array(finger.at_m) + finger.radius_m * points, means, back=False)
    box = np.repeat(finger.at_m, 2) + finger.radius_m * np.array([-1.0, 1.0, -1.0, 1.0])
    panels = Panels.beneath(plate.grid, box, beneath.reductions.stack.thickness_m)
    own_box = box - np.repeat(panels.middle_m, 2)

    def more() -> FloatArray:
        reduced = JoinedPanels(panels, plate).flexibility(contact, slice(2, None, 3))
        return positive_part(_fine(panels, beneath.reductions, contact, own_box) - reduced)

    place = repr(
        ([np.round(each, 9).tolist() for each in (panels.span_m, own_box)], panels.clamped, finger.degree, MESH)
    )
    try:
        scaled = beneath.kept(("finger", *beneath.made_of(panels)), place, more)
    except (MeshError, TooLarge):
        return None
    unit = plate.placed_cells[0].cell.scale
    return scaled / (unit.young_pa * unit.length_m)


def _fine(panels: Panels, reductions: Reductions, contact: Contact, box_m: FloatArray) -> FloatArray:
    """N K^-1 N' in the plate's scale."""
    stack = reductions.stack
    settings = HexSettings(MESH.order, stack.thickness_m / MESH.through, MESH.layers)
    stands = panels.stands(reductions.pillar)
    mesh = hex_mesh(bonded_boxes(panels.span_m, stack, stands, box_m, False, settings), MESH.order)
    pencil = constrain(reductions.system(mesh), free_mask(mesh, set(panels.clamped), {}))
    loads = _loads(mesh, contact, panels.middle_m)[np.flatnonzero(pencil.free)]
    return np.asarray(loads.T @ Factoriser()(sp.csc_array(pencil.stiffness)).solve(loads))


def _loads(mesh: Mesh, contact: Contact, middle_m: FloatArray) -> FloatArray:
    """Unit moments of pressure at the nodes of the touch face, (dof, moments)."""
    on = np.flatnonzero(np.abs(mesh.nodes[:, 2]) < SAME_M)
    loads = np.zeros((3 * len(mesh.nodes), len(contact.means)))
    loads[3 * on + 2] = (contact.means @ grid_weights(mesh.nodes[on, :2], mesh.order, contact.points - middle_m)).T
    return loads
