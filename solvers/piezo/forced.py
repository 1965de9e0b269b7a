"""Forced response of a patched plate by modal superposition with a quasi-static residual.

u(w) = sum_r phi_r phi_r' theta V / (lambda_r (1 + i/Q_r) - lambda) + [R + (lambda - lambda_0) R1] V, where R is
(K - lambda_0 M)^-1 theta less the same modes at lambda_0 and R1 = (K - lambda_0 M)^-1 M R: the part outside the band
follows by two terms about its middle. Sensor patches are open, Q_s = 0; actuators hold their voltage (short) or their
charge (open).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, Self

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from geometry.layout import Design
from geometry.supports import has_dampers
from solvers.errors import SolverError
from solvers.fem.assembly import Scale
from solvers.fem.eigen import Shared, factor_near, modes_in_band
from solvers.fem.factor import Factor, Factoriser, parallel_map
from solvers.fem.missing_mode import largest_outside
from solvers.fem.surface import Skin
from solvers.measures.confinement import TouchField, strength_force, target_symmetry
from solvers.measures.radiation import Air, air_loss_factors, level_db, pressure_pa
from solvers.measures.target_mode import NONE, Found, Interval, Verdict, search, verdict
from solvers.piezo.patched_plate import BondErrors, Group, PatchedPlate, PressedPlate, extrapolated_modes
from solvers.superelement.moduli import Moduli
from solvers.superelement.plate import WHOLE

MARGIN = (0.75, 1.3)  # of the band's ends: modes within are summed, the others are in the residual
ROWS = 4096  # points of the touch face at once: a share of a field is copied, not all of it
SOUND_AT_M = 0.5  # before the middle of the touch face
LOSS = 0.01  # width of a curve's grid where there is no mode
SAME = 1e-10  # of the largest: directions of the columns that are combinations of the others
SETTLING = 60  # passes to the moduli at a mode's own frequency: of one that rises with f itself, each halves the rest
MIXED = 0.3  # of the distance of two modes: a coupling beyond it is not small
ROUNDING = 1e-13  # relative
# l_s / (l_s - l_r) of a mode r at the end of the band and the nearest mode s that is not summed
NEAREST = 1.0 / (1.0 - MARGIN[1] ** -2)
COUNTS = 1e-6  # of the largest load: a patch below it stands on a nodal line


@dataclass(frozen=True, eq=False)
class GroupModes:
    """Modes of a group with the loads' projections: columns [modes, R, R1], eigenvalues and gains (modes, patches).

    bond: uncertainty due to the mesh beneath the patches; None without a coarser mesh. images: K and M times the
    modes, (dof, modes) each. loss (modes,): 1/Q of each mode; lost (c, c): scaled loss between the columns, None where one
    quality factor stands for all losses, which then damps the modes alone. radiated (modes,): the part of `loss` that the
    air takes. parted: what moduli at other frequencies change; the modes' frequencies and losses then have their own, their
    eigenvalues those of the reduction.
    """

    group: Group
    frequency_hz: FloatArray
    eigenvalue: FloatArray
    gain: FloatArray
    columns: FloatArray
    middle: float
    residual_gain: tuple[FloatArray, FloatArray]
    images: tuple[FloatArray, FloatArray]
    bond: BondErrors | None = None
    loss: FloatArray = field(default_factory=lambda: np.zeros(0))
    radiated: FloatArray = field(default_factory=lambda: np.zeros(0))
    lost: FloatArray | None = None
    parted: Parted | None = None

    def amplitudes(self, eigenvalue: float | FloatArray, volts: ComplexArray) -> ComplexArray:
        """Coefficients (..., columns) at eigenvalues (...) (scaled frequency squared), per voltages (..., patches)."""
        at = np.asarray(eigenvalue)[..., None]
        if self.parted is not None:
            return self._answers(at[..., 0], volts @ self.loads.T)
        if self.lost is not None:
            values, vectors = self._damped
            return np.asarray((volts @ (self.loads.T @ vectors) / (values - at)) @ vectors.T)
        return np.concatenate(
            [volts @ self.gain.T * self.flexibility(eigenvalue), volts, (at - self.middle) * volts], -1
        )

    def touched(self, eigenvalue: float, volts: ComplexArray) -> list[tuple[str, TouchField, ComplexArray]]:
        """Each symmetry class of the group with its field on the touch face and the complex u_z there, (q,) in m."""
        moved = self.columns @ self.amplitudes(eigenvalue, volts)
        fields = self.group.touch(np.column_stack([moved.real, moved.imag]))
        return [
            (symmetry, face, face.values @ np.array([1.0, 1.0j]))
            for symmetry, face in zip(self.group.symmetries, fields, strict=True)
        ]

    @property
    def has_one_loss(self) -> bool:
        """Whether one quality factor stands for all losses, and the moduli are constant."""
        return self.lost is None and self.parted is None

    @property
    def lossy(self) -> ComplexArray:
        """lambda_r (1 + i/Q_r), (modes,)."""
        return np.asarray(self.eigenvalue * (1.0 + 1j * self.loss))

    @property
    def loads(self) -> FloatArray:
        """Loads (c, patches) in the columns; the modes' own are extrapolated."""
        return np.vstack([self.gain, self.columns[:, len(self.eigenvalue) :].T @ self.group.loads])

    @cached_property
    def _damped(self) -> tuple[ComplexArray, ComplexArray]:
        """Eigenvalues (m,) of K + i H and M in the columns, H their loss, and vectors X (c, m) with X'M X = 1."""
        assert self.lost is not None
        stiffness, mass = self.projected
        whiten = whitened(mass)
        values, turn = np.linalg.eig(whiten.T @ (stiffness + 1j * self.lost) @ whiten)
        return values, np.asarray(whiten @ (turn / np.sqrt((turn**2).sum(axis=0))))

    @cached_property
    def damping(self) -> FloatArray:
        """Loss (c, c) between the columns, scaled: of the modes alone where one quality factor stands for all."""
        if self.lost is not None:
            return self.lost
        own = self.group.pencil.scale.eigenvalue(self.frequency_hz) * self.loss
        return np.diag(np.append(own, np.zeros(self.columns.shape[1] - len(own))))

    def lost_at(self, eigenvalue: float) -> FloatArray:
        """Loss (c, c) between the columns with the moduli at an eigenvalue, scaled."""
        return self.damping if self.parted is None else self.damping + self.parted.change(eigenvalue).imag

    @cached_property
    def _whitened(self) -> tuple[FloatArray, ComplexArray, FloatArray]:
        """M-orthonormal directions W (c, m) of the columns, K + i H in them, (m, m), and the parts of the materials."""
        assert self.parted is not None
        stiffness, mass = self.projected
        whiten = whitened(mass)
        parts = whiten.T @ self.parted.parts @ whiten
        return whiten, np.asarray(whiten.T @ (stiffness + 1j * self.damping) @ whiten), parts

    def _answers(self, at: FloatArray, forces: ComplexArray) -> ComplexArray:
        """(K + i H - lambda M)^-1 in the columns, with the moduli at eigenvalues at (...), of forces (..., c)."""
        assert self.parted is not None
        whiten, stiffness, parts = self._whitened
        own = forces @ whiten
        own = np.array(
            np.broadcast_to(own, np.broadcast_shapes(own.shape, (*at.shape, whiten.shape[1]))), dtype=complex
        )
        for place in np.ndindex(at.shape):
            value = float(at[place])
            changed = stiffness + np.tensordot(self.parted.steps(value), parts, 1) - value * np.eye(len(stiffness))
            here = (..., *place, slice(None))
            own[here] = np.linalg.solve(changed, own[here].reshape(-1, len(changed)).T).T.reshape(own[here].shape)
        return np.asarray(own @ whiten.T)

    def flexibility(self, eigenvalue: float | FloatArray) -> ComplexArray:
        """1 / (lambda_r (1 + i/Q_r) - lambda) of each mode by itself at eigenvalues lambda (...), (..., modes)."""
        if self.parted is not None:
            return self.parted.flexibility(self, np.asarray(eigenvalue, dtype=float))
        return np.asarray(1.0 / (self.lossy - np.asarray(eigenvalue)[..., None]))

    def receptance(self, eigenvalue: float | FloatArray) -> ComplexArray:
        """theta' u per volt at eigenvalues (...), (..., patches, patches), scaled."""
        if self.parted is not None:
            loads = self.loads.T.astype(complex)
            forces = np.broadcast_to(loads, (*np.shape(eigenvalue), *loads.shape))
            moved = self._answers(np.asarray(eigenvalue), np.moveaxis(forces, -2, 0)) @ self.loads
            return np.moveaxis(moved, 0, -2)
        if self.lost is not None:
            values, vectors = self._damped
            gain = self.loads.T @ vectors
            return np.asarray((gain / (values - np.asarray(eigenvalue)[..., None, None])) @ gain.T)
        modal = self.flexibility(eigenvalue)[..., None] * self.gain
        return np.asarray(self.gain.T @ modal + self.residual(eigenvalue))

    @cached_property
    def projected(self) -> tuple[FloatArray, FloatArray]:
        """K and M in the columns, (c, c) each: modes are orthogonal, so that only the loads' part is multiplied."""
        own, pencil = len(self.eigenvalue), self.group.pencil
        more = self.columns[:, own:]
        parts = []
        for diagonal, image in (
            (self.eigenvalue, np.asarray(pencil.stiffness @ more)),
            (np.ones(own), pencil.apply_mass(more)),
        ):
            beside, within = self.columns[:, :own].T @ image, more.T @ image
            parts.append(np.block([[np.diag(diagonal), beside], [beside.T, (within + within.T) / 2.0]]))
        return parts[0], parts[1]

    def residual(self, eigenvalue: float | FloatArray) -> FloatArray:
        """Part of the modes beyond the band in the receptance at eigenvalues (...), (..., patches, patches), scaled."""
        away = np.asarray(eigenvalue - self.middle)[..., None, None]
        return np.asarray(self.residual_gain[0] + away * self.residual_gain[1])


