"""The same finger at every place of the touch face: what it leaves of the motion, and what a sensor hears.

One lattice of points carries the contacts of all places, as dense as finger and wave need; a point and its mirror images share
the residual vectors of their symmetry class. Each place is then a solve of the points of its contact, whose loads are scaled by
the roots of their weights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from geometry.elements import ComplexArray, FloatArray, IntArray
from geometry.layout import Design
from solvers.piezo.bond import mirror_signs
from solvers.piezo.forced import GroupModes
from solvers.piezo.patched_plate import Group
from solvers.piezo.responses import face_motion
from solvers.superelement.plate import WHOLE
from solvers.touch import touched_plate
from solvers.touch.touched_plate import TouchedPlate, rms, with_loads

COPIES = 6  # of a group's loads that are held at once: loads, residual vectors, slopes, and the three stacked


@dataclass(frozen=True)
class TouchMap:
    """Over a grid of places x_m (nx,), y_m (ny,): rms of u_z over the contact, m per volt of drive, free and touched, (nx, ny).

    field: the free plate's u_z at the places, complex; sensor_v: what each listening patch gives per volt, (nx, ny, sensors).
    under: the touched plate's mean u_z over the contact, slope_change: what the finger adds to its slope along x, complex.
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
        """Steps from a contact's middle to its outermost point: so many lines of points at each end carry no middle."""
        return int(self.steps.max())

    @property
    def places(self) -> tuple[IntArray, IntArray]:
        """The lines of points that carry middles, along x and y."""
        inner = slice(self.reach, -self.reach)
        return self.along[inner], self.across[inner]

    @property
    def points_m(self) -> FloatArray:
        """All of them, (nx ny, 2), y fastest."""
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


def lattice(design: Design, touched: TouchedPlate, high_hz: float | None = None) -> Lattice:
    """The points of all contacts that lie on the plate, clear of pillars on its touch face, for waves up to a frequency
    (default: the band's).
    """
    radius = touched.finger.radius_m
    wavenumber = touched.finger.wavenumber_per_m(design, high_hz or touched.band_hz[1])
    steps, weights, share = touched_plate.lattice_rule(touched_plate.steps_of(radius * wavenumber))
    spacing, reach = share * radius, int(steps.max())
    ends = (design.length_m / 2.0 - radius, design.bare_touch_m - radius)
    counts = [int(max(end, 0.0) / spacing) + reach for end in ends]
    along, across = (np.arange(-count, count + 1) for count in counts)
    return Lattice(spacing, along, across, steps, weights)


def needed_bytes(touched: TouchedPlate, points: Lattice) -> float:
    """Memory that a map takes, B: the residual vectors of the largest group, and the receptance of all points."""
    count, distinct = len(points.points_m), len(_distinct(points.points_m)[0])
    loads = [
        group.pencil.dof * (count if group.symmetries == (WHOLE,) else distinct * len(group.plates))
        for group in touched.plate.everything
    ]
    return 8.0 * COPIES * max(loads) + 3.0 * 16.0 * count**2


@dataclass(frozen=True, eq=False)
class Places:
    """A touched plate seen from its patches and the points of a lattice at one frequency.

    receptance (p + q, p + q): charges of patches and motions of points, in SI; gains (n, p + q) of the modes of all groups.
    """

    touched: TouchedPlate
    points: Lattice
    frequency_hz: float
    receptance: ComplexArray
    gains: FloatArray

    @classmethod
    def of(cls, touched: TouchedPlate, points: Lattice, frequency_hz: float) -> Places:
        """Of a plate's own modes and of the residual vectors of all points."""
        receptance = lattice_receptance(touched, points.points_m, frequency_hz)
        count, unit = len(touched.plate.patches), touched.plate.stiffness_unit
        gains = [
            np.hstack([basis.gain[:, :count], (face_motion(basis.group, points.points_m) @ _modes(basis)).T / unit])
            for basis in touched.free.all_modes
        ]
        return cls(touched, points, frequency_hz, receptance, np.concatenate(gains))

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
        """Every place; a finger of nothing leaves the free plate's motion."""
        touched, points, receptance = self.touched, self.points, self.receptance
        count, stiffness = len(touched.plate.patches), touched.finger.dynamic_stiffness(self.frequency_hz)
        free = touched.patch_volts(lambda: receptance[:count, :count])
        field, root, reach = receptance[count:, :count] @ free, np.sqrt(points.weights), points.reach
        x_m, y_m = (points.spacing_m * each for each in points.places)
        nx, ny = self.shape
        moved, before = np.zeros((nx, ny)), np.zeros((nx, ny))
        heard = np.zeros((nx, ny, len(touched.sensors)), dtype=complex)
        under, change = np.zeros((nx, ny), dtype=complex), np.zeros((nx, ny), dtype=complex)
        for number, (i, j) in enumerate(np.ndindex(nx, ny)):
            (loads,), scaled = self.loads(np.array([number]))
            own = field[loads[count:] - count]
            block = scaled[:, None] * receptance[np.ix_(loads, loads)] * scaled
            answer = touched.loads_of(block, stiffness)
            motion = block[count:] @ answer
            before[i, j], moved[i, j] = rms(root * own), rms(motion)
            under[i, j], change[i, j] = root @ motion, points.slope_weights @ (motion / root - own)
            heard[i, j] = answer[touched.sensors]
        inner = field.reshape(nx + 2 * reach, ny + 2 * reach)[reach:-reach, reach:-reach]
        return TouchMap(self.frequency_hz, np.asarray(x_m), np.asarray(y_m), inner, before, moved, heard, under, change)


def _modes(basis: GroupModes) -> FloatArray:
    return basis.columns[:, : len(basis.frequency_hz)]


def lattice_receptance(touched: TouchedPlate, points_m: FloatArray, frequency_hz: float) -> ComplexArray:
    """Charges of patches and motions of points per volt and newton, (p + q, p + q), as TouchedPlate.receptance."""
    plate, count = touched.plate, len(touched.plate.patches)
    eigenvalue = plate.scale.eigenvalue(frequency_hz)
    total = np.zeros((count + len(points_m),) * 2, dtype=complex)
    for basis in touched.free.all_modes:
        loads, signed = _folded(basis.group, points_m)
        own = with_loads(basis, loads / plate.stiffness_unit).receptance(eigenvalue, touched.loss)
        spread = scipy.linalg.block_diag(np.eye(count), signed)
        total += spread @ own @ spread.T
    return np.asarray(total * plate.stiffness_unit)


def _folded(group: Group, points_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit forces at the distinct mirror images in x, y >= 0, class by class, (dof, k); each point as a sum of them, (q, k)."""
    if group.symmetries == (WHOLE,):
        return face_motion(group, points_m).T.toarray(), np.eye(len(points_m))
    distinct, which = _distinct(points_m)
    loads = [face_motion(Group((plate,), group.join, group.loads), distinct).T.toarray() for plate in group.plates]
    chosen = np.eye(len(distinct))[which]
    signs = [mirror_signs(symmetry, points_m)[:, 2:] * chosen for symmetry in group.symmetries]
    return scipy.linalg.block_diag(*loads), np.hstack(signs)


def _distinct(points_m: FloatArray) -> tuple[FloatArray, IntArray]:
    """Mirror images in x, y >= 0, each once, (k, 2), and which of them is each point's, (q,)."""
    folded = np.asarray(np.round(np.abs(points_m), 12), dtype=float)
    distinct, which = np.unique(folded, axis=0, return_inverse=True)
    return distinct, which.ravel()
