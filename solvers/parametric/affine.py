"""A panel with one pillar as an exactly affine function of its sizes, and the foot whose shape stays alike.

A round or hexagonal section stands in a square block of the plate that grows with it, so that beyond the block every stretch
is along the axes, as it is for a section made of boxes (rozza2008).

The mesh keeps its topology; the plate's block under the pillar, the plate around it and the pillar are each stretched as a
whole. The lattice keeps its shape: its vectors and the panel go with the pitch. A stretch (s_x, s_y, s_z) turns
int C_ikjl u_i,k v_j,l into s_x s_y s_z / (s_k s_l) times what it was, so that K(mu) = sum_q theta_q(mu) K_q and M(mu)
likewise, theta_q products of powers of side, clearances, thickness, height and pitch (rozza2008). Nothing is interpolated.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np
import scipy.sparse as sp
from scipy.stats import qmc

from geometry.elements import FloatArray, IntArray
from geometry.hex.panels import (
    CORNERS,
    Patch,
    PlanLines,
    beside,
    boxes_of_patch,
    disc,
    hexagon,
    joined,
    leaning,
    straight,
)
from geometry.hex.scenes import Grading, grid_lines
from geometry.lattice import Lattice, Path
from geometry.layout import Pillar
from geometry.materials import Material
from geometry.mesh import Mesh
from solvers.errors import SolverError
from solvers.fem.assembly import Forms, Scale

BLOCK = 1.1  # width of a round or hexagonal pillar's block over the pillar's largest
UNDER, BESIDE = 2, 3  # numbers of the stretches of block and clearance

THICKNESS, HEIGHT, SIDE, PITCH = range(4)
NAMES = ("thickness", "height", "side", "pitch")
SAME = 1e-9
CLEARANCE_M = 0.5e-3  # between neighbouring pillars: a narrower slit is not printed, and its elements degenerate
OUTSIDE = "{name} = {value:g} mm: must lie between {low:g} and {high:g} mm"
TIGHT = "side = {side:g} mm does not fit pitch = {pitch:g} mm: at least {gap:g} mm must stay between two pillars"
TIGHT_PANEL = TIGHT.replace("between two pillars", "next to it in a panel {narrow:g} pitches wide")
ACROSS, WHOLE = 4, 5  # numbers of the stretches of the clearance along y if panels are not square, and of the pitch
IN_LINE = Lattice.of_rows(1.0, 1.0)
Sizes = tuple[float, float, float, float]
Exponents = tuple[int, ...]  # of thickness, height, side, clearances along x and y, pitch


@dataclass(frozen=True)
class FixedMesh:
    """Order and elements of the one topology: even intervals of each part, layers graded towards the pillar's foot."""

    order: int = 3
    under: int = 1
    beside: int = 2
    through: int = 1
    along: int = 4
    layers: int = 2
    factor: float = 0.2


@dataclass(frozen=True)
class Foot:
    """A section over its width: round, hexagonal, or a square or cross with arms so wide; the width of the tip over that of the
    foot.
    """

    round: bool = False
    arm: float = 1.0
    taper: float = 1.0
    hexagonal: bool = False

    @property
    def is_alike(self) -> bool:
        """Whether the section is its own image with x and y exchanged."""
        return not self.hexagonal

    @property
    def footprint(self) -> float:
        """Largest extent of the foot over its width: a hexagon's is across corners, along x."""
        return float(CORNERS) if self.hexagonal else 1.0

    @property
    def reach(self) -> float:
        """Width of the block that grows with the pillar, over the pillar's."""
        return BLOCK * self.footprint if self.round or self.hexagonal else 1.0

    @property
    def widest(self) -> float:
        """Largest extent at any height over the width of the foot."""
        return max(1.0, self.taper) * self.footprint


SQUARE = Foot()