@dataclass(frozen=True, eq=False)
class Parted:
    """Moduli over frequency of a plate, and the stiffness of each material between columns, (materials + 1, c, c).

    The last part is what K of the plate has more than the others; it takes the mean of their changes.
    """

    moduli: Moduli
    scale: Scale
    parts: FloatArray

    def steps(self, eigenvalue: float) -> ComplexArray:
        """Changes of the parts' moduli at a scaled eigenvalue, (materials + 1,)."""
        return self.moduli.steps(float(self.scale.frequency(np.array(eigenvalue))))

    def change(self, eigenvalue: float) -> ComplexArray:
        """What moduli at a scaled eigenvalue change of K + i H, (c, c)."""
        return np.asarray(np.tensordot(self.steps(eigenvalue), self.parts, 1))

    def flexibility(self, basis: GroupModes, at: FloatArray) -> ComplexArray:
        """`GroupModes.flexibility` with the moduli at eigenvalues (...), (..., modes)."""
        count = len(basis.eigenvalue)
        own = basis.eigenvalue + 1j * np.diag(basis.damping)[:count]
        diagonals = self.parts[:, range(count), range(count)]
        changed = np.array([own + self.steps(float(value)) @ diagonals for value in at.ravel()])
        return np.asarray(1.0 / (changed.reshape(*at.shape, count) - at[..., None]))

    def settled(self, basis: GroupModes) -> tuple[FloatArray, FloatArray]:
        """Eigenvalues of the modes with the moduli at their own frequencies, and their loss factors then, (modes,) each.

        To second order in the changes, whose part between two modes mixes them unless they are as close as it is large.
        """
        count = len(basis.eigenvalue)
        own, parts = np.diag(basis.eigenvalue) + 1j * basis.damping[:count, :count], self.parts[:, :count, :count]
        values = np.array(basis.eigenvalue, dtype=complex)
        for place in range(count):
            for _ in range(SETTLING):
                changed = own + np.tensordot(self.steps(float(values[place].real)), parts, 1)
                apart = changed[place, place] - np.diag(changed)
                between = np.where(np.abs(changed[place]) < MIXED * np.abs(apart), changed[place], 0.0)
                mixed = np.divide(between**2, apart, out=np.zeros_like(between), where=between != 0.0)
                before, values[place] = values[place], changed[place, place] + mixed.sum()
                if abs(values[place] - before) <= ROUNDING * abs(before):
                    break
        return values.real, values.imag / values.real

    def missed(self, frequency_hz: FloatArray) -> FloatArray:
        """Bound what the columns miss of frequencies (n,) in Hz with the moduli there, relative."""
        return np.array([NEAREST * self.moduli.missed(float(tone)) / 2.0 for tone in frequency_hz])


