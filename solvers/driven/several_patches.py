"""Several patches on one plate: zones driven in turn, the flow of power, and the modal table for shaping."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, product
from math import pi
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.driven.curve_bars import Doubts, rms, rms_bars, with_peak
from solvers.errors import SolverError
from solvers.measures.confinement import peak_hz, ratio_db, target_shape, zone_parts
from solvers.piezo.forced import ForcedPlate, GroupModes
from solvers.piezo.patched_plate import Group, PatchedPlate
from solvers.piezo.responses import face_motion, resonances_hz
from solvers.shaping.modal_table import ModalTable
from solvers.superelement.bond import mirror_signs
from solvers.superelement.plate import WHOLE

FLIPS = list(product((1.0, -1.0), repeat=2))  # of a panel in x, y >= 0 onto its images

# -- zones -------------------------------------------------------------------------------------------------------------
# Several zones of one plate: the motion of every zone while one of them is driven.
# Integrals of u_z^2 over one zone couple symmetry classes: in the quarter's points the motion at an image is the sum
# of the classes, each with the signs of its mirrors, and a zone takes from every image the part in the zone.


@dataclass(frozen=True)
class Zones:
    """A driven plate's zones: rms of u_z over each and over the passive face, from Gram matrices over all columns, per m2.

    grams (zones + 1, columns, columns): the last is the passive face's; its area may be 0, and its mean then NaN. shapes
    (zones, columns): means of u_z times the target shape of root mean square 1.
    """

    forced: ForcedPlate
    grams: FloatArray
    shapes: FloatArray

    def rms(self, volts: FloatArray, frequency_hz: FloatArray) -> FloatArray:
        """rms of |u_z|, (n, zones + 1), m per volt, of patches fed with volts (patches,)."""
        a = self._amplitudes(volts, frequency_hz)
        return np.sqrt(np.maximum(np.einsum("it,zit->tz", a.conj(), self.grams @ a).real, 0.0))

    def mac(self, volts: FloatArray, frequency_hz: float, zone: int) -> float:
        """MAC of a zone's motion with the target shape."""
        a = self._amplitudes(volts, np.array([frequency_hz]))[:, 0]
        return float(abs(self.shapes[zone] @ a) ** 2 / (a.conj() @ self.grams[zone] @ a).real)

    def _amplitudes(self, volts: FloatArray, frequency_hz: FloatArray) -> ComplexArray:
        """Coefficients of the columns at every frequency, (columns, n)."""
        plate = self.forced.driven_by(np.asarray(volts, dtype=complex))
        at = plate.plate.scale.eigenvalue(frequency_hz)
        fed = plate.volts_over(at)
        return np.concatenate([basis.amplitudes(at, fed) for basis in plate.modes], axis=1).T

    @property
    def has_passive(self) -> bool:
        """Whether something of the touch face lies in no zone."""
        return not bool(np.isnan(self.grams[-1]).any())

    def peak_hz(self, volts: FloatArray, zone: int) -> float:
        """Frequency of the zone's largest motion within the band, Hz."""
        forced = self.forced
        return peak_hz(
            lambda tones: self.rms(volts, tones)[:, zone],
            resonances_hz(forced),
            forced.band_hz,
            forced.loss_at(sum(forced.band_hz) / 2.0),
        )


def zones_of(forced: ForcedPlate) -> Zones:
    """Integrate the columns of a patched plate over its zones.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.

    Returns
    -------
    Zones
        Means over each zone and over the rest, and the projections on the zones' target shapes.
    """
    design, fields = forced.design, [basis.group.touch(basis.columns) for basis in forced.modes]
    first = fields[0][0]
    whole = forced.modes[0].group.symmetries == (WHOLE,)
    flips = np.array([(1.0, 1.0)] if whole else FLIPS)
    count = sum(basis.columns.shape[1] for basis in forced.modes)
    views = design.views
    grams, areas = np.zeros((len(views) + 1, count, count)), np.zeros(len(views) + 1)
    shapes, norms = np.zeros((len(views), count)), np.zeros(len(views))
    for flip in flips:
        values = np.hstack(
            [
                _at_image(basis.group, [field.values for field in own], flip)
                for basis, own in zip(forced.modes, fields, strict=True)
            ]
        )
        weights = first.weights / len(flips)
        points = first.points * flip
        for place, part in enumerate(zone_parts(design, points)):
            grams[place] += values[part].T @ (weights[part, None] * values[part])
            areas[place] += weights[part].sum()
            if place < len(views):
                target = target_shape(views[place], points[part])
                shapes[place] += (weights[part] * target) @ values[part]
                norms[place] += weights[part] @ target**2
    known = areas > 1e-9 * areas.max()
    with np.errstate(divide="ignore", invalid="ignore"):
        means = np.where(known[:, None, None], grams / areas[:, None, None], np.nan)
    return Zones(forced, means, shapes / np.sqrt(norms * areas[:-1])[:, None])