@dataclass(frozen=True)
class DesignBox:
    """Lowest and highest thickness, height, side (the foot's width) and pitch, m; pillars stand `clearance_m` apart or more.

    lattice: the rows', in pitches along x. Staggered rows have a second, bare panel for each pillar.
    """

    low: Sizes = (1e-3, 4e-3, 1e-3, 3e-3)
    high: Sizes = (3e-3, 9e-3, 3e-3, 8e-3)
    clearance_m: float = CLEARANCE_M
    foot: Foot = SQUARE
    lattice: Lattice = IN_LINE

    @property
    def panels(self) -> int:
        """Panels side by side in a pitch: one with the pillar, of staggered rows a bare one, too."""
        return 1 + self.lattice.is_centred

    @property
    def panel(self) -> tuple[float, float]:
        """Width and depth of a panel, in pitches."""
        width, depth = self.lattice.cell_m
        return width / self.panels, depth

    @property
    def narrow(self) -> float:
        """The smaller of both."""
        return min(self.panel)

    @property
    def is_square(self) -> bool:
        """Whether a cell is one square panel."""
        return self.lattice == IN_LINE

    @property
    def is_alike(self) -> bool:
        """Whether the cell is its own image with x and y exchanged."""
        return self.is_square and self.foot.is_alike

    def path(self, points: int) -> Path:
        """The border of the zone's irreducible part, wavevectors in radians a pitch."""
        return self.lattice.path(self.lattice.border(("x", "y", "d") if self.is_alike else ("x", "y")), points)

    def panel_m(self, sizes: FloatArray | Sizes) -> tuple[float, float, float]:
        """Width, depth and thickness of a design's panels, m."""
        width, depth = self.panel
        return float(width * sizes[PITCH]), float(depth * sizes[PITCH]), float(sizes[THICKNESS])

    def share(self, sizes: FloatArray | Sizes) -> float:
        """The block's width over the panel's smaller one."""
        return float(self.foot.reach * sizes[SIDE] / (self.narrow * sizes[PITCH]))

    def about(self, sizes: Sizes) -> DesignBox:
        """The box laid about a design: the limits of each length that it does not hold times a factor of one digit, and the
        clearance with the smaller one of side and pitch.
        """
        factors = [
            1.0 if low <= size <= high else float(f"{size / np.sqrt(low * high):.1g}")
            for size, low, high in zip(sizes, self.low, self.high, strict=True)
        ]
        low, high = (as_sizes(np.array([factors]) * ends)[0] for ends in (self.low, self.high))
        return replace(self, low=low, high=high, clearance_m=min(factors[SIDE], factors[PITCH]) * self.clearance_m)

    def faults(self, sizes: FloatArray | Sizes) -> list[str]:
        """What keeps a cell out of the box, one sentence each, by name; empty for one inside."""
        said = []
        for name, value, low, high in zip(NAMES, sizes, self.low, self.high, strict=True):
            if not low * (1.0 - 1e-9) <= value <= high * (1.0 + 1e-9):
                said.append(OUTSIDE.format(name=name, value=1e3 * value, low=1e3 * low, high=1e3 * high))
        gap = self.narrow * sizes[PITCH] - self.foot.widest * sizes[SIDE]
        if not gap >= self.clearance_m * (1.0 - 1e-9):
            gap_mm = 1e3 * self.clearance_m
            own = {"side": 1e3 * sizes[SIDE], "pitch": 1e3 * sizes[PITCH], "gap": gap_mm, "narrow": self.narrow}
            said.append(self.tight.format(**own))
        return said

    @property
    def tight(self) -> str:
        """The sentence about a pillar too wide for its panel."""
        return TIGHT if self.is_square else TIGHT_PANEL

    def require(self, sizes: FloatArray | Sizes) -> None:
        """SolverError that names what does not fit."""
        said = self.faults(sizes)
        if said:
            raise SolverError("; ".join(said))

    def sample(self, unit: FloatArray) -> FloatArray:
        """Designs (n, 4) in m from points (n, 4) of the unit cube, even in the logarithms of the stretches; all of them fit."""
        unit = np.atleast_2d(unit)
        low, high = np.log(self.low), np.log(self.high)
        sizes = np.exp(low + unit * (high - low))
        side = self.foot.widest * sizes[:, SIDE] / self.narrow
        least = np.maximum(self.low[PITCH] - side, self.clearance_m / self.narrow)
        sizes[:, PITCH] = side + least * ((self.high[PITCH] - side) / least) ** unit[:, PITCH]
        return np.asarray(sizes)

    def unit(self, sizes: Sizes) -> FloatArray:
        """The point (4,) of the unit cube that `sample` takes to a design of the box."""
        low, high = np.log(self.low), np.log(self.high)
        unit = (np.log(sizes) - low) / (high - low)
        side = self.foot.widest * sizes[SIDE] / self.narrow
        least = max(self.low[PITCH] - side, self.clearance_m / self.narrow)
        unit[PITCH] = np.log((sizes[PITCH] - side) / least) / np.log((self.high[PITCH] - side) / least)
        return np.asarray(np.clip(unit, 0.0, 1.0))

    def spread(self, count: int, seed: int = 1) -> list[Sizes]:
        """The box's sixteen corners and `count` designs between them, the same at every call."""
        corners = np.array(list(product((0.0, 1.0), repeat=4)))
        return as_sizes(self.sample(np.vstack([corners, between(count, seed)])))

    @property
    def middle(self) -> Sizes:
        """Geometric mean of the limits, m: where the reference mesh stands."""
        t, h, a, p = np.sqrt(np.array(self.low) * np.array(self.high))
        return float(t), float(h), float(a), float(max(p, (self.foot.widest * a + self.clearance_m) / self.narrow))