@dataclass(frozen=True)
class PlateMode:
    """A patched plate's mode: frequency in Hz, measures, group, and its motion in the group's degrees of freedom, (dof,).

    place: number among the modes about the band; None beyond them.
    """

    frequency_hz: float
    strength: float
    zone_share: float
    mac: float
    group: Group
    vector: FloatArray
    place: int | None = None


@dataclass(frozen=True)
class Curve:
    """Response over frequency: rms |u_z| per volt of drive on zone and passive face (m/V), sensor volts per volt, (n, s)."""

    frequency_hz: FloatArray
    zone_rms_m_per_v: FloatArray
    passive_rms_m_per_v: FloatArray | None
    sensor_v_per_v: ComplexArray


@dataclass(frozen=True)
class Drive:
    """Actuators and sensor patches by number, the band, and every mode's quality factor; None for that of the materials.

    circuit: the actuators hold a voltage (short) or a charge (open). air: before the plate, its sound adds to the loss of
    the materials. moduli: taken at each frequency, of a plate with the stiffness of each material. Raises SolverError for
    an invalid drive.
    """

    drivers: tuple[int, ...]
    sensors: tuple[int, ...]
    band_hz: tuple[float, float]
    quality_factor: float | None
    circuit: str = "short"
    air: Air | None = None
    moduli: Moduli | None = None

    def __post_init__(self) -> None:
        if not ((self.quality_factor is None or self.quality_factor > 0.0) and 0.0 < self.band_hz[0] < self.band_hz[1]):
            raise SolverError(
                f"quality factor {self.quality_factor}, band {self.band_hz} Hz: must be above 0 and ascending"
            )
        if not self.drivers:
            raise SolverError("no patch is driven: at least one must be")
        if self.circuit not in ("short", "open"):
            raise SolverError(f"circuit {self.circuit!r}: must be short (a voltage drives) or open (a charge does)")