def _at_image(group: Group, fields: Sequence[FloatArray], flip: FloatArray) -> FloatArray:
    """A group's fields at the image of their points, (n, columns): a sum of the classes, each with the sign of its mirrors."""
    signs = [mirror_signs(symmetry, flip)[2] for symmetry in group.symmetries]
    return np.sum([sign * values for sign, values in zip(signs, fields, strict=True)], axis=0)


def zone_volts(forced: ForcedPlate, centres_m: FloatArray) -> FloatArray:
    """Choose the voltages that drive one zone each: its own drivers at +-1 V in phase with the target shape.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its drivers.
    centres_m : ndarray, shape (patches, 2)
        Centres of the patches.

    Returns
    -------
    ndarray, shape (zones, patches)
        In V.
    """
    design = forced.design
    volts = np.zeros((len(design.views), len(centres_m)))
    for zone, view in enumerate(design.views):
        own = [i for i in forced.drivers if view.in_zone(centres_m[[i]])[0]]
        volts[zone, own] = np.where(target_shape(view, centres_m[own]) < 0.0, -1.0, 1.0)
    return volts


def curve_half_widths(zones: Zones, volts: FloatArray, frequency_hz: FloatArray, known: Doubts | None) -> FloatArray:
    """Error bars (half-widths) of every zone's rms while each is driven.

    Parameters
    ----------
    zones : Zones
        The zones of a driven plate.
    volts : ndarray, shape (driven, patches)
        Voltages that drive one zone each.
    frequency_hz : ndarray, shape (n,)
        Frequencies in Hz.
    known : Doubts or None
        Uncertainties of the plate's resonances and loads.

    Returns
    -------
    ndarray, shape (driven, zones, n)
        In m/V; NaN without an estimate.
    """
    forced, count = zones.forced, len(zones.shapes)
    if known is None:
        return np.full((len(volts), count, len(frequency_hz)), np.nan)

    return rms_bars(known, forced, zones.grams[:count], frequency_hz, volts[:, forced.drivers].astype(complex))


def peak_half_widths(zones: Zones, fed: FloatArray, zone: int, peak_hz: float, known: Doubts | None) -> dict[str, Any]:
    """Compute the error bars of one driven zone's figures at its peak.

    Parameters
    ----------
    zones : Zones
        Integrals over the zones.
    fed : ndarray, shape (patches,)
        Voltages of the patches, in V.
    zone : int
        Number of the driven zone.
    peak_hz : float
        Frequency of the peak.
    known : Doubts or None
        Uncertainties of the plate; None without an estimate.

    Returns
    -------
    dict
        Half-widths by name: `rms_error_m_per_V` and `level_error_db` (zones,), `passive_error_db`, `mac_error`; NaN
        if unknown.
    """
    forced, count = zones.forced, len(zones.shapes)
    parts = count + zones.has_passive
    grams = np.concatenate([zones.grams[:parts], [np.outer(zones.shapes[zone], zones.shapes[zone])]])

    def figures(squares: ComplexArray) -> FloatArray:
        each = rms(squares)
        return np.concatenate([each[:-1], ratio_db(each[:-1], each[zone]), each[-1:] ** 2 / each[zone] ** 2])

    half = np.full(2 * parts + 1, np.nan)
    if known is not None:
        half = with_peak(known, forced, grams, peak_hz, fed[forced.drivers].astype(complex), figures)
    return {
        "rms_error_m_per_V": half[:count],
        "level_error_db": half[parts : parts + count],
        "passive_error_db": float(half[parts + count]) if zones.has_passive else None,
        "mac_error": float(half[-1]),
    }