@dataclass(frozen=True)
class AffineForm:
    """sum_q theta_q A_q: exponents (q, 6) of the stretches over their reference, matrices A_q."""

    exponents: IntArray
    matrices: tuple[sp.csr_array, ...]


class AffineCell:
    """The quarter panel x, y >= 0 on its reference mesh, with the affine forms of K (3n, 3n) and of the scalar mass (n, n).

    Matrices are in units of `scale`, whose length is the reference thickness.
    """

    def __init__(self, box: DesignBox, mesh: FixedMesh, plate: Material, pillar: Material) -> None:
        self.box, self.reference = box, box.middle
        self.scale = Scale.of(self.reference[THICKNESS], plate)
        self.plate = plate
        self.mesh, self.parts = quarter_mesh(box.foot, self.reference, mesh, box.panel)
        if not box.is_square:
            self.parts[:, 1] = np.where(self.parts[:, 1] == BESIDE, ACROSS, self.parts[:, 1])
        materials = {"plate": plate, "pillar": pillar}
        forms = Forms(self.mesh, self.scale.length_m)
        self.stiffness = self._stiffness(forms, materials)
        self.mass = self._mass(forms, materials)

    def _stiffness(self, forms: Forms, materials: dict[str, Material]) -> AffineForm:
        groups: dict[Exponents, FloatArray] = {}
        whole = np.zeros((len(self.mesh.cells), 3, 3, 3, 3))
        for name, cells in self.mesh.regions.items():
            whole[cells] = materials[name].tensor_pa / self.scale.young_pa
        for part, k, l in product(np.unique(self.parts, axis=0), range(3), range(3)):  # noqa: E741  as in C_ikjl
            cells = np.flatnonzero((self.parts == part).all(axis=1))
            tensor = groups.setdefault(_exponents(part, (k, l)), np.zeros_like(whole))
            tensor[cells, :, k, :, l] += whole[cells, :, k, :, l]
        ordered = sorted(groups)
        return AffineForm(np.array(ordered), tuple(forms.stiffness(groups[key]) for key in ordered))

    def _mass(self, forms: Forms, materials: dict[str, Material]) -> AffineForm:
        groups: dict[Exponents, FloatArray] = {}
        density = np.zeros(len(self.mesh.cells))
        for name, material in materials.items():
            density[self.mesh.regions[name]] = material.density_kg_m3 / self.scale.density_kg_m3
        for part in np.unique(self.parts, axis=0):
            cells = np.flatnonzero((self.parts == part).all(axis=1))
            groups.setdefault(_exponents(part, ()), np.zeros_like(density))[cells] = density[cells]
        ordered = sorted(groups)
        return AffineForm(np.array(ordered), tuple(forms.mass(groups[key]) for key in ordered))

    def theta(self, form: AffineForm, sizes: FloatArray | Sizes) -> FloatArray:
        """The form's factors for one design, (q,)."""
        return theta(form.exponents, sizes, self.reference, self.box)

    def plan(self, nodes: FloatArray, sizes: FloatArray | Sizes) -> FloatArray:
        """Places of reference points (n, 3) in the stretched cell, m."""
        t0, h0, a0, _ = self.reference
        t, h, a, _ = sizes
        flat = across(nodes[:, :2], self.reference, sizes, self.box)
        flat = np.where(nodes[:, 2:] > t0 * (1.0 + SAME), nodes[:, :2] * (a / a0), flat)
        return np.column_stack([flat, np.interp(nodes[:, 2], [0.0, t0, t0 + h0], [0.0, t, t + h])])


