"""A plate's own modes, from whichever solver, as a modal table: patches by what they do to a thin plate.

A patch poled through its thickness t pulls alike along x and y with e V per length, e = d31/(s11 + s12), at z_p = (h + t)/2
from the middle plane: its modal force is e z_p times the integral of w_xx + w_yy over it (to sign), its charge the same times
the modal coordinate, its clamped capacitance C = (eps33^T - 2 d31^2/(s11 + s12)) A/t. The modes are taken as they come: the
patches' own mass and stiffness are not in them unless their solver put them there, and in-plane motion is left out. Source:
ieee176.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from geometry.patches import Patches
from solvers.errors import SolverError
from solvers.fem.assembly import Scale
from solvers.measures.confinement import TouchField
from solvers.shaping.modal_table import ModalTable

FloatArray = NDArray[np.float64]
DEGREE = 6  # of the polynomial through the touch face's points around a patch
REACH = 2.0  # of half the patch's longer side: how far around it points may be taken
ROUGH = 0.02  # of the largest value: rms distance of the points from the polynomial


def whole_touch(touch: TouchField, symmetry: str) -> TouchField:
    """The four mirror images of one class' field as the whole plate's, each with a quarter of the weight.

    symmetry: two signs of u_z, x then y. SolverError for anything else.
    """
    if len(symmetry) != 2 or set(symmetry) - set("SA"):
        raise SolverError(f"symmetry {symmetry!r}: must be two letters, S or A")
    images = list(product((1.0, -1.0), repeat=2))
    signs = [(x if symmetry[0] == "A" else 1.0) * (y if symmetry[1] == "A" else 1.0) for x, y in images]
    return TouchField(
        np.concatenate([touch.points * np.array(image) for image in images]),
        np.tile(touch.weights / 4.0, 4),
        np.concatenate([sign * touch.values for sign in signs]),
    )


def mass_normalised(touch: TouchField, scale: Scale) -> TouchField:
    """Modes that are M-orthonormal in a pencil's scaled units as 1/sqrt(kg): values over sqrt(density length^3)."""
    return TouchField(touch.points, touch.weights, touch.values / np.sqrt(scale.mass_kg), 1.0)


def laplacian_integrals(points: FloatArray, values: FloatArray, boxes_m: FloatArray) -> FloatArray:
    """Integral of w_xx + w_yy over each box x0, x1, y0, y1 (b, 4) from w (q, m) at points (q, 2), shape (m, b), m.

    A polynomial of degree 6 is fitted to the points in and around the box, farther out where they are few. SolverError when
    there are too few as far as REACH, or they are off the polynomial by more than 2 % of the largest value.
    """
    powers = [(i, j) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)]
    largest = max(float(np.abs(values).max()), 1e-300)
    columns = []
    for k, (x0, x1, y0, y1) in enumerate(boxes_m):
        middle, half = np.array([x0 + x1, y0 + y1]) / 2.0, np.array([x1 - x0, y1 - y0]) / 2.0
        near, reach = _around(points - middle, half, 2 * len(powers), k)
        xi = (points[near] - middle) / reach
        basis = np.stack([xi[:, 0] ** i * xi[:, 1] ** j for i, j in powers], axis=1)
        fit = np.linalg.lstsq(basis, values[near], rcond=None)[0]
        missed = float((np.sqrt(np.mean((basis @ fit - values[near]) ** 2, axis=0))).max()) / largest
        if missed > ROUGH:
            raise SolverError(
                f"patch {k + 1}: the field around it is {100 * missed:.1f} % off a smooth one; use more points"
            )
        columns.append(np.array([_box_laplacian(i, j, half / reach, reach) for i, j in powers]) @ fit)
    return np.stack(columns, axis=1)


def _around(away: FloatArray, half: FloatArray, needed: int, number: int) -> tuple[NDArray[np.bool_], FloatArray]:
    """Points within a growing distance of a box, and half the sides of the box they fill."""
    for share in np.linspace(0.25, REACH, 8):
        reach = half + share * half.max()
        near = (np.abs(away) <= reach).all(axis=1)
        if near.sum() >= needed:
            return near, reach
    raise SolverError(f"patch {number + 1}: {int(near.sum())} points of the field around it, {needed} are needed")


def _box_laplacian(i: int, j: int, edge: FloatArray, reach: FloatArray) -> float:
    """Integral over |xi| <= edge of the Laplacian of xi^i eta^j, in units of x and y."""

    def moment(power: int, end: float) -> float:
        return 2.0 * end ** (power + 1) / (power + 1) if power >= 0 and power % 2 == 0 else 0.0

    along = i * (i - 1) * moment(i - 2, edge[0]) * moment(j, edge[1]) * reach[1] / reach[0] if i > 1 else 0.0
    across = j * (j - 1) * moment(i, edge[0]) * moment(j - 2, edge[1]) * reach[0] / reach[1] if j > 1 else 0.0
    return float(along + across)


def plate_table(
    frequencies_hz: FloatArray, touch: TouchField, patches: Patches, thickness_m: float, quality: float
) -> ModalTable:
    """The table of modes (m,) whose mass-normalised u_z on the touch face is touch.values (q, m), 1/sqrt(kg).

    Actuators are the patches that drive, sensors those that listen, or every patch when none listens. Points and values of the
    touch face become the field. SolverError as ModalTable and laplacian_integrals.
    """
    if not patches.count:
        raise SolverError("modal table: the list of actuators is empty, at least one patch is needed")
    boxes, piezo = patches.boxes_m(), patches.material
    per_field = piezo.d31 / (piezo.s11 + piezo.s12)
    lever = (thickness_m + patches.size_m[2]) / 2.0
    pull = per_field * lever * laplacian_integrals(touch.points, touch.values, boxes)
    clamped_capacitance = float(piezo.permittivity_free_f_m[2, 2]) - 2.0 * piezo.d31 * per_field
    area = (boxes[:, 1] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 2])
    volts = pull * patches.size_m[2] / (clamped_capacitance * area)
    drivers, sensors = list(patches.drivers), list(patches.sensors) or list(range(patches.count))
    return ModalTable(
        frequencies_hz=frequencies_hz,
        quality=np.full(len(frequencies_hz), quality),
        actuators=pull[:, drivers],
        sensors=volts[:, sensors],
        field=touch.values.T,
        points_m=touch.points,
    )


def composite_tables(tables: list[ModalTable]) -> ModalTable:
    """One table of the modes of several symmetry classes over the same points, actuators and sensors, in ascending order.

    SolverError for an empty list or points that differ.
    """
    if not tables:
        raise SolverError("modal table: no class to join")
    if any(
        one.points_m.shape != tables[0].points_m.shape or (one.points_m != tables[0].points_m).any() for one in tables
    ):
        raise SolverError("modal table: classes to join must share their points")
    order = np.argsort(np.concatenate([one.frequencies_hz for one in tables]), kind="stable")

    def joined(name: str) -> FloatArray:
        return np.asarray(np.concatenate([getattr(one, name) for one in tables])[order])

    return ModalTable(
        frequencies_hz=joined("frequencies_hz"),
        quality=joined("quality"),
        actuators=joined("actuators"),
        sensors=joined("sensors"),
        field=joined("field"),
        points_m=tables[0].points_m,
    )