# -- power flow --------------------------------------------------------------------------------------------------------
# Path of the patches' power along a driven plate: the flow through a section x, and the losses on the way.
# Power in = Re(V* I)/2 patch by patch with I = j omega (theta' u + C V). Only the modes are damped, in proportion to
# their strain: a panel loses omega/(2 Q) u' K u of their motion u, a patch on it likewise. Modes extrapolated from
# two meshes of the patches store L = diag(eigenvalues), not the U' K U of the finer mesh: u = U S q with S' (U' K U)
# S = L, so that the total loss is that of the modes, omega/(2 Q) q' L q. The flow through a section is
# the input to the left of it less the losses there: it ends at 0 beyond the last patch.


@dataclass(frozen=True)
class PowerFlow:
    """Means over a period, W: power from each patch (patches,), negative if it absorbs; the flow towards +x (n,) through the
    sections x_m (n,) that no patch straddles; losses of the plate and its patches.
    """

    patches_w: FloatArray
    x_m: FloatArray
    flow_w: FloatArray
    lost_w: float


Turned = Callable[
    [GroupModes, FloatArray], FloatArray
]  # values of a group's modes (..., modes) in those of a plate varied


def _as_solved(_: GroupModes, values: FloatArray) -> FloatArray:
    return values


@dataclass(frozen=True)
class Strains:
    """Strain energies u' K u between the solved modes of a driven plate, scaled, group after group.

    x_m (n,): sections that no patch straddles; left (n + 1, modes, modes): of what lies left of each, and of the whole plate;
    roots: A^(-1/2) (k, k) of each group's stiffness A between its modes, none of them rigid; turned: how the modes of a
    plate within its error bars differ (`Variation.of_columns`).
    """

    x_m: FloatArray
    left: FloatArray
    roots: list[FloatArray]
    turned: Turned = _as_solved

    def of(self, forced: ForcedPlate, eigenvalue: float, volts: ComplexArray) -> FloatArray:
        """Energies (n + 1,) of the modes' motion: modes U T of a plate within its error bars move as U A^(-1/2) T L^(1/2) q."""
        motion = []
        for basis, root in zip(forced.modes, self.roots, strict=True):
            damped = basis.amplitudes(eigenvalue, volts)[: len(root)] * np.sqrt(basis.eigenvalue)
            motion.append(self.turned(basis, root) @ damped)
        at_once = np.concatenate(motion)
        return np.asarray(((self.left @ at_once) @ at_once.conj()).real)


def power_flow(forced: ForcedPlate, frequency_hz: float, strains: Strains | None = None) -> PowerFlow:
    """Compute the flow of power along a driven plate (`ForcedPlate.driven_by`) through sections at the edges of its panels.

    Parameters
    ----------
    forced : ForcedPlate
        A plate whose patches drive it.
    frequency_hz : float
        Frequency of the drive.
    strains : Strains, optional
        `strains_of` the plate, or of the one of which it is a variation, if known.

    Returns
    -------
    PowerFlow
        Power per patch, sections in m, the flow through each and the total loss in W.

    Raises
    ------
    SolverError
        For a plate without patches.
    """
    plate = _patched(forced)
    known = strains_of(forced) if strains is None else strains
    eigenvalue, omega = plate.scale.eigenvalue(frequency_hz), 2.0 * pi * frequency_hz
    volts = forced.volts(eigenvalue)
    charge = np.sum([basis.receptance(eigenvalue) for basis in forced.modes], axis=0) @ volts
    current = 1j * omega * (charge * plate.stiffness_unit + plate.capacitance_f * volts)
    given = 0.5 * (volts.conj() * current).real
    loss = forced.loss_at(frequency_hz)
    *left, lost = 0.5 * omega * loss * plate.stiffness_unit * known.of(forced, eigenvalue, volts)
    ends = _spans(plate)[:, 1]
    flow = [given[ends <= edge + 1e-9].sum() - before for edge, before in zip(known.x_m, left, strict=True)]
    return PowerFlow(given, known.x_m, np.array(flow), float(lost))