def foot_of(pillar: Pillar) -> Foot | None:
    """Return the section of a pillar that grows with its width.

    Parameters
    ----------
    pillar : Pillar
        The pillar.

    Returns
    -------
    Foot or None
        None for a pillar whose section does not.
    """
    if not pillar.is_plain:
        return None
    known = {
        "square": Foot(),
        "tapered": Foot(taper=pillar.form.taper),
        "cross": Foot(arm=pillar.form.size_m("arm_m") / pillar.base_m),
        "round": Foot(round=True),
        "hexagonal": Foot(hexagonal=True),
    }
    return known.get(pillar.shape)


def quarter_mesh(
    foot: Foot, sizes: tuple[float, float, float, float], mesh: FixedMesh, panel: tuple[float, float] = (1.0, 1.0)
) -> tuple[Mesh, IntArray]:
    """Mesh the quarter panel x, y >= 0, with z = 0 the touch face.

    Parameters
    ----------
    foot : Foot
        Section of the pillar.
    sizes : tuple of float
        Thickness, height, width and pitch, in m.
    mesh : FixedMesh
        Numbers of elements and their order.
    panel : tuple of float, optional
        Sides of the panel, in units of the pitch.

    Returns
    -------
    mesh : Mesh
        Nodes in m.
    stretched : ndarray of int, shape (e, 3)
        Which stretch acts on each element along x, y and z.
    """
    t, h, _, _ = sizes
    z = np.concatenate(
        [_part(0.0, t, mesh.through, (False, True), mesh), _part(t, t + h, mesh.along, (True, False), mesh)[1:]]
    )
    patches = list(_plan(foot, sizes, panel, mesh))
    own = leaning(joined(patches, z, t, mesh.order).mesh, np.zeros(2), t, h, foot.taper)
    return own, _stretched(patches, z, t)


def between(count: int, seed: int) -> FloatArray:
    """Spread points evenly over the unit cube (a scrambled Halton sequence).

    Parameters
    ----------
    count : int
        Number of points.
    seed : int
        Seed of the scrambling.

    Returns
    -------
    ndarray, shape (count, 4)
        From 0 to 1.
    """
    return np.asarray(qmc.Halton(4, seed=seed).random(count))


def as_sizes(designs: FloatArray) -> list[Sizes]:
    """Convert rows to designs.

    Parameters
    ----------
    designs : ndarray, shape (n, 4)
        Thickness, height, side and pitch, in m.

    Returns
    -------
    list of tuple of float
        The same, in m.
    """
    return [(float(t), float(h), float(a), float(p)) for t, h, a, p in designs]


def _stretches(sizes: FloatArray | Sizes, box: DesignBox) -> FloatArray:
    """Thickness, height, side, what lies between the blocks along x and along y, and the pitch: what the parts of the mesh are
    stretched by.
    """
    t, h, a, p = sizes
    width, depth = (side * p - box.foot.reach * a for side in box.panel)
    return np.array([t, h, a, width, depth, p])


def theta(exponents: IntArray, sizes: FloatArray | Sizes, reference: Sizes, box: DesignBox) -> FloatArray:
    """Compute the coefficients theta_q of a design's affine forms.

    Parameters
    ----------
    exponents : ndarray of int, shape (q, 6)
        Powers of the stretches.
    sizes : ndarray, shape (4,), or tuple
        The design, in m.
    reference : tuple of float
        The reference design, in m.
    box : DesignBox
        Its panel and foot.

    Returns
    -------
    ndarray, shape (q,)
        Dimensionless.
    """
    ratio = _stretches(sizes, box) / _stretches(reference, box)
    return np.asarray(np.prod(ratio ** np.asarray(exponents), axis=1))