class ForcedPlate:
    """A patched plate driven by some patches, one volt each with the target mode's signs; the others are sensors.

    bytes_each: estimated memory of a group's modes.
    """

    feed: ComplexArray | None = None  # voltages of the drivers instead of their signs, per volt of drive

    def __init__(
        self,
        plate: PatchedPlate | PressedPlate,
        design: Design,
        drive: Drive,
        margin: tuple[float, float] = MARGIN,
        bytes_each: float = 0.0,
        target_window_hz: Interval | None = None,
    ) -> None:
        self.plate, self.design, self.band_hz, self.circuit = plate, design, drive.band_hz, drive.circuit
        self.drivers, self.sensors, self.quality_factor = list(drive.drivers), list(drive.sensors), drive.quality_factor
        self.air, self.moduli = drive.air, drive.moduli
        self.margin, self.target_window_hz = margin, target_window_hz
        target = {target_symmetry(design.nodal_lines), WHOLE} if target_window_hz else set()

        # of this plate's own: digits do not depend on what else was asked of the groups
        self._kept = {
            group.symmetries: Shared(group.factorise)
            for group in plate.groups
            if not target.isdisjoint(group.symmetries)
        }

        def solved(group: Group) -> GroupModes:
            return self._damped(group_modes(group, drive.band_hz, margin, self._kept.get(group.symmetries)))

        self.modes = parallel_map(solved, plate.groups, bytes_each)

    def _damped(self, basis: GroupModes) -> GroupModes:
        """The modes with their loss: that of the given quality factor, or of the materials."""
        if self.quality_factor is None:
            basis = damped(replace(basis, radiated=radiated(basis, self.air) + by_supports(basis)))
        else:
            basis = replace(basis, loss=1.0 / self.quality_factor + by_supports(basis))
        return with_moduli(basis, self.moduli) if self.moduli else basis

    @property
    def losses(self) -> FloatArray:
        """1/Q of every mode about the band, group after group."""
        return np.concatenate([basis.loss for basis in self.modes])

    def loss_at(self, frequency_hz: float) -> float:
        """1/Q of the mode nearest to a frequency."""
        if self.quality_factor is not None and not has_dampers(self.design.supports):
            return 1.0 / self.quality_factor
        tones = self.resonances_hz
        return float(self.losses[np.abs(tones - frequency_hz).argmin()]) if len(tones) else LOSS

    @property
    def solved_hz(self) -> Interval:
        """Interval about the band, Hz, whose modes are summed."""
        return self.margin[0] * self.band_hz[0], self.margin[1] * self.band_hz[1]

    @cached_property
    def target(self) -> Found[PlateMode]:
        """Search of the patched plate's target mode (`solvers.measures.target_mode`), beyond the band where it has to;
        among the modes about the band where no window to begin with is given.
        """
        basis = self._target_basis
        if basis is None:
            window = self.target_window_hz or self.solved_hz
            return Found(NONE, (), window, window, 0.0)
        vectors = basis.columns[:, : len(basis.frequency_hz)]
        known = self._touched[next(i for i, each in enumerate(self.modes) if each is basis)]
        places = np.arange(len(basis.frequency_hz)).tolist()
        own = self._measured(basis.group, basis.frequency_hz, vectors, places, known)
        if self.target_window_hz is not None:
            group, window = basis.group, self.target_window_hz
            found = search(window, self.solved_hz, own, partial(self._between, group), partial(self._largest, group))
            self._kept[group.symmetries].near = None  # it served
            return self._extrapolated(group, found)
        judged = verdict(*np.array([(mode.strength, mode.zone_share, mode.mac) for mode in own]).T) if own else NONE
        return Found(judged, tuple(own), self.solved_hz, self.solved_hz, 0.0)

    @property
    def verdict(self) -> Verdict:
        """Verdict on which of `target.modes` is the target mode."""
        return self.target.verdict

    @property
    def _target_basis(self) -> GroupModes | None:
        """Modes of the group that holds the target mode's symmetry class; None where no load drives it."""
        target = target_symmetry(self.design.nodal_lines)
        has = (basis for basis in self.modes if {target, WHOLE} & set(basis.group.symmetries))
        return next(has, None)

    @property
    def _target(self) -> PlateMode | None:
        """The target mode; None where the plate has none."""
        index = self.verdict.index
        return None if index is None else self.target.modes[index]

    @cached_property
    def signs(self) -> FloatArray:
        """Sign of each patch's load on the target mode, so that all of them push it the same way; 1 where it has none.

        The first driving patch that moves the mode has sign 1: an eigenvector's own sign means nothing.
        """
        mode = self._target
        if mode is None:
            return np.ones(len(self.plate.patches))
        return in_phase_signs(mode.vector @ mode.group.loads, self.drivers)

    def let_go(self) -> None:
        """Free matrices and factors, which forms and curves no longer need; they are made again if needed."""
        for shared in self._kept.values():
            shared.near, shared.factorise = None, Factoriser()
        for group in self.plate.everything:
            group.let_go()

    def driven_by(self, volts: ComplexArray) -> Self:
        """Return the plate with its drivers fed by these voltages (patches,) per volt of drive instead of +-1."""
        other = copy(self)
        other.feed = volts
        return other

    def _between(self, group: Group, low_hz: float, high_hz: float) -> list[PlateMode]:
        """Every mode of a group between two frequencies, measured."""
        modes = modes_in_band(group.pencil, low_hz, high_hz, self._kept[group.symmetries])
        return self._measured(group, modes.frequency_hz, modes.vectors, [None] * len(modes.frequency_hz))

    def _extrapolated(self, group: Group, found: Found[PlateMode]) -> Found[PlateMode]:
        """Return the modes with a target mode beyond the band, and its neighbours, extrapolated to mesh size 0."""
        if found.verdict.index is None or found.modes[found.verdict.index].place is not None:
            return found
        beyond = [number for number, mode in enumerate(found.modes) if mode.place is None]
        values = np.array([self.plate.scale.eigenvalue(found.modes[number].frequency_hz) for number in beyond])
        better = extrapolated_modes(group, values, np.column_stack([found.modes[number].vector for number in beyond]))
        again = self._measured(
            group, self.plate.scale.frequency(better.eigenvalue), better.vectors, [None] * len(beyond)
        )
        modes = list(found.modes)
        for number, mode in zip(beyond, again, strict=True):
            modes[number] = mode
        return replace(found, modes=tuple(modes))

    def _largest(self, group: Group, modes: Sequence[PlateMode], reach_hz: Interval) -> float:
        """Upper bound of the strength of any one mode of a group outside an interval whose modes are known."""
        parts = zip(group.plates, group.touch(np.zeros((group.pencil.dof, 0))), strict=True)
        load = [plate.work(strength_force(field, self.design, plate.symmetry or None)) for plate, field in parts]
        low, high = (self.plate.scale.eigenvalue(end) for end in reach_hz)
        vectors = np.column_stack([mode.vector for mode in modes])
        shared = self._kept[group.symmetries]
        return largest_outside(group.pencil, shared, np.concatenate(load), vectors, (low, high))

    def _measured(
        self, group: Group, tones: FloatArray, vectors: FloatArray, places: Sequence[int | None],
        known: Touched | None = None,
    ) -> list[PlateMode]:  # fmt: skip
        """Modes of a group with their measures; known: those of columns that begin with the modes."""
        if not len(tones):
            return []
        measured = known or touched(group, vectors, self.design)
        inside, outside = (np.diag(gram)[: len(tones)] for gram in measured.grams)
        strength = measured.strength[: len(tones)]
        per_area = self.design.stack.mass_kg_m2 / self.plate.scale.mass_kg
        whole = np.maximum(inside + outside, 1e-300)
        share = inside / whole if self.areas_m2[1] is not None else np.full(len(tones), np.nan)
        mac = strength / np.maximum(per_area * inside, 1e-300)
        return [
            PlateMode(float(tones[i]), float(strength[i]), float(share[i]), float(mac[i]), group, vectors[:, i], place)
            for i, place in enumerate(places)
        ]

    @cached_property
    def all_modes(self) -> list[GroupModes]:
        """Modes of every group of the plate: contacts may move modes that the patches do not drive."""
        known = {id(basis.group): basis for basis in self.modes}
        groups = self.plate.everything
        return [known.get(id(group)) or self._damped(group_modes(group, self.band_hz, self.margin)) for group in groups]

    @property
    def resonances_hz(self) -> FloatArray:
        """Frequencies of the patched plate's modes about the band, group after group."""
        return np.concatenate([basis.frequency_hz for basis in self.modes])

    def target_hz(self) -> float | None:
        """Frequency of the patched plate's target mode, wherever it lies; None where it has none."""
        return self._target.frequency_hz if self._target else None

    def target_place(self) -> tuple[int, int] | None:
        """Number of the target mode's group, and its own among that group's modes; None where it is not among those about the
        band.
        """
        mode = self._target
        if mode is None or mode.place is None:
            return None
        return next(i for i, basis in enumerate(self.modes) if basis.group is mode.group), mode.place

    def target_column(self) -> int | None:
        """Place of the target mode among the columns of all groups, one after another; None when the band holds none."""
        place = self.target_place()
        return None if place is None else sum(one.columns.shape[1] for one in self.modes[: place[0]]) + place[1]

    def volts(self, eigenvalue: float) -> ComplexArray:
        """Voltages of all patches.

        Actuators: +-1 V, or the charge of +-1 V on the clamped patch if the circuit is open. Sensors: the open-circuit voltage.
        """
        return np.asarray(self.volts_over(np.array([eigenvalue]))[0])

    def volts_over(self, eigenvalues: FloatArray) -> ComplexArray:
        """Voltages at eigenvalues (n,), (n, loads)."""

        def charge() -> ComplexArray:
            parts = [basis.receptance(eigenvalues) for basis in self.modes]
            return np.asarray(np.sum(parts, axis=0) * self.plate.stiffness_unit)

        return np.broadcast_to(self.patch_volts(charge), (len(eigenvalues), len(self.plate.patches)))

    def patch_volts(self, charge: Callable[[], ComplexArray]) -> ComplexArray:
        """Voltages from theta' u per volt, (..., patches, patches) in C/V, which is computed only if a circuit is open."""
        capacitance = self.plate.capacitance_f
        volts = np.zeros(len(self.plate.patches), dtype=complex)
        charged = np.zeros(len(self.plate.patches))
        fed, left = (self.drivers, self.sensors) if self.circuit == "short" else ([], self.drivers + self.sensors)
        if self.circuit == "open":
            charged[self.drivers] = (self.signs * capacitance)[self.drivers]
        volts[fed] = (self.signs if self.feed is None else self.feed)[fed]
        if left:  # charges of open patches are given: Q = theta' u + C V is solved for their voltages
            moved = charge()[..., left, :]
            clamped = moved[..., left] + np.diag(capacitance[left])
            given = charged[left] - moved[..., fed] @ volts[fed]
            volts = np.tile(volts, (*given.shape[:-1], 1))
            volts[..., left] = np.linalg.solve(clamped, given[..., None])[..., 0]
        return volts

    @cached_property
    def _touched(self) -> list[Touched]:
        """Motion of every column on the touch face, group by group."""
        return [touched(basis.group, basis.columns, self.design) for basis in self.modes]

    @cached_property
    def grams(self) -> list[tuple[FloatArray, FloatArray]]:
        """Integrals of u_z^2 over the active and the passive touch face, per pair of columns."""
        return [each.grams for each in self._touched]

    @cached_property
    def areas_m2(self) -> tuple[float, float | None]:
        """Areas of the active and of the passive touch face, as far as nothing hangs from them; None without a passive one."""
        plate = self.modes[0].group.plates[0]
        field = plate.touch(np.zeros((plate.dof, 0)))
        parts = field.is_active(self.design), self.design.passive(field.points)
        inside, outside = (float(field.weights[part].sum()) for part in parts)
        return inside, outside if outside > 1e-9 * inside else None

    def curve(self, frequency_hz: FloatArray) -> Curve:
        """Response at frequencies in Hz."""
        at = self.plate.scale.eigenvalue(frequency_hz)
        volts = self.volts_over(at)
        zone, passive = np.zeros(len(at)), np.zeros(len(at))
        for basis, grams in zip(self.modes, self.grams, strict=True):
            amplitudes = basis.amplitudes(at, volts).T
            for total, gram in zip((zone, passive), grams, strict=True):
                total += quadratic(gram, amplitudes)
        return Curve(np.asarray(frequency_hz), *rms(zone, passive, self.areas_m2), volts[:, self.sensors])

    def motion_by(self, rows: Callable[[Group], Any], frequency_hz: float) -> ComplexArray:
        """Apply rows (m, dof) of each group to the motion at a frequency, per volt of drive, (m,)."""
        eigenvalue = self.plate.scale.eigenvalue(frequency_hz)
        volts = self.volts(eigenvalue)
        moved = [rows(basis.group) @ (basis.columns @ basis.amplitudes(eigenvalue, volts)) for basis in self.modes]
        return np.asarray(np.sum(moved, axis=0), dtype=complex)

    def shape(self, frequency_hz: float) -> tuple[FloatArray, ComplexArray]:
        """Operating shape on the whole touch face: points (q, 2) in m and complex u_z (q,) per volt, m/V."""
        eigenvalue = self.plate.scale.eigenvalue(frequency_hz)
        volts = self.volts(eigenvalue)
        parts = [
            _unfolded(face.points, moved, symmetry)
            for basis in self.modes
            for symmetry, face, moved in basis.touched(eigenvalue, volts)
        ]
        return parts[0][0], np.asarray(sum(values for _, values in parts))

    def skin(self, frequency_hz: float) -> Skin:
        """Outer skin of the whole plate, without its patches, with its complex displacement (1, p, 3) per volt, m/V."""
        eigenvalue = self.plate.scale.eigenvalue(frequency_hz)
        volts = self.volts(eigenvalue)
        parts = []
        for basis in self.modes:
            moved: Any = basis.columns @ basis.amplitudes(eigenvalue, volts)[:, None]
            pairs = zip(basis.group.plates, basis.group.split(moved), strict=True)
            parts += [plate.skin(own).unfolded(plate.symmetry) for plate, own in pairs]
        return replace(parts[0], displacement=np.sum([each.displacement for each in parts], axis=0))


