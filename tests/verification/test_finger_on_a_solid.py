"""The mode under a finger beside the full matrices of a solid: plate, pillars and patches with their potential, pressure
spread over the disk, and the complex eigenvalue of ((1 + i/Q) K + i omega C - omega^2 M) u = 0 by a nonlinear Arnoldi method.

Neither reduction nor polynomials over the contact have a part in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from geometry.elements import FloatArray
from geometry.hex.boxes import VOID, Boxes, boxes_of, hex_mesh
from geometry.hex.scenes import Grading, HexSettings, grid_lines, plate_scene
from pipeline.case.model import Case, case_from_dict
from pipeline.logs import TerminalLog
from solvers.fem.assembly import assemble
from solvers.fem.factor import Factoriser
from solvers.fem.surface import SAME_M, grid_weights
from studies.independent import bonded_solid
from tests.helpers.asked import touch_of

ORDER, SHRINK, EXPONENT = (
    3,
    0.3,
    0.55,
)  # towards an edge: elements shrink so, displacements go as this power of the distance
RINGS, SPOKES = 40, 50  # of points on a quarter of the disk
KNOWN = 8  # free modes about the target mode
SETTLED, STEPS = 1e-8, 40  # of a motion's correction, relative
BARE: dict[str, Any] = {
    "name": "bare",
    "material": "aluminium",
    "plate": {"thickness_mm": 2.0},
    "zone": {"length_mm": 24.0, "width_mm": 10.0, "nodal_lines": 2},
    "array": {"rows": 0, "extension_mm": 3.0},
    "patches": {"size_mm": [6.0, 4.0, 0.5], "centres_mm": [[-6.0, 0.0], [6.0, 0.0]]},
    "damping": {"quality": 100.0},
    "touch": {"at_mm": [0.0, 0.0], "radius_mm": 4.0, "impedance": "tissue"},
    "solve": {"accuracy": 0.1, "band_kHz": [65.0, 80.0]},
}
ROWS: dict[str, Any] = {
    **BARE,
    "name": "rows",
    "plate": {"thickness_mm": 1.5},
    "zone": {"length_mm": 18.0, "width_mm": 10.0, "nodal_lines": 2},
    "pillar": {"shape": "square", "side_mm": 2.0, "height_mm": 5.0},
    "array": {"pitch_mm": 6.0, "rows": 1, "extension_mm": 3.0},
    "patches": {"size_mm": [4.0, 2.0, 0.3], "centres_mm": [[-5.0, 0.0], [5.0, 0.0]]},
    "touch": {"at_mm": [0.0, 0.0], "radius_mm": 4.5, "impedance": "tissue"},
    "solve": {"accuracy": 0.01, "band_kHz": [40.0, 100.0]},
}


@dataclass(frozen=True)
class Solid:
    """A quarter between two mirrors: K, M and the mean square of u_z over the disk times its area, each (dof, dof), in SI."""

    stiffness: sp.csc_array
    mass: sp.csc_array
    contact: sp.csc_array


def solid(case: Case, layers: int, size_m: float) -> Solid:
    design, patches, touched = case.design, case.patches, case.touch
    assert patches is not None and touched is not None
    boxes, patch_boxes = boxes_with_patches(case, layers, size_m)
    plate = hex_mesh(boxes, ORDER)
    materials = {"plate": design.material} | ({"pillar": design.pillar.material} if design.pillar else {})
    system = assemble(plate, materials)
    patch = hex_mesh(patch_boxes, ORDER)
    patch.nodes[:, 2] += design.thickness_m  # bonded on the plate's back
    joined = bonded_solid(system, patch, patches.material, patches.size_m[2])
    assert len(joined.place_nm) < len(plate.nodes) + len(patch.nodes)  # they share the nodes of the bond
    free = np.flatnonzero(np.column_stack([joined.place_nm[:, :2] != 0, np.ones(len(joined.place_nm), dtype=bool)]))
    coupling, dielectric = joined.bending
    count = dielectric.shape[0]
    stiffness = sp.block_array(
        [[joined.stiffness[free][:, free], coupling[free]], [coupling[free].T, -dielectric]], format="csc"
    )
    mass = sp.block_diag([joined.mass[free][:, free], sp.csc_array((count, count))], format="csc")
    rows = _disk(joined.place_nm, touched.radius_m)
    contact = sp.block_diag([(rows.T @ rows)[free][:, free], sp.csc_array((count, count))], format="csc")
    return Solid(*map(sp.csc_array, (stiffness, mass, contact)))


def boxes_with_patches(case: Case, layers: int, size_m: float, clamped: bool = False) -> tuple[Boxes, Boxes]:
    """Of plate and pillars, and of the patches that stand on them, whose lines go on through the plate."""
    design, patches = case.design, case.patches
    assert patches is not None
    scene = plate_scene(design, HexSettings(ORDER, size_m, layers, SHRINK), quarter=True)
    half = 0.5 * np.array(patches.size_m)
    spans = [np.sort([centre - half[:2], centre + half[:2]], axis=0).T for centre in np.array(patches.centres_m)]
    for lines, axis, end in ((scene.x, 0, design.length_m / 2.0), (scene.y, 1, design.half_span_m)):
        edges = {float(edge) for span in spans for edge in span[axis]}
        lines |= {edge: True for edge in edges if SAME_M < edge < end - SAME_M}
    scene.x[design.length_m / 2.0] = clamped  # elements graded towards it
    boxes = boxes_of(scene)
    x, y = ((lines[1:] + lines[:-1]) / 2.0 for lines in (boxes.x, boxes.y))
    inside = np.zeros((len(x), len(y)), dtype=bool)
    for (left, right), (front, rear) in spans:
        inside |= ((x > left) & (x < right))[:, None] & ((y > front) & (y < rear))
    z = grid_lines({0.0: True, patches.size_m[2]: False}, Grading(size_m, layers, SHRINK))
    region = np.repeat(np.where(inside, 0, VOID)[:, :, None], len(z) - 1, axis=2)
    return boxes, Boxes(boxes.x, boxes.y, z, region, ("patch",))


def _disk(place_nm: FloatArray, radius_m: float) -> sp.csr_array:
    """Roots of areas times u_z at points of the quarter disk, (points, 3 nodes)."""
    nodes, shares = np.polynomial.legendre.leggauss(RINGS)
    turns, parts = np.polynomial.legendre.leggauss(SPOKES)
    radius, angle = radius_m * np.sqrt((nodes + 1.0) / 2.0), np.pi / 4.0 * (turns + 1.0)
    x, y = (np.outer(radius, turn(angle)).ravel() for turn in (np.cos, np.sin))
    area = np.pi * radius_m**2 / 4.0 * np.outer(shares, parts).ravel() / 4.0
    touched = np.flatnonzero(place_nm[:, 2] == 0)
    moved = np.sqrt(area)[:, None] * grid_weights(place_nm[touched, :2] * SAME_M, ORDER, np.column_stack([x, y]))
    point, column = np.nonzero(moved)
    shape = (len(x), 3 * len(place_nm))
    return sp.csr_array(sp.coo_array((moved[point, column], (point, 3 * touched[column] + 2)), shape))


def loaded(body: Solid, near_hz: float, resistance: float, quality: float) -> tuple[float, complex]:
    """Frequency of the free mode nearest to one, and the scaled eigenvalue (omega over that of the free mode)^2 of the mode
    under a pressure `resistance` (N s/m3) times the velocity that keeps most of it.
    """
    unit, shift = float(body.stiffness.diagonal().max()), (2.0 * np.pi * near_hz) ** 2
    stiffness, mass, contact = body.stiffness / unit, body.mass * (shift / unit), body.contact / unit
    factor = Factoriser()(sp.csc_array(stiffness - mass))
    inverse = spla.LinearOperator(stiffness.shape, matvec=factor.solve, dtype=float)
    start = factor.solve(mass @ np.ones(stiffness.shape[0]))
    values, vectors = spla.eigsh(stiffness, KNOWN, mass, sigma=1.0, OPinv=inverse, v0=start)
    target = int(np.argmin(np.abs(values - 1.0)))
    free = vectors[:, target] / np.sqrt(vectors[:, target] @ (mass @ vectors[:, target]))
    damping = contact * (1j * 2.0 * np.pi * near_hz * resistance)
    loss, held = 1.0 + 1j / quality, mass @ free
    basis = np.linalg.qr(np.column_stack([vectors, *(factor.solve((contact @ each).copy()) for each in vectors.T)]))[0]
    basis = basis.astype(complex)
    for _ in range(STEPS):
        k, c, m = (basis.conj().T @ (each @ basis) for each in (loss * stiffness, damping, mass))
        none, one = np.zeros_like(k), np.eye(len(k))
        roots, both = scipy.linalg.eig(np.block([[none, one], [k, c]]), scipy.linalg.block_diag(one, m))
        known = np.isfinite(roots) & (roots.real > 0.0) & (roots.imag > 0.0)
        motions = basis @ both[: len(k), known]
        size = np.einsum("ij,ij->j", motions.conj(), mass @ motions).real
        best = int(np.argmax(np.abs(held @ motions) ** 2 / size))
        root, motion = roots[known][best], motions[:, best]
        left = loss * (stiffness @ motion) + root * (damping @ motion) - root**2 * (mass @ motion)
        change = factor.solve(left.real.copy()) + 1j * factor.solve(left.imag.copy())
        if np.linalg.norm(change) <= SETTLED * np.linalg.norm(motion):
            return near_hz * float(np.sqrt(values[target])), complex(root**2 / values[target])
        for _ in range(2):
            change = change - basis @ (basis.conj().T @ change)
        basis = np.column_stack([basis, change / np.linalg.norm(change)])
    raise AssertionError("the eigenvalue does not settle")


def figures(case: Case, layers: int, size_m: float, near_hz: float) -> FloatArray:
    """Free frequency, shift, quality factor, with f^2 (1 + i/Q) the eigenvalue."""
    assert case.touch is not None
    resistance = case.touch.tip.resistance_n_s_m(1.0)
    free_hz, value = loaded(solid(case, layers, size_m), near_hz, resistance, case.quality_factor)
    return np.array([free_hz, free_hz * (np.sqrt(value.real) - 1.0), value.real / value.imag])


def compared(raw: dict[str, Any], layers: int, size_m: float, widest: float) -> None:
    """Each figure within its bar of the limit of two meshes, up to a third of their last step."""
    case = case_from_dict(raw)
    mode = touch_of(case, TerminalLog(quiet=True), mapped=False).mode
    assert mode and mode.quality_factor and mode.free_error and mode.shift_error_hz and mode.quality_error
    coarse, fine = (figures(case, number, size_m, mode.free_hz) for number in (layers - 1, layers))
    left = SHRINK ** (2.0 * EXPONENT)
    truth = fine - (coarse - fine) * left / (1.0 - left)
    ours = np.array([mode.free_hz, mode.shift_hz, mode.quality_factor])
    bars = np.array([mode.free_error * mode.free_hz, mode.shift_error_hz, mode.quality_error])
    print(
        f"free mode, shift and quality factor {ours} +- {bars}, by the whole solid {truth}, last step {fine - coarse}"
    )
    assert (np.abs(ours - truth) <= bars + 0.3 * np.abs(fine - coarse)).all()
    assert (bars[1:] < widest * np.abs(ours[1:])).all()


@pytest.mark.slow
@pytest.mark.parametrize("raw, layers, widest", [(BARE, 2, 0.05), (ROWS, 1, 0.03)], ids=["bare", "rows"])
def test_the_mode_under_a_finger_lies_within_its_bars(raw: dict[str, Any], layers: int, widest: float) -> None:
    compared(raw, layers, 4e-3, widest)
