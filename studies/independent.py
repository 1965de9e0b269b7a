"""Frequencies by other methods: Ritz for a free block, and plate and patch as solids that share their bond's nodes.

Displacements are products of Legendre polynomials in x, y and z; the eight parities do not mix. Frequencies converge from
above, fast, since stresses are bounded at the edges of a free block (visscher1991).

Nothing is condensed, reduced or extrapolated as in a driven plate, for which these are the reference.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.polynomial import legendre
from scipy.linalg import eigh

from geometry.elements import FloatArray, IntArray
from geometry.hex.boxes import Boxes, bonded_boxes, hex_mesh
from geometry.hex.scenes import Grading, HexSettings, grid_lines
from geometry.layout import Design, PillarGroup, region_materials
from geometry.materials import PIEZO_MATERIALS, Material, PiezoMaterial
from geometry.mesh import Mesh
from solvers.fem.assembly import System, assemble
from solvers.fem.factor import Factoriser
from solvers.fem.surface import face_quadrature
from solvers.piezo.patch import with_potential

RIGID = 1e-6  # of the largest eigenvalue's root: six motions have no stiffness but for rounding
SIGNS = {"S": 0, "A": 1}  # the parity of u_z
Parity = tuple[int, int, int]

SAME_M = 1e-9
NEAREST = 14  # modes of a quarter about the middle of a band, more than it holds

# of elements towards an edge, and of displacements there (williams1952), within 0.03 for all pairs
SHRINK, EXPONENT = 0.3, 0.55

LEFT = SHRINK ** (2.0 * EXPONENT)  # of the error, after one more layer
SIZE_M = 2e-3  # of elements of order 3 away from edges
UNSURE = 0.3  # of the last step: uncertainty of its extrapolation


@dataclass(frozen=True)
class _Axis:
    """Integrals over one edge of products of normalised Legendre polynomials f and their slopes, (degree + 1)^2 each."""

    slopes: FloatArray
    mixed: FloatArray  # f'_i f_j


@dataclass(frozen=True)
class BondedSolid:
    """K (N/m) and M (kg), (3n, 3n), at constant voltage; the load of a volt (3n,) in N; the patch's clamped capacitance in F;
    where the nodes lie, (n, 3), in nm; and the matrix (3n, 3 plate nodes) from the plate's own degrees of freedom. bending:
    the potential between the electrodes adds N D^-1 N' to K; its factors N (3n, p) and D (p, p).
    """

    stiffness: sp.csr_array
    mass: sp.csr_array
    load: FloatArray
    capacitance_f: float
    place_nm: IntArray
    plate: sp.csr_array
    bending: tuple[sp.csr_array, sp.csr_array]


@dataclass(frozen=True)
class BondedPlate:
    """A plate with a patch of pz26, lengths (3,) in m, in the middle of its back or its touch face."""

    design: Design
    patch_m: tuple[float, float, float]
    is_on_back: bool = True

    @property
    def box_m(self) -> FloatArray:
        """The patch's footprint x0, x1, y0, y1."""
        x, y = self.patch_m[0] / 2.0, self.patch_m[1] / 2.0
        return np.array([-x, x, -y, y])


@dataclass(frozen=True)
class SolidModes:
    """Modes of a quarter that the patch drives, ascending, rigid ones left out: frequencies in Hz and heights of their peaks,
    (k,) each, and the relative change of both by the last layer.
    """

    frequency_hz: FloatArray
    height: FloatArray
    frequency_step: FloatArray
    height_step: FloatArray


def free_block_hz(
    material: Material, size_m: tuple[float, float, float], high_hz: float, degrees: tuple[int, int, int] = (10, 10, 10)
) -> dict[str, FloatArray]:
    """Frequencies of a free block up to `high_hz`, ascending, by symmetry class: SS, SA, AS or AA of u_z in x, then in y.

    K a = (2 pi f)^2 M a with K from the strain energy of polynomials up to `degrees` along x, y and z (visscher1991). A law
    without these mirrors has the class "whole". Rigid-body motions are left out.
    """
    axes = [_axis(degree, length) for degree, length in zip(degrees, size_m, strict=True)]
    if not {"x", "y"} <= {*material.mirrors}:
        every = _class_hz(material, axes, None)
        return {"whole": every[every <= high_hz]}
    out = {}
    for name in map("".join, product("SA", repeat=2)):
        both = [_class_hz(material, axes, (SIGNS[name[0]], SIGNS[name[1]], odd)) for odd in (0, 1)]
        every = np.sort(np.concatenate(both))
        out[name] = every[every <= high_hz]
    return out