def in_phase_signs(gain: FloatArray, drivers: list[int]) -> FloatArray:
    """Choose the signs with which loads on a mode add up, 1 for the first driver that counts.

    Parameters
    ----------
    gain : ndarray, shape (patches,)
        Loads on the mode.
    drivers : list of int
        Numbers of the drivers.

    Returns
    -------
    ndarray, shape (patches,)
        +1 or -1.
    """
    strong = [index for index in drivers if abs(gain[index]) > COUNTS * np.abs(gain).max(initial=0.0)]
    turn = -1.0 if strong and gain[strong[0]] < 0.0 else 1.0
    return np.where(turn * gain < 0.0, -1.0, 1.0)


def quadratic(gram: FloatArray, amplitudes: ComplexArray) -> FloatArray:
    """Compute a^H G a for each column; rounding below zero counts as zero.

    Parameters
    ----------
    gram : ndarray, shape (n, n)
        Symmetric G.
    amplitudes : ndarray, shape (n, columns)
        a.

    Returns
    -------
    ndarray, shape (columns,)
        At least 0.
    """
    parts = [np.einsum("nf,nf->f", part, gram @ part) for part in (amplitudes.real, amplitudes.imag)]
    return np.asarray(np.maximum(parts[0] + parts[1], 0.0))