def strains_of(forced: ForcedPlate) -> Strains:
    """Integrate the strain energies between the modes of a driven plate, section by section.

    In mirrored coordinates a panel's image moves as the sum of the classes, each with the sign of its mirrors; a panel on a
    mirror line is its own image, and its share is counted at both.

    Parameters
    ----------
    forced : ForcedPlate
        A plate whose patches drive it.

    Returns
    -------
    Strains
        Energies left of every section.

    Raises
    ------
    SolverError
        For a plate without patches.
    """
    plate = _patched(forced)
    modes = [basis.columns[:, : len(basis.frequency_hz)] for basis in forced.modes]
    spans = _spans(plate)
    edges = np.unique(np.round(forced.modes[0].group.plates[0].tiling.x, 12))
    sections = edges[~((spans[:, :1] < edges) & (edges < spans[:, 1:])).any(axis=0)]
    ends, count = np.append(sections, np.inf), sum(own.shape[1] for own in modes)
    left = np.zeros((len(ends), count, count))
    for x, moved, stiffness in chain(_panels(forced, modes), _on_patches(forced, modes)):
        left[x < ends] += moved.T @ np.asarray(stiffness @ moved)
    return Strains(sections, left, [_root(basis, own) for basis, own in zip(forced.modes, modes, strict=True)])


def _patched(forced: ForcedPlate) -> PatchedPlate:
    if not isinstance(forced.plate, PatchedPlate):
        raise SolverError("a power flow along the plate needs patches that drive it")
    return forced.plate


def _spans(plate: PatchedPlate) -> FloatArray:
    """Ends of each patch along x, (patches, 2), m."""
    return np.array([(patch.points[:, 0].min(), patch.points[:, 0].max()) for patch in plate.patches])


def _root(basis: GroupModes, modes: FloatArray) -> FloatArray:
    """A^(-1/2) of the group's stiffness between its modes."""
    meshed = modes.T @ np.asarray(basis.group.pencil.stiffness @ modes)
    values, vectors = np.linalg.eigh((meshed + meshed.T) / 2.0)
    return np.asarray((vectors / np.sqrt(values)) @ vectors.T)


def _panels(forced: ForcedPlate, modes: list[FloatArray]) -> Iterator[tuple[float, FloatArray, FloatArray]]:
    """Every panel of the whole plate: its middle x, the motion (dof, modes) of its share, and its stiffness."""
    split = [(basis.group, basis.group.split(own)) for basis, own in zip(forced.modes, modes, strict=True)]
    first = split[0][0].plates[0]
    flips = np.array([(1.0, 1.0)] if first.symmetry == WHOLE else FLIPS)
    for number, placed in enumerate(first.placed_cells):
        fields = [
            [
                plate.cell_vectors(plate.placed_cells[number], own)
                for plate, own in zip(group.plates, parts, strict=True)
            ]
            for group, parts in split
        ]
        share = np.sqrt(placed.copies / len(flips))
        for flip in flips:
            moved = [_at_image(group, own, flip) for (group, _), own in zip(split, fields, strict=True)]
            yield flip[0] * placed.middle[0], share * np.hstack(moved), placed.cell.stiffness


def _on_patches(forced: ForcedPlate, modes: list[FloatArray]) -> Iterator[tuple[float, FloatArray, Any]]:
    """Every patch: its middle x, the motion (dof, modes) of its bonded face, and its stiffness."""
    plate = _patched(forced)
    for number, (bond, span) in enumerate(zip(plate.bonds, _spans(plate), strict=True)):
        pairs = zip(forced.modes, modes, strict=True)
        moved = np.hstack([plate.motion(basis.group.plates, number) @ own for basis, own in pairs])
        yield span.mean(), moved, bond.finest.stiffness