def solid_modes(bonded: BondedPlate, middle_hz: float, layers: tuple[int, int] = (1, 2)) -> SolidModes:
    """Modes about a frequency, extrapolated over the number of layers, each of which reduces the error by one factor."""
    coarse, fine = (_modes(bonded, middle_hz, each) for each in layers)
    count = min(len(coarse[0]), len(fine[0]))
    limits = [b[:count] - (a[:count] - b[:count]) * LEFT / (1.0 - LEFT) for a, b in zip(coarse, fine, strict=True)]
    steps = [np.abs(a[:count] / b[:count] - 1.0) for a, b in zip(coarse, fine, strict=True)]
    return SolidModes(limits[0], limits[1], steps[0], steps[1])


def height(frequency_hz: FloatArray, gain: FloatArray, heave: FloatArray, weights: FloatArray) -> FloatArray:
    """Mean-square u_z of each mode's peak on the touch face over volts, up to one factor for all."""
    return np.asarray(np.abs(gain) * np.sqrt(weights @ heave**2 / weights.sum()) / frequency_hz**2)


def bonded_solid(plate: System, patch: Mesh, material: PiezoMaterial, thickness_m: float) -> BondedSolid:
    """Join an assembled plate and a patch where their nodes meet."""
    both, mass, theta, capacitance = with_potential(patch, material, thickness_m)
    size = 3 * len(patch.nodes)
    place = np.round(np.vstack([plate.mesh.nodes, patch.nodes]) / SAME_M).astype(np.int64)
    unique, number = np.unique(place, axis=0, return_inverse=True)
    below, above = (_spread(own, len(unique)) for own in np.split(number.ravel(), [len(plate.mesh.nodes)]))
    unit, heavy = plate.scale.young_pa * plate.scale.length_m, sp.kron(plate.mass, sp.eye_array(3))
    return BondedSolid(
        sp.csr_array(below @ (unit * plate.stiffness) @ below.T + above @ sp.csr_array(both[:size, :size]) @ above.T),
        sp.csr_array(
            below @ (plate.scale.mass_kg * heavy) @ below.T + above @ sp.csr_array(mass[:size, :size]) @ above.T
        ),
        above @ theta[:size],
        capacitance,
        unique,
        below,
        (sp.csr_array(above @ both[:size, size:]), sp.csr_array(-both[size:, size:])),
    )


def lifted(patch: Mesh, plate: Mesh) -> Mesh:
    """A patch whose mesh starts at z = 0, on a bare plate's back."""
    return replace(patch, nodes=patch.nodes + np.array([0.0, 0.0, plate.nodes[:, 2].max()]))


def _axis(degree: int, length_m: float) -> _Axis:
    points, weights = legendre.leggauss(degree + 1)
    scale = np.sqrt((2.0 * np.arange(degree + 1) + 1.0) / length_m)
    value = legendre.legvander(points, degree) * scale
    slope = legendre.legval(points, legendre.legder(np.eye(degree + 1))).T * scale * (2.0 / length_m)
    heavy = (length_m / 2.0 * weights)[:, None]
    return _Axis(slope.T @ (heavy * slope), slope.T @ (heavy * value))


def _class_hz(material: Material, axes: list[_Axis], parity: Parity | None) -> FloatArray:
    """Frequencies above 0 of motions whose u_z has parities along x, y, z, u_x odd in x where u_z is even; of all without."""
    every = [np.arange(len(one.slopes)) for one in axes]
    kept = [every] * 3 if parity is None else [
        [np.arange((each + (axis != 2) * (axis == component) + (axis == 2) * (component != 2)) % 2, len(one.slopes), 2)
         for axis, (one, each) in enumerate(zip(axes, parity, strict=True))]
        for component in range(3)
    ]  # fmt: skip
    blocks = [[_block(material, axes, kept, i, j) for j in range(3)] for i in range(3)]
    values = eigh(np.block(blocks) / material.density_kg_m3, eigvals_only=True)
    omega = np.sqrt(np.maximum(values, 0.0))
    return np.asarray(omega[omega > RIGID * omega[-1]] / (2.0 * np.pi))


def _block(material: Material, axes: list[_Axis], kept: list[list[IntArray]], i: int, j: int) -> FloatArray:
    """Stiffness between the displacements i and j: C_ikjl d_k u_i d_l u_j."""
    law = material.tensor_pa[i, :, j]
    return np.asarray(
        sum(law[left, right] * _product(axes, kept, i, j, left, right) for left, right in np.argwhere(law))
    )