def rms(
    zone_m4: FloatArray, passive_m4: FloatArray, areas_m2: tuple[float, float | None]
) -> tuple[FloatArray, FloatArray | None]:
    """Compute rms |u_z| on the active and on the passive touch face.

    Parameters
    ----------
    zone_m4, passive_m4 : ndarray, shape (n,)
        Integrals of |u_z|^2 over both, in m^4.
    areas_m2 : tuple of float
        Their areas; None for the second without a passive face.

    Returns
    -------
    zone : ndarray, shape (n,)
        In m.
    passive : ndarray, shape (n,), or None
        In m; None without a passive face.
    """
    active, passive = areas_m2
    return np.sqrt(zone_m4 / active), None if passive is None else np.sqrt(passive_m4 / passive)


@dataclass(frozen=True)
class Touched:
    """Measures of motions on the touch face: integrals of u_z^2 over its active and its passive part per pair of motions,
    (k, k) each, and strengths (k,).
    """

    grams: tuple[FloatArray, FloatArray]
    strength: FloatArray


def touched(group: Group, motions: FloatArray, design: Design) -> Touched:
    """Measure motions of a group on the touch face, one class's field after the other.

    Classes that the patches couple move together: only the target class contributes to the target shape, all to the rest.

    Parameters
    ----------
    group : Group
        The coupled classes.
    motions : ndarray, shape (dof, k)
        The motions.
    design : Design
        The plate with its zone.

    Returns
    -------
    Touched
        Integrals over both faces (k, k), and strengths (k,).
    """
    count = motions.shape[1]
    grams, strength = (np.zeros((count, count)), np.zeros((count, count))), np.zeros(count)
    for plate, part in zip(group.plates, group.split(motions), strict=True):
        field = plate.touch(part)
        parts = field.is_active(design), design.passive(field.points)
        for gram, rows in zip(grams, map(np.flatnonzero, parts), strict=True):
            for some in np.array_split(rows, len(rows) // ROWS + 1):
                gram += field.values[some].T @ (field.weights[some, None] * field.values[some])
        strength += (strength_force(field, design, plate.symmetry or None) @ field.values) ** 2
    return Touched(grams, strength)


def _unfolded(points: FloatArray, values: ComplexArray, symmetry: str) -> tuple[FloatArray, ComplexArray]:
    for axis, mark in enumerate(symmetry):
        flip = np.ones(2)
        flip[axis] = -1.0
        points = np.concatenate([points, points * flip])
        values = np.concatenate([values, values if mark == "S" else -values])
    return points, values


def group_modes(
    group: Group, band_hz: tuple[float, float], margin: tuple[float, float], kept: Shared | None = None
) -> GroupModes:
    """Compute the modes of a group within a band widened by a margin, and its residual vectors about the band's middle.

    Parameters
    ----------
    group : Group
        The coupled classes.
    band_hz : tuple of float
        Ends of the band, in Hz.
    margin : tuple of float
        Factors on both ends.
    kept : Shared, optional
        Receives counts and the factor for later solves of the group.

    Returns
    -------
    GroupModes
        Modes, residual vectors and their errors.
    """
    scale, shared = group.pencil.scale, kept or Shared(group.factorise)
    modes = modes_in_band(group.pencil, margin[0] * band_hz[0], margin[1] * band_hz[1], shared)
    values = scale.eigenvalue(1.0) * modes.frequency_hz**2
    middle = scale.eigenvalue(0.5 * (band_hz[0] + band_hz[1]))
    while len(values) and np.abs(values / middle - 1.0).min() < 1e-6:
        middle *= 1.0 + 3e-6
    factor, middle = factor_near(group.pencil, middle, shared.factorise)
    _, residual, slope = residual_vectors(group, factor, middle, (values, modes.vectors), group.loads)
    if kept:
        kept.near = factor, middle
    else:
        factor.free()  # before the coarser mesh's
    gains = (group.loads.T @ residual, group.loads.T @ slope)
    better = extrapolated_modes(group, values, modes.vectors)
    columns = np.hstack([better.vectors, residual, slope])
    tones = scale.frequency(better.eigenvalue)
    return GroupModes(
        group, tones, better.eigenvalue, better.gain, columns, middle, gains, better.images, better.errors
    )


def damped(basis: GroupModes) -> GroupModes:
    """Add the loss of the materials to the modes and residual vectors of a group.

    Parameters
    ----------
    basis : GroupModes
        Modes of a group whose loss is known.

    Returns
    -------
    GroupModes
        The same modes with the loss between all columns; that of the modes is relative to the energy on their own mesh.
    """
    count, lost = len(basis.eigenvalue), basis.group.lost(basis.columns)
    scale = np.ones(len(lost))
    scale[:count] = np.sqrt(basis.eigenvalue / np.einsum("ik,ik->k", basis.columns[:, :count], basis.images[0]))
    lost = scale[:, None] * (lost + lost.T) / 2.0 * scale
    lost[np.arange(count), np.arange(count)] += basis.radiated * basis.eigenvalue
    return replace(basis, loss=np.diag(lost)[:count] / basis.eigenvalue, lost=lost)


def with_moduli(basis: GroupModes, moduli: Moduli) -> GroupModes:
    """Let the moduli of a group's plate depend on the frequency.

    Parameters
    ----------
    basis : GroupModes
        Modes and residual vectors with the moduli of the plate's reduction, and their loss.
    moduli : Moduli
        Materials of that reduction.

    Returns
    -------
    GroupModes
        The same columns; frequencies (Hz) and loss factors of the modes are those with the moduli at their own frequency.

    Raises
    ------
    SolverError
        If the plate was reduced without the parts of its materials.
    """
    if basis.group.parted is None:
        raise SolverError("the plate was reduced without the parts of its materials")
    scale = basis.group.pencil.scale
    parted = Parted(moduli, scale, basis.group.parted(basis.columns))
    values, loss = parted.settled(basis)
    own = replace(basis, parted=parted, frequency_hz=scale.frequency(values))
    return own if basis.lost is None else replace(own, loss=loss)


def radiated(basis: GroupModes, air: Air | None) -> FloatArray:
    """Compute the loss of a group's modes by radiation.

    Parameters
    ----------
    basis : GroupModes
        Modes of a group.
    air : Air or None
        Air before the plate.

    Returns
    -------
    ndarray, shape (modes,)
        1/Q; 0 without air.
    """
    count = len(basis.eigenvalue)
    total = np.zeros(count)
    if air:
        for symmetry, own in zip(basis.group.symmetries, basis.group.touch(basis.columns[:, :count]), strict=True):
            total += air_loss_factors(own, symmetry or None, basis.frequency_hz, air)
    return total


def by_supports(basis: GroupModes) -> FloatArray:
    """Compute the loss of a group's modes in the dampers of the supports, whose coupling between modes is left out.

    Parameters
    ----------
    basis : GroupModes
        Modes of a group.

    Returns
    -------
    ndarray, shape (modes,)
        1/Q; 0 without dampers.
    """
    vectors = basis.columns[:, : len(basis.eigenvalue)]
    parts = zip(basis.group.plates, basis.group.split(vectors), strict=True)
    lost = sum((np.diag(plate.damping(part)) for plate, part in parts), np.zeros(len(basis.eigenvalue)))
    return np.asarray(lost / np.sqrt(basis.eigenvalue))


def sound_db(forced: ForcedPlate, frequency_hz: float, volts: float) -> float | None:
    """Compute the sound pressure level at SOUND_AT_M before the middle of the touch face.

    Parameters
    ----------
    forced : ForcedPlate
        The plate with its modes.
    frequency_hz : float
        Frequency of the drive.
    volts : float
        Amplitude of the drive, V.

    Returns
    -------
    float or None
        In dB re 20 uPa; None without air.
    """
    if forced.air is None:
        return None
    eigenvalue, pressure = forced.plate.scale.eigenvalue(frequency_hz), 0j
    fed = volts * forced.volts(eigenvalue)
    for basis in forced.modes:
        for symmetry, face, moved in basis.touched(eigenvalue, fed):
            if "A" not in symmetry:  # odd motions cancel on the axis
                pressure += pressure_pa(face, moved, frequency_hz, forced.air, SOUND_AT_M)
    return level_db(pressure)


def whitened(mass: FloatArray) -> FloatArray:
    """Find an M-orthonormal basis of directions of which some depend on others.

    Parameters
    ----------
    mass : ndarray, shape (n, n)
        M between the directions.

    Returns
    -------
    ndarray, shape (n, m)
        Coefficients of the basis.
    """
    size = 1.0 / np.sqrt(np.maximum(np.diag(mass), 1e-300))
    values, basis = np.linalg.eigh(mass * np.outer(size, size))
    kept = values > SAME * values[-1]
    return np.asarray(size[:, None] * basis[:, kept] / np.sqrt(values[kept]))


def residual_vectors(
    group: Group, factor: Factor, middle: float, modes: tuple[FloatArray, FloatArray], loads: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute the gains of loads on modes, and the residual vectors R and R1 of the loads about the middle.

    Parameters
    ----------
    group : Group
        The coupled classes.
    factor : Factor
        Of K - middle M.
    middle : float
        Scaled eigenvalue in the middle of the band.
    modes : tuple of ndarray, shapes (modes,) and (dof, modes)
        Scaled eigenvalues and M-orthonormal vectors.
    loads : ndarray, shape (dof, l)
        Scaled loads.

    Returns
    -------
    gain : ndarray, shape (modes, l)
        Of the loads on the modes.
    residual, slope : ndarray, shape (dof, l)
        R and R1.
    """
    _, vectors = modes
    gain, answer = vectors.T @ loads, factor.solve(loads)
    residual = answer - vectors @ (vectors.T @ group.pencil.apply_mass(answer))
    return gain, residual, factor.solve(group.pencil.apply_mass(residual))