# -- modal table -------------------------------------------------------------------------------------------------------
# A driven plate's own modes as the table that shaping works on: sensors open, drivers fed by voltages.
# With E = C + R_ss (clamped capacitance and quasi-static residual of the sensors) and modes r of the plate with
# closed circuits, gains g_rp = phi_r' theta_p, open sensors stiffen the modes: (diag(lambda) + g_s E^-1 g_s') x = mu
# x. The damping that couples the modes mu is left out, of the order of the electromechanical coupling over Q. u_z and
# u_s then follow from V_s = -E^-1 (R_sd V_d + g_s' q); residuals are those at one frequency.


def plate_table(
    forced: ForcedPlate, points_m: FloatArray, frequency_hz: float, rows: list[FloatArray] | None = None
) -> ModalTable:
    """Build the modal table of a plate over points of the touch face, in SI, with the residuals at a frequency.

    Actuators are the drivers in the order of `forced.drivers`; sensors are in V.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes around the band.
    points_m : ndarray, shape (p, 2)
        Points of the touch face.
    frequency_hz : float
        Frequency of the residuals.
    rows : list of ndarray, optional
        `motion_at` of the points, shape (p, columns), if known.

    Returns
    -------
    ModalTable
        Modes of 1 kg, actuators, sensors and field.

    Raises
    ------
    SolverError
        For drivers that hold a charge, or without sensors.
    """
    if forced.circuit != "short" or not forced.sensors:
        raise SolverError("shaping needs voltage-driven actuators and at least one sensor patch")
    plate, d, s = forced.plate, forced.drivers, forced.sensors
    scale, unit = plate.scale, plate.stiffness_unit
    eigenvalue = scale.eigenvalue(frequency_hz)
    values = np.concatenate([basis.eigenvalue for basis in forced.modes])
    gain = np.concatenate([basis.gain for basis in forced.modes])
    residual = np.sum([basis.residual(eigenvalue) for basis in forced.modes], axis=0)
    moves, beyond = _motion(forced, motion_at(forced, points_m) if rows is None else rows, eigenvalue)
    clamped = np.diag(plate.capacitance_f[s]) / unit + residual[np.ix_(s, s)]
    heard = np.linalg.solve(clamped, gain[:, s].T)  # -V_s per modal coordinate, (sensors, modes)
    at_once = np.linalg.solve(clamped, residual[np.ix_(s, d)])  # -V_s per volt of a driver
    mu, vectors = np.linalg.eigh(np.diag(values) + gain[:, s] @ heard)
    dissipated = np.einsum("rm,r,rm->m", vectors, values * forced.losses, vectors)
    size = 1.0 / np.sqrt(scale.mass_kg)  # of a mode of 1 kg
    return ModalTable(
        frequencies_hz=np.asarray(scale.frequency(mu)),
        quality_factor=np.asarray(mu / dissipated),
        actuators=vectors.T @ (gain[:, d] - heard.T @ residual[np.ix_(s, d)]) * scale.angular**2 / size,
        sensors=-(vectors.T @ heard.T) * size,
        field=vectors.T @ (moves - beyond[:, s] @ heard).T * size,
        points_m=points_m,
        sensor_residual=-at_once,
        field_residual=beyond[:, d] - beyond[:, s] @ at_once,
    )


def motion_at(forced: ForcedPlate, points_m: FloatArray) -> list[FloatArray]:
    """Compute u_z at points of the touch face per unit of each column.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.
    points_m : ndarray, shape (p, 2)
        Points of the touch face.

    Returns
    -------
    list of ndarray, shape (p, columns)
        One per group.
    """
    return [np.asarray(face_motion(basis.group, points_m) @ basis.columns) for basis in forced.modes]


def _motion(forced: ForcedPlate, known: list[FloatArray], eigenvalue: float) -> tuple[FloatArray, FloatArray]:
    """u_z at points per modal coordinate, (points, modes), and per volt beyond the modes, (points, patches)."""
    moves, beyond = [], np.zeros((len(known[0]), len(forced.plate.patches)))
    for basis, rows in zip(forced.modes, known, strict=True):
        count, patches = len(basis.frequency_hz), beyond.shape[1]
        moves.append(rows[:, :count])
        residual, slope = rows[:, count : count + patches], rows[:, count + patches :]
        beyond += residual + (eigenvalue - basis.middle) * slope
    return np.hstack(moves), beyond