def across(points: FloatArray, reference: Sizes, sizes: FloatArray | Sizes, box: DesignBox) -> FloatArray:
    """Map reference coordinates to places in the stretched plate.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        x and y on the reference design, in m.
    reference : tuple of float
        The reference design, in m.
    sizes : ndarray, shape (4,), or tuple
        The design, in m.
    box : DesignBox
        Its panel and foot.

    Returns
    -------
    ndarray, shape (n, 2)
        In m.
    """
    lines = zip(points.T, plan_lines(reference, box), plan_lines(sizes, box), strict=True)
    return np.column_stack([np.interp(own, was, now) for own, was, now in lines])


def plan_lines(sizes: FloatArray | Sizes, box: DesignBox) -> list[list[float]]:
    """List the quarter panel's middle, the end of its block and its side, along x and y.

    Parameters
    ----------
    sizes : ndarray, shape (4,), or tuple
        The design, in m.
    box : DesignBox
        Its panel and foot.

    Returns
    -------
    list of list of float
        Two lists of three, in m.
    """
    block = box.foot.reach * float(sizes[SIDE]) / 2.0
    return [[0.0, block, side / 2.0] for side in box.panel_m(sizes)[:2]]


def _plan(
    foot: Foot, sizes: tuple[float, float, float, float], panel: tuple[float, float], mesh: FixedMesh
) -> Iterator[Patch]:
    _, _, a, p = sizes
    block = foot.reach * a / 2.0
    along, across = (_part(block, side * p / 2.0, mesh.beside, (True, False), mesh) for side in panel)
    if not foot.round and not foot.hexagonal:
        return _bars(foot, a, (along, across), mesh)
    inner = _part(0.0, 1.0, 1 if foot.round else mesh.under, (False, True), mesh)
    fill = _part(0.0, 1.0, 1, (True, False), mesh, less=1)
    lines = PlanLines(np.linspace(0.0, 1.0, mesh.under + 1), inner, fill, (along, across))
    return (disc if foot.round else hexagon)(a / 2.0, (block, block), lines)


def _part(low: float, high: float, count: int, ends: tuple[bool, bool], mesh: FixedMesh, less: int = 0) -> FloatArray:
    layers = max(mesh.layers - less, 0)
    return grid_lines({low: ends[0], high: ends[1]}, Grading((high - low) / count, layers, mesh.factor))


def _bars(foot: Foot, a: float, around: tuple[FloatArray, FloatArray], mesh: FixedMesh) -> Iterator[Patch]:
    """Square or cross of width a: lines along the axes."""
    edges = [0.0, foot.arm * a / 2.0, a / 2.0] if foot.arm < 1.0 else [0.0, a / 2.0]
    inner = [_part(low, high, mesh.under, (low > 0.0, True), mesh) for low, high in pairwise(edges)]
    under = np.concatenate([[0.0], *(one[1:] for one in inner)])
    middle = (under[1:] + under[:-1]) / 2.0 < foot.arm * a / 2.0
    yield Patch(under, under, straight, (middle[:, None] | middle).astype(float))
    yield from beside(under, under, around)


def _stretched(patches: list[Patch], z: FloatArray, thickness: float) -> IntArray:
    """For each element the numbers of the stretches along x, y and z."""
    rows = []
    for patch in patches:
        region = boxes_of_patch(patch, z, thickness).region.transpose(2, 1, 0)  # elements come x fastest
        own = region[region >= 0]
        x, y = (UNDER if block else BESIDE for block in patch.block)
        rows.append(np.column_stack([np.full(len(own), x), np.full(len(own), y), own]))
    return np.concatenate(rows)


def _exponents(part: IntArray, derived: tuple[int, ...]) -> Exponents:
    """Of an element whose stretches are `part`, differentiated along the axes `derived`."""
    powers = [0, 0, 0, 0, 0, 0]
    for axis in range(3):
        powers[int(part[axis])] += 1
    for axis in derived:
        powers[int(part[axis])] -= 1
    return tuple(powers)