def _product(axes: list[_Axis], kept: list[list[IntArray]], i: int, j: int, left: int, right: int) -> FloatArray:
    """Integral of d_left f d_right g over the block, f and g the functions of the displacements i and j."""
    out: FloatArray = np.ones((1, 1))
    for axis, one in enumerate(axes):
        same = np.eye(len(one.slopes))
        kinds = {(1, 1): one.slopes, (1, 0): one.mixed, (0, 1): one.mixed.T, (0, 0): same}
        matrix = kinds[left == axis, right == axis]
        out = np.asarray(np.kron(out, matrix[np.ix_(kept[i][axis], kept[j][axis])]))
    return np.asarray(out)


def _modes(bonded: BondedPlate, middle_hz: float, layers: int) -> tuple[FloatArray, FloatArray]:
    """Frequencies and heights: a quarter of plate, pillars and patch as one solid between two mirrors."""
    boxes = _plate(bonded, layers)
    plate, patch = hex_mesh(boxes, 3), _patch(bonded, boxes, layers)
    system = assemble(plate, region_materials(bonded.design.stack, bonded.design.pillar))
    joined, scale = bonded_solid(system, patch, PIEZO_MATERIALS["pz26"], bonded.patch_m[2]), system.scale
    unit = scale.young_pa * scale.length_m
    moves = np.column_stack([joined.place_nm[:, :2] != 0, np.ones(len(joined.place_nm), dtype=bool)])
    free = np.flatnonzero(moves)
    coupling, dielectric = (each / unit for each in joined.bending)
    stiffness = sp.block_array(
        [[joined.stiffness[free][:, free] / unit, coupling[free]], [coupling[free].T, -dielectric]], format="csc"
    )
    heavy = joined.mass[free][:, free] / scale.mass_kg
    mass = sp.block_diag([heavy, sp.csc_array(dielectric.shape)], format="csc")
    values, vectors = _nearest(sp.csc_array(stiffness), sp.csc_array(mass), scale.eigenvalue(middle_hz))
    tones = scale.frequency(np.maximum(values, 0.0))
    inside = tones > 1e-3 * tones.max()
    moved = np.zeros((moves.size, int(inside.sum())))
    moved[free] = vectors[: len(free), inside]
    touch = face_quadrature(plate, "touch")
    heave = touch.interpolation @ (joined.plate.T @ moved)[2::3]
    return tones[inside], height(tones[inside], joined.load / unit @ moved, heave, touch.weights)


def _plate(bonded: BondedPlate, layers: int) -> Boxes:
    """The quarter x, y >= 0 of plate and pillars."""
    design = bonded.design
    reach = design.footprint_m / 2.0 if design.rows else 0.0
    stands = tuple(
        PillarGroup(each.pillar, each.centres[(each.centres > -reach).all(axis=1)]) for each in design.standing()
    )
    span = np.array([0.0, design.length_m / 2.0, 0.0, design.half_span_m])
    settings = HexSettings(3, SIZE_M, layers, SHRINK)
    return bonded_boxes(span, design.stack, stands, bonded.box_m, bonded.is_on_back, settings)


def _patch(bonded: BondedPlate, plate: Boxes, layers: int) -> Mesh:
    """The quarter of the patch, along the plate's own lines."""
    box, thick, back = bonded.box_m, bonded.patch_m[2], bonded.is_on_back
    x, y = (lines[lines < edge + SAME_M] for lines, edge in ((plate.x, box[1]), (plate.y, box[3])))
    bond = bonded.design.thickness_m if back else 0.0
    end = bond + thick if back else -thick
    z = grid_lines({bond: True, end: False}, Grading(SIZE_M, layers, SHRINK))
    return hex_mesh(Boxes(x, y, z, np.zeros((len(x) - 1, len(y) - 1, len(z) - 1), dtype=np.int64), ("patch",)), 3)


def _nearest(stiffness: sp.csc_array, mass: sp.csc_array, shift: float) -> tuple[FloatArray, FloatArray]:
    """The modes nearest to a scaled eigenvalue, ascending: K is indefinite in the potential, M has nothing there."""
    factor = Factoriser()(sp.csc_array(stiffness - shift * mass))
    inverse = spla.LinearOperator(stiffness.shape, matvec=factor.solve, dtype=float)
    start = factor.solve(mass @ np.ones(stiffness.shape[0]))
    values, vectors = spla.eigsh(stiffness, NEAREST, mass, sigma=shift, OPinv=inverse, v0=start)
    upwards = np.argsort(values)
    return values[upwards], vectors[:, upwards]


def _spread(nodes: IntArray, count: int) -> sp.csr_array:
    """Map from the degrees of freedom of some nodes to those of all."""
    places = (3 * nodes[:, None] + np.arange(3)).ravel()
    return sp.coo_array((np.ones(len(places)), (places, np.arange(len(places)))), (3 * count, len(places))).tocsr()
