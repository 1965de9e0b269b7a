"""The clamped beams under shaping: one with real patches, the thesis' idealised one, and their matrices to be inverted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import sqrt
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, eigh

from geometry.elements import ComplexArray, FloatArray
from geometry.materials import MATERIALS, PIEZO_MATERIALS, Material, PiezoMaterial
from solvers.analytic.beams import BeamMatrices, End, assemble_beam, beam_mode, deflection_rows, frequency_hz
from solvers.errors import SolverError, check_above_zero
from solvers.shaping.modal_table import ModalTable, calibrate, field_matrix, sensor_matrix
from solvers.shaping.travelling_wave import free_wavelength_m

# -- patched beam ------------------------------------------------------------------------------------------------------
# A beam that carries real piezo patches on one face: actuators, each flanked by a pair of sensor strips.
# Layered Euler-Bernoulli sections (the patches' mass, stiffness and one-sidedness included), uniaxial stress, uniform
# field E_3 = -V/t: T_1 = E_p (S_1 - d31 E_3), so a patch pushes its ends apart with -E_p d31 b V at z_p = (h + t)/2
# and collects the charge -E_p d31 b ([u] - z_p [w']), besides C V. Actuators are voltage driven; sensors are open,
# their wires turned so that stretching gives a positive voltage. Source: ieee176.

CONSTRAINED = {"clamped": (True, True, True), "pinned": (True, True, False), "free": (False, False, False)}  # u, w, w'


LINE = 301  # points along the beam


def evenly(length_m: float, count: int, pitch_m: float | None = None) -> tuple[float, ...]:
    """Place patches evenly about the beam's middle.

    Parameters
    ----------
    length_m : float
        Length of the beam.
    count : int
        Number of patches.
    pitch_m : float, optional
        Distance between neighbours; by default each stands in the middle of an equal share of the length.

    Returns
    -------
    tuple of float
        Centres in m from the left end, ascending.
    """
    pitch = length_m / count if pitch_m is None else pitch_m
    return tuple(float(length_m / 2.0 + (i - (count - 1) / 2.0) * pitch) for i in range(count))


@dataclass(frozen=True)
class PatchedBeam:
    """The beam and its patches, SI. centres_m from the left end; sensor_width_m is that of both strips of a pair.

    quality_factor: the same for every mode, inf for no loss. ends: clamped, pinned or free; the first two hold the middle
    plane.
    """

    length_m: float = 0.150
    width_m: float = 0.020
    thickness_m: float = 1e-3
    material: Material = MATERIALS["steel"]
    piezo: PiezoMaterial = PIEZO_MATERIALS["pz26"]
    centres_m: tuple[float, ...] = field(default_factory=lambda: evenly(0.150, 6))
    patch_length_m: float = 12e-3
    actuator_width_m: float = 12e-3
    sensor_width_m: float = 6e-3
    patch_thickness_m: float = 0.3e-3
    quality_factor: float = 50.0
    ends: tuple[End, End] = ("clamped", "clamped")

    @property
    def lever_m(self) -> float:
        """Distance z_p of the patches' middle from the beam's, m."""
        return (self.thickness_m + self.patch_thickness_m) / 2.0

    @property
    def layer_width_m(self) -> float:
        """Ceramic width across a patched section, m."""
        return self.actuator_width_m + self.sensor_width_m

    @property
    def edges_m(self) -> FloatArray:
        """Both ends of each patch, shape (patches, 2), m."""
        return np.array(self.centres_m)[:, None] + self.patch_length_m / 2.0 * np.array([-1.0, 1.0])

    def capacitance_f(self, width_m: float) -> float:
        """eps33^T (1 - k31^2) b l/t of a patch of this width clamped along x and free across, F."""
        free = float(self.piezo.permittivity_free_f_m[2, 2])
        clamped = free - self.piezo.d31**2 / self.piezo.s11
        return clamped * width_m * self.patch_length_m / self.patch_thickness_m


def section(beam: PatchedBeam, patched: bool) -> tuple[float, float, float, float]:
    """Compute the stiffnesses and the mass of a bare or a patched section.

    Parameters
    ----------
    beam : PatchedBeam
        Beam and patches.
    patched : bool
        Whether the section carries ceramic.

    Returns
    -------
    stretching_n, coupling_n_m, bending_n_m2, mass_kg_m : float
        EA (N), ES (N m) and EI (N m2) about the beam's middle plane, and rho A (kg/m).
    """
    young, area = beam.material.rod(0).young_pa, beam.width_m * beam.thickness_m
    bare = (young * area, 0.0, young * area * beam.thickness_m**2 / 12.0, beam.material.density_kg_m3 * area)
    if not patched:
        return bare
    layer, z, t = beam.layer_width_m * beam.patch_thickness_m, beam.lever_m, beam.patch_thickness_m
    pull = beam.piezo.thin_young_pa * layer
    added = (pull, pull * z, pull * (z**2 + t**2 / 12.0), beam.piezo.density_kg_m3 * layer)
    stretch, couple, bending, mass = (a + b for a, b in zip(bare, added, strict=True))
    return stretch, couple, bending, mass


@dataclass(frozen=True)
class Condensed:
    """The beam over its free (w, w') degrees of freedom alone: K, M; forces (n, a) in N/V, N m/V; signals (s, n) and
    their direct
    part (s, a); charges of the actuators (a, a) at rest in C/V; `rows` gives w at points from the degrees of freedom.
    """

    matrices: BeamMatrices
    free: NDArray[np.intp]
    stiffness: FloatArray
    mass: FloatArray
    forces: FloatArray
    signals: FloatArray
    direct: FloatArray
    capacitance: FloatArray

    def rows(self, points_m: FloatArray) -> FloatArray:
        """w at points from the free degrees of freedom, shape (points, n)."""
        return deflection_rows(self.matrices.nodes_m, points_m)[:, self.free]


def condense(beam: PatchedBeam, element_m: float = 1.5e-3) -> Condensed:
    """Assemble the beam over its free (w, w') degrees of freedom, with open sensors, held ends and static extension.

    Parameters
    ----------
    beam : PatchedBeam
        Beam and patches.
    element_m : float, optional
        Approximate length of the elements; at least two lie between neighbouring edges of patches.

    Returns
    -------
    Condensed
        Matrices, forces per volt, signals and charges.

    Raises
    ------
    SolverError
        If sizes, patches or ends are invalid.
    """
    _check_beam(beam)
    nodes = _nodes(beam, element_m)
    middle = (nodes[1:] + nodes[:-1]) / 2.0
    patched = (np.abs(middle[:, None] - np.array(beam.centres_m)) < beam.patch_length_m / 2.0).any(axis=1)
    matrices = assemble_beam(nodes, np.where(patched[:, None], section(beam, True), section(beam, False)))
    per_width = -beam.piezo.thin_young_pa * beam.piezo.d31
    axial, lateral = _edge_rows(beam, nodes)
    force_u, force_w = (per_width * beam.actuator_width_m * part for part in (axial, lateral))
    sense = per_width * beam.sensor_width_m / np.sqrt(beam.capacitance_f(beam.sensor_width_m))
    sense_u, sense_w = sense * axial, sense * lateral
    free_u, free_w = _free(beam, len(nodes))
    k_uu = (matrices.stretching + sense_u.T @ sense_u)[np.ix_(free_u, free_u)]
    k_uw = (matrices.coupling + sense_u.T @ sense_w)[np.ix_(free_u, free_w)]
    k_ww = (matrices.bending + sense_w.T @ sense_w)[np.ix_(free_w, free_w)]
    factor = cho_factor(k_uu)
    follow, pulled = cho_solve(factor, k_uw), cho_solve(factor, force_u[:, free_u].T)
    output = 1.0 / np.sqrt(beam.capacitance_f(beam.sensor_width_m))
    clamped = beam.capacitance_f(beam.actuator_width_m) * np.eye(len(beam.centres_m))
    return Condensed(
        matrices=matrices,
        free=free_w,
        stiffness=k_ww - k_uw.T @ follow,
        mass=matrices.mass[np.ix_(free_w, free_w)],
        forces=force_w[:, free_w].T - follow.T @ force_u[:, free_u].T,
        signals=output * (sense_w[:, free_w] - sense_u[:, free_u] @ follow),
        direct=output * sense_u[:, free_u] @ pulled,
        capacitance=clamped + force_u[:, free_u] @ pulled,
    )


def beam_table(beam: PatchedBeam, modes: int = 20, points_m: FloatArray | None = None) -> ModalTable:
    """Compute modes, actuator weights, open-circuit sensor voltages and deflection of a patched beam.

    Parameters
    ----------
    beam : PatchedBeam
        Beam and patches.
    modes : int, optional
        Number of modes, from 1 to the number of degrees of freedom.
    points_m : ndarray, shape (p,), optional
        Places of the deflection; by default 301 along the beam.

    Returns
    -------
    ModalTable
        Modes in SI with the static residual of the others; signals in V.

    Raises
    ------
    SolverError
        If the number of modes, a size, a patch or an end is invalid.
    """
    points = np.linspace(0.0, beam.length_m, LINE) if points_m is None else points_m
    body = condense(beam)
    return _table(beam, body, modes, points, body.signals, body.direct)


def charge_table(beam: PatchedBeam, modes: int = 20) -> ModalTable:
    """Return the modal table whose signals are the actuators' own charges.

    Its `sensor_matrix` is the electrical capacitance matrix C(omega) in F.

    Parameters
    ----------
    beam : PatchedBeam
        Beam and patches.
    modes : int, optional
        Number of modes, from 1 to the number of degrees of freedom.

    Returns
    -------
    ModalTable
        Modes in SI with the static residual of the others; signals in C, points at the actuators' centres.

    Raises
    ------
    SolverError
        If the number of modes, a size, a patch or an end is invalid.
    """
    body = condense(beam)
    return _table(beam, body, modes, np.array(beam.centres_m), body.forces.T, body.capacitance)


def _table(
    beam: PatchedBeam, body: Condensed, modes: int, points: FloatArray, signals: FloatArray, direct: FloatArray
) -> ModalTable:
    if not 1 <= modes <= len(body.stiffness):
        raise SolverError(f"modes = {modes}: must be from 1 to {len(body.stiffness)}")
    values, vectors = eigh(body.stiffness, body.mass, subset_by_index=(0, modes - 1))
    actuators, sensors, rows = vectors.T @ body.forces, (signals @ vectors).T, body.rows(points)
    field = (rows @ vectors).T
    residual = np.linalg.solve(body.stiffness, body.forces) - vectors @ (actuators / values[:, None])
    return ModalTable(
        frequencies_hz=np.sqrt(values) / (2.0 * np.pi),
        quality_factor=np.full(modes, beam.quality_factor),
        actuators=actuators,
        sensors=sensors,
        field=field,
        points_m=points[:, None],
        sensor_residual=signals @ residual + direct,
        field_residual=rows @ residual,
    )


def _check_beam(beam: PatchedBeam) -> None:
    """Raise SolverError for sizes that are not above 0, patches that overlap or overhang, unknown or loose ends."""
    for name, value in vars(beam).items():
        if name.endswith("_m") and name != "centres_m":
            check_above_zero(f"beam: {name}", value)
    if not beam.quality_factor > 0.0:
        raise SolverError(f"beam: quality_factor = {beam.quality_factor:g}: must be above 0 (inf for no loss)")
    if not beam.centres_m:
        raise SolverError("beam: the list of actuators is empty, at least one patch is needed")
    if beam.layer_width_m > beam.width_m * (1.0 + 1e-9):
        raise SolverError(f"beam: patches {beam.layer_width_m:g} m wide do not fit on {beam.width_m:g} m")
    edges, slack = beam.edges_m, 1e-9 * beam.length_m
    if edges[0, 0] < -slack or edges[-1, 1] > beam.length_m + slack:
        raise SolverError(
            f"beam: a patch overhangs an end; centres must keep {beam.patch_length_m / 2.0:g} m from both"
        )
    if any(after < before - slack for before, after in pairwise(edges.ravel())):
        raise SolverError(f"beam: patches overlap; centres must ascend by at least {beam.patch_length_m:g} m")
    _check_ends(beam)


def _check_ends(beam: PatchedBeam) -> None:
    for end in beam.ends:
        if end not in CONSTRAINED:
            raise SolverError(f"beam: end {end!r}: must be one of {', '.join(CONSTRAINED)}")
    if "clamped" not in beam.ends and beam.ends != ("pinned", "pinned"):
        raise SolverError(f"beam: ends {beam.ends} leave a rigid-body mode; clamp one or pin both")


def _nodes(beam: PatchedBeam, element_m: float) -> FloatArray:
    cuts = np.unique(np.round([0.0, *np.clip(beam.edges_m, 0.0, beam.length_m).ravel(), beam.length_m], 12))
    parts = [np.linspace(a, b, 1 + max(2, round((b - a) / element_m)))[:-1] for a, b in pairwise(cuts)]
    return np.concatenate([*parts, cuts[-1:]])


def _edge_rows(beam: PatchedBeam, nodes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rows [u] over u, and -z_p [w'] over (w, w'), of each patch: the layer's elongation between its ends."""
    count = len(beam.centres_m)
    axial, lateral = np.zeros((count, 2 * len(nodes) - 1)), np.zeros((count, 2 * len(nodes)))
    for sign, ends in zip((-1.0, 1.0), beam.edges_m.T, strict=True):
        node = np.abs(nodes - ends[:, None]).argmin(axis=1)
        axial[np.arange(count), 2 * node] += sign
        lateral[np.arange(count), 2 * node + 1] -= sign * beam.lever_m
    return axial, lateral


def _free(beam: PatchedBeam, nodes: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Degrees of freedom of u and of (w, w') that the ends leave free."""
    held = np.array([CONSTRAINED[end] for end in beam.ends])
    places = 2 * np.array([[0, 0, 0], [nodes - 1] * 3]) + [0, 0, 1]
    u, w = places[:, 0][held[:, 0]], places[:, 1:][held[:, 1:]]
    return np.setdiff1d(np.arange(2 * nodes - 1), u), np.setdiff1d(np.arange(2 * nodes), w)


# -- idealised beam ----------------------------------------------------------------------------------------------------
# The idealised beam of the thesis: point forces F = K_f V, and sensors that give K_s times the deflection under them.
# T_kj = K_s K_f sum over modes of phi_m(x_k) phi_m(x_j)/(omega_m^2 - omega^2 + i omega omega_m/Q), phi mass-
# normalised: (3.35) with the gains of actuators and sensors kept apart.


def point_beam_table(
    beam: PatchedBeam,
    modes: int = 20,
    force_n_v: float = 1.0,
    sense_v_m: float = 1.0,
    points_m: FloatArray | None = None,
) -> ModalTable:
    """Return the modal table of the bare beam of the same material and ends, with points in place of its patches.

    phi = phi_exact/sqrt(rho A L), phi_exact of mean square 1.

    Parameters
    ----------
    beam : PatchedBeam
        Beam; its patches count by their centres alone.
    modes : int, optional
        Number of modes, 1 or more.
    force_n_v : float, optional
        Actuator gain K_f, N/V.
    sense_v_m : float, optional
        Sensor gain K_s, V/m.
    points_m : ndarray, shape (p,), optional
        Places of the deflection; by default 301 along the beam.

    Returns
    -------
    ModalTable
        Exact modes in SI, without a residual.

    Raises
    ------
    SolverError
        If no place is given or one is off the beam, modes < 1, or ends are unknown or leave a rigid-body mode.
    """
    places = np.array(beam.centres_m)
    if not places.size:
        raise SolverError("beam: the list of actuators is empty, at least one place is needed")
    if (places < 0.0).any() or (places > beam.length_m).any():
        raise SolverError(f"beam: places must lie from 0 to {beam.length_m:g} m")
    _check_ends(beam)
    if modes < 1:
        raise SolverError(f"modes = {modes}: must be 1 or more")
    points = np.linspace(0.0, beam.length_m, LINE) if points_m is None else points_m
    _, _, bending, mass = section(beam, False)
    left, right = beam.ends
    shapes = [beam_mode(left, right, number) for number in range(1, modes + 1)]
    unit = 1.0 / sqrt(mass * beam.length_m)
    at_places = unit * np.stack([shape.shape(places / beam.length_m) for shape in shapes])
    return ModalTable(
        frequencies_hz=frequency_hz(np.array([shape.kappa for shape in shapes]), beam.length_m, bending, mass),
        quality_factor=np.full(modes, beam.quality_factor),
        actuators=force_n_v * at_places,
        sensors=sense_v_m * at_places,
        field=unit * np.stack([shape.shape(points / beam.length_m) for shape in shapes]),
        points_m=np.asarray(points)[:, None],
    )


# -- under shaping -----------------------------------------------------------------------------------------------------
# One beam under shaping: its table over a line of points and over the sensors' places, and the matrices to be inverted.

Signal = Literal["calibrated", "displacement"]


@dataclass(frozen=True)
class ShapedBeam:
    """A beam by name; table: points are 301 along the beam and then the sensors' places; calibration: its sensors' factors in
    m/V, as found on the mode `calibrated_on`, or None.

    Signals: `calibrated`, the sensors' voltages times their factor, as a controller sees them; `displacement`, as a laser
    would measure under them.
    """

    name: str
    beam: PatchedBeam
    table: ModalTable
    calibration: ComplexArray | None = None
    calibrated_on: int = 0

    @property
    def line_m(self) -> FloatArray:
        """The points along the beam, m, shape (301,)."""
        return np.asarray(self.table.points_m[:LINE, 0])

    @property
    def places_m(self) -> FloatArray:
        """Centres of the sensors, m, shape (s,)."""
        return np.asarray(self.table.points_m[LINE:, 0])

    @property
    def signals(self) -> tuple[Signal, ...]:
        """Signals of this beam."""
        return ("displacement",) if self.calibration is None else ("calibrated", "displacement")

    def matrix(self, frequency_hz: float, signal: Signal) -> ComplexArray:
        """T in m/V for a signal, shape (s, a); SolverError as receptance, or for a calibration there is none of."""
        if signal == "displacement":
            return field_matrix(self.table, frequency_hz)[LINE:]
        if self.calibration is None:
            raise SolverError(f"{self.name}: its sensors are not calibrated")
        return np.asarray(self.calibration[:, None] * sensor_matrix(self.table, frequency_hz))

    def field(self, frequency_hz: float) -> ComplexArray:
        """Displacement along the beam per volt, m/V, shape (301, a)."""
        return field_matrix(self.table, frequency_hz)[:LINE]

    def free_wavelength_m(self, frequency_hz: float) -> float:
        """Wavelength of a free wave on the bare beam, m."""
        _, _, bending, mass = section(self.beam, False)
        return free_wavelength_m(frequency_hz, bending, mass)


def patched(name: str, beam: PatchedBeam, modes: int, calibrate_near_hz: float) -> ShapedBeam:
    """Return the beam with its real patches and calibrated sensors.

    The sensors are calibrated on the mode nearest to a frequency among those that have no sensor on a node.

    Parameters
    ----------
    name : str
        Name in results and messages.
    beam : PatchedBeam
        Beam and patches.
    modes : int
        Number of modes of the table.
    calibrate_near_hz : float
        Frequency of the standing wave for the calibration.

    Returns
    -------
    ShapedBeam
        Beam with a calibration.

    Raises
    ------
    SolverError
        If some sensor sits on a node in every mode.
    """
    table = beam_table(beam, modes, _points(beam))
    places = part_of(table, slice(LINE, None))
    for mode in np.argsort(np.abs(table.frequencies_hz - calibrate_near_hz), kind="stable"):
        try:
            calibration = calibrate(*_standing_wave(places, int(mode)))
        except SolverError:
            continue  # a sensor on a node of this mode: the next one
        return ShapedBeam(name, beam, table, calibration, int(mode))
    raise SolverError(f"{name}: on every mode some sensor sits on a node, none can be calibrated")


def pointed(name: str, beam: PatchedBeam, modes: int) -> ShapedBeam:
    """Return the bare beam with point forces and deflection sensors at the same places.

    Parameters
    ----------
    name : str
        Name in results and messages.
    beam : PatchedBeam
        Beam; its patches count by their centres alone.
    modes : int
        Number of modes of the table.

    Returns
    -------
    ShapedBeam
        Beam without a calibration: its only signal is the displacement.
    """
    return ShapedBeam(name, beam, point_beam_table(beam, modes, points_m=_points(beam)))


def _standing_wave(places: ModalTable, mode: int) -> Iterator[ComplexArray]:
    """Readings of laser and sensors at a mode's frequency, 1 to 10 V on the actuator that drives it most."""
    actuator, frequency = int(np.argmax(np.abs(places.actuators[mode]))), float(places.frequencies_hz[mode])
    for matrix in (field_matrix, sensor_matrix):
        yield np.linspace(1.0, 10.0, 10)[:, None] * matrix(places, frequency)[:, actuator]


def part_of(table: ModalTable, points: slice) -> ModalTable:
    """Restrict a modal table to some of its points.

    Parameters
    ----------
    table : ModalTable
        Table to restrict.
    points : slice
        Points that remain.

    Returns
    -------
    ModalTable
        Table with the same modes, actuators and sensors.
    """
    residual = None if table.field_residual is None else table.field_residual[points]
    return replace(table, field=table.field[:, points], points_m=table.points_m[points], field_residual=residual)


def _points(beam: PatchedBeam) -> FloatArray:
    return np.concatenate([np.linspace(0.0, beam.length_m, LINE), beam.centres_m])
