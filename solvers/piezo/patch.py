"""A piezo patch as a bonded solid, condensed to its bonded face, and the static correction of the plate beneath it.

K_E u + N p - theta V = f,  N'u - E p = 0,  Q = theta' u + C V, with theta = int B' e' (grad V) dV for a field V/t across the
thickness and p the additional potential, 0 on both electrodes: N = int B' e' grad, E = int grad' eps grad (ieee176, allik1970).
Bending makes the field uneven and so stiffens a patch about its own middle. The patch's own resonances lie far above, so
its inner nodes follow statically (guyan1965). Their inertia while a volt expands them adds omega^2 M_i K_ii^-1 theta_i to
the load.

F = N K^-1 N' - E K_r^-1 E': static displacements per force of the bonded face on a fine mesh of all panels beneath the patch,
graded towards its edges, less the same of those panels' reduced matrices, both with the border around these panels clamped
(macneal1971). The reduced plate itself gives their motion beyond that border.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import product
from math import pi
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from geometry.elements import BoolArray, FloatArray, IntArray
from geometry.hex.boxes import Boxes, bonded_boxes, hex_mesh
from geometry.hex.scenes import HexSettings, grid_lines
from geometry.layout import Design, PillarGroup, mirrored_axes
from geometry.materials import VOIGT, Layer, Material, PiezoMaterial, Stack
from geometry.mesh import Mesh
from geometry.tiling import Tiling, signature
from solvers.accuracy.mesh import ErrorFractions, rim_shares
from solvers.errors import TooLarge
from solvers.fem.assembly import Forms, System
from solvers.fem.factor import Factor, Factoriser, parallel_map
from solvers.fem.solid import constrain, free_mask
from solvers.fem.surface import SAME_M, face_quadrature, grid_weights
from solvers.machine import check_room
from solvers.plates.assembled import Cache, Reductions
from solvers.superelement.bond import Contact, JoinedPanels, Panels, between, mirror_signs, positive_part
from solvers.superelement.plate import AssembledPlate

MESH = HexSettings(3, 4e-3, 1, 0.15)  # along the patch a quarter of a half-wavelength of 15 mm, shorter at its edges
COPIES = 4  # of the nodes' motions and potential inside per bonded one, held at once
SQUARES = 6  # of matrices of the bonded face, held at once
SAME = 1e-9  # of the thickness: one place
APART = 1e-6  # of a length: nodes are farther from each other
OWN = 1e-6  # relative tolerance of a patch's own resonance
BASIS = 10  # Lanczos vectors of a lowest resonance
KEPT = ("points", "projection", "stiffness", "mass", "theta", "swell", "capacitance_f", "own_hz", "lost")
CLASSES = ("SS", "SA", "AS", "AA")
_Own = tuple[PiezoMaterial, float, float, float, bool, HexSettings, Layer | None]  # key of a patch, wherever it is
_Matrices = tuple[sp.csr_array, sp.csr_array, FloatArray, float, sp.csr_array | None]

WAVE = 3.75  # elements along a half-wavelength of the target shape, at least
FOOT = 0.5  # of foot and thickness, the longest element of a patch over pillars: its plate bends between their feet
COLUMNS = 240  # of forces solved for at once
ROUGH = 0.35  # of the share: one radial function stands for both bodies at all edges and corners of a patch


@dataclass(frozen=True)
class BondedPatch:
    """A patch at its place, condensed to the nodes of its bonded face.

    points (q, 2) in m on that face, projection (b, q): the nodes' displacements are those of its field nearest to u at the
    points in the mean square, so that forces pass through the whole face and not at nodes. stiffness and mass (3b, 3b) in N/m
    and kg at constant voltage; theta (3b,) in N/V = C/m; swell (3b,) in kg m/V, force per volt and squared angular frequency;
    capacitance_f with the bonded face clamped. box_m: the footprint x0, x1, y0, y1; mesh: elements, shorter at its edges.
    own_hz: its lowest resonance on a bonded face that is held; far below it alone the patch follows statically. glue: between
    patch and plate, whose face is then the bonded one. lost (3b, 3b): stiffness times the loss factors; None where one is not
    known.
    """

    material: PiezoMaterial
    box_m: FloatArray
    thickness_m: float
    mesh: HexSettings

    points: FloatArray
    projection: FloatArray
    stiffness: FloatArray
    mass: FloatArray
    theta: FloatArray
    swell: FloatArray
    capacitance_f: float
    own_hz: float
    lost: FloatArray | None = None
    glue: Layer | None = None


class PatchCache(Protocol):
    """Store of patches between runs."""

    def load(self, key: str) -> dict[str, Any] | None:
        """Return the arrays stored under this key, or None."""
        ...

    def keep(self, key: str, flat: dict[str, Any]) -> None:
        """Store arrays under a key."""
        ...


@dataclass(frozen=True)
class _Where:
    """Cache of a patch, which does not belong to its key."""

    cache: PatchCache | None = field(default=None, compare=False)


@dataclass
class StaticCorrection:
    """Static correction beneath the patches of one plate: equal places are computed once, cached ones not at all."""

    reductions: Reductions
    cache: Cache[FloatArray] | None = None
    _known: dict[str, FloatArray] = field(default_factory=dict)

    def flexibility(self, plate: AssembledPlate, patch: BondedPatch, back: bool) -> FloatArray:
        """F at the nodes of a patch's bonded face, (3 b, 3 b), in the plate's scale. Raises SolverError for a panel that
        carries a pillar there.
        """
        return self._missing_flexibility(plate, _Place.of(plate, patch, self.reductions, back))

    def shares(self, patch: BondedPatch, back: bool) -> ErrorFractions:
        """Error fractions beneath a patch for the mesh without its innermost layer."""
        ceramic = patch.material
        alike = Material.isotropic(ceramic.name, 1.0 / ceramic.s11, ceramic.density_kg_m3, -ceramic.s12 / ceramic.s11)
        alike = patch.glue.material if patch.glue else alike
        stack = self.reductions.stack
        shares = rim_shares(stack.back if back else stack.touch, alike, patch.mesh)
        return replace(shares, uncertainty=shares.uncertainty + ROUGH * shares.correction)

    def loss_factor(self, back: bool) -> float | None:
        """Loss factor of the plate beneath; None where it is not known."""
        stack = self.reductions.stack
        return (stack.back if back else stack.touch).loss_factor

    def prepare(self, plate: AssembledPlate, patches: Iterable[BondedPatch], back: bool) -> None:
        """Compute what `flexibility` will need, distinct places in parallel."""
        places = {place.key: place for place in (_Place.of(plate, each, self.reductions, back) for each in patches)}
        parallel_map(lambda place: self._missing_flexibility(plate, place), places.values())

    def _missing_flexibility(self, plate: AssembledPlate, place: _Place) -> FloatArray:
        """Flexibility of the fine mesh that the reduced panels lack, its positive part."""
        if place.key not in self._known:
            name = ("lacking", *self.made_of(place.panels))
            self._known[place.key] = self.kept(name, place.key, lambda: self._more(plate, place))
        return self._known[place.key]

    def made_of(self, panels: Panels) -> tuple[object, ...]:
        """Key of reduced panels, in addition to their place."""
        own, tiling = self.reductions, panels.grid.tiling
        signatures = [signature(tiling.panel(*each)) for each in panels.places]
        return type(own).__name__, own.reduction, own.mesher_name, signatures

    def _more(self, plate: AssembledPlate, place: _Place) -> FloatArray:
        fine = self.kept(("beneath",), place.key, lambda: self._static(place))
        contact = Contact(place.patch.points, place.patch.projection, place.back)
        # panels meshed finer than their patch lack nothing of it
        return positive_part(fine - JoinedPanels(place.panels, plate).flexibility(contact))

    def kept(self, what: tuple[object, ...], place: str, computed: Callable[[], FloatArray]) -> FloatArray:
        """A symmetric matrix of a place from the cache, or computed and kept there."""
        own = self.reductions
        name = repr((what, place, own.stack, own.pillar))
        key = hashlib.sha256(name.encode()).hexdigest()
        kept = self.cache.get(key) if self.cache is not None else None
        if kept is not None:
            return kept
        matrix = computed()
        if self.cache is not None:
            self.cache.put(key, matrix)
        return matrix

    def _static(self, place: _Place) -> FloatArray:
        """N K^-1 N' on the fine mesh, one mirror class after the other where the place is its own mirror image."""
        system = self.reductions.system(place.fine_mesh)
        classes = product("SA", repeat=len(place.mirrors))
        given = sum(
            self._static_class(place, system, dict(zip(place.mirrors, marks, strict=True))) for marks in classes
        )
        return np.asarray((given + np.transpose(given)) / 2.0)

    def _static_class(self, place: _Place, system: System, marks: Mapping[int, str]) -> FloatArray:
        """N K^-1 N' of the fields of one class, S or A about each axis; mirrored loads are solved once."""
        mesh = system.mesh
        planes = {("x-", "y-")[axis]: mark for axis, mark in marks.items()}
        pencil = constrain(system, free_mask(mesh, set(place.panels.clamped) - set(planes), planes))
        turned, means = place.distinct("".join(marks.get(axis, "S") for axis in (0, 1)))
        loads = sp.csc_array(means[:, np.flatnonzero(pencil.free)].T)
        try:
            factor = Factoriser()(sp.csc_array(pencil.stiffness))
        except TooLarge as fault:
            size = " x ".join(f"{1e3 * each:g}" for each in np.diff(place.box_m)[::2])
            pillars = sum(len(each.centres) for each in place.stands)
            raise TooLarge(f"a patch of {size} mm over {pillars} pillars: {fault}; use shorter patches") from fault
        parts = np.array_split(np.arange(loads.shape[1]), -(-loads.shape[1] // COLUMNS))
        given = np.hstack([loads.T @ factor.solve(loads[:, part].toarray()) for part in parts])
        return np.asarray(turned @ (turned @ given).T) / 2.0 ** len(marks)


@dataclass(frozen=True)
class _Place:
    """A patch on the panels beneath it, with their pillars."""

    panels: Panels
    stands: tuple[PillarGroup, ...]
    patch: BondedPatch
    back: bool
    stack: Stack

    @classmethod
    def of(cls, plate: AssembledPlate, patch: BondedPatch, reductions: Reductions, back: bool) -> _Place:
        """Place of a patch on a plate of such panels."""
        panels = Panels.beneath(plate.grid, patch.box_m, reductions.stack.thickness_m)
        return cls(panels, panels.stands(reductions.pillar), patch, back, reductions.stack)

    @cached_property
    def mirrors(self) -> tuple[int, ...]:
        """The axes about which panels, pillars, clamped sides, patch and the elements are their own mirror image."""
        clamped, boxes = self.panels.clamped, self._boxes(())
        bodies = [self.box_m[None], *(np.repeat(each.centres, 2, axis=1) for each in self.stands)]
        even = np.all([mirrored_axes(each) for each in bodies], axis=0)
        return tuple(
            axis
            for axis, (name, lines) in enumerate(zip("xy", (boxes.x, boxes.y), strict=True))
            if name in self.stack.mirrors
            and (f"{name}-" in clamped) == (f"{name}+" in clamped)
            and even[axis]
            and np.abs(lines).min() < SAME_M
            and (not self.stands or self.panels.grid.tiling.mirrored)
        )

    @cached_property
    def fine_mesh(self) -> Mesh:
        """Panels and pillars about their middle, graded towards the patch's edges; of a mirrored place the part beyond 0."""
        return hex_mesh(self._boxes(self.mirrors), self.patch.mesh.order)

    def _boxes(self, mirrors: tuple[int, ...]) -> Boxes:
        span, axes = self.panels.span_m.copy(), list(mirrors)
        span.reshape(2, 2)[axes, 0] = 0.0
        stands = tuple(
            PillarGroup(each.pillar, each.centres[(each.centres[:, axes] > -each.pillar.footprint_m / 2.0).all(axis=1)])
            for each in self.stands
        )
        return bonded_boxes(span, self.stack, stands, self.box_m, self.back, self.patch.mesh)

    def distinct(self, symmetry: str) -> tuple[sp.csr_array, sp.csr_array]:
        """Map to the motion of all nodes of the bonded face, (3 b, 3 a), of that of those which are no other's image, in
        fields of one class; and that one as means of u at the fine mesh's nodes, (3 a, 3 n).
        """
        mesh, project, points = self.fine_mesh, self.patch.projection, self.patch.points - self.panels.middle_m
        folded, flips = self._folded(points)
        on = np.flatnonzero(np.abs(mesh.nodes[:, 2] - (self.stack.thickness_m if self.back else 0.0)) < SAME_M)
        weights = grid_weights(mesh.nodes[on, :2], mesh.order, folded)
        own, turned = self._images(project @ points, symmetry)
        signs = mirror_signs(symmetry, flips)
        parts = [sp.coo_array(project[own] @ (signs[:, axis, None] * weights)) for axis in range(3)]
        rows = np.concatenate([3 * part.row + axis for axis, part in enumerate(parts)])
        columns = np.concatenate([3 * on[part.col] + axis for axis, part in enumerate(parts)])
        values = np.concatenate([part.data for part in parts])
        return turned, sp.csr_array((values, (rows, columns)), shape=(3 * len(own), 3 * len(mesh.nodes)))

    def _folded(self, places_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Places (p, 2) beyond the mirrors, and the axes (p, 2) along which they were turned round, -1."""
        flips = np.ones_like(places_m)
        for axis in self.mirrors:
            flips[places_m[:, axis] < -SAME_M, axis] = -1.0
        return places_m * flips, flips

    def _images(self, nodes_m: FloatArray, symmetry: str) -> tuple[IntArray, sp.csr_array]:
        """Distinct nodes (b, 2) up to mirror images, (a,), and the map from their motion to that of all, (3 b, 3 a)."""
        folded, flips = self._folded(nodes_m)
        places = np.round(folded / SAME_M) + 0.0  # no zero below zero
        _, own, which = np.unique(places, axis=0, return_index=True, return_inverse=True)
        signs = mirror_signs(symmetry, flips)
        columns = (3 * which.ravel()[:, None] + np.arange(3)).ravel()
        values = (signs * signs[own][which.ravel()]).ravel()
        shape = (3 * len(nodes_m), 3 * len(own))
        return own, sp.csr_array((values, (np.arange(shape[0]), columns)), shape=shape)

    @property
    def box_m(self) -> FloatArray:
        """The patch from the middle of the panels."""
        return np.asarray(self.patch.box_m - np.repeat(self.panels.middle_m, 2))

    @cached_property
    def key(self) -> str:
        """Key, the same for equal places."""
        place = [np.round(each, 9).tolist() for each in (self.panels.span_m, self.box_m)]
        feet = [(each.pillar, each.centres.round(9).tolist()) for each in self.stands]
        return repr((place, feet, self.panels.clamped, self.back, self.patch.mesh))


def bonded_patch(
    material: PiezoMaterial,
    box_m: FloatArray,
    thickness_m: float,
    above: bool,
    mesh: HexSettings | None = None,
    cache: PatchCache | None = None,
    glue: Layer | None = None,
) -> BondedPatch:
    """Condense a patch at its place to the nodes of its bonded face.

    It is computed unless this process or the cache holds an equal one.

    Parameters
    ----------
    material : PiezoMaterial
        Piezoceramic.
    box_m : ndarray, shape (4,)
        Footprint x0, x1, y0, y1.
    thickness_m : float
        Thickness of the patch.
    above : bool
        True for a patch on the plate's back, bonded by its lower face; False for one on the touch face.
    mesh : HexSettings, optional
        Elements; MESH by default.
    cache : PatchCache, optional
        Store of patches between runs.
    glue : Layer, optional
        Layer between patch and plate, as large as the patch.

    Returns
    -------
    BondedPatch
        Matrices in SI units.
    """
    x0, x1, y0, y1 = (float(end) for end in box_m)
    size = round(x1 - x0, 12), round(y1 - y0, 12)
    patch = _known((material, *size, thickness_m, above, mesh or MESH, glue), _Where(cache))
    return replace(patch, points=patch.points + np.array([x0, y0]), box_m=np.array([x0, x1, y0, y1]))


def with_potential(
    mesh: Mesh, material: PiezoMaterial, thickness_m: float, glue: Layer | None = None
) -> tuple[sp.csr_array, sp.csr_array, FloatArray, float]:
    """Assemble the matrices of a patch, and of its glue, with the potential at the nodes between its electrodes.

    K is indefinite and M has nothing at the potential. It is scaled, so that its own part is as large as K_E.

    Parameters
    ----------
    mesh : Mesh
        Nodes in m.
    material : PiezoMaterial
        Poled along z.
    thickness_m : float
        Distance of the electrodes.
    glue : Layer, optional
        Region glue of the mesh.

    Returns
    -------
    stiffness, mass : sparse array, shape (3n + p, 3n + p)
        In N/m and kg, motion of all nodes first.
    theta : ndarray, shape (3n + p,)
        Charge per displacement, in C/m.
    capacitance : float
        Clamped, in F (unit farad).
    """
    return _assembled(mesh, material, thickness_m, glue)[:4]


def _assembled(mesh: Mesh, material: PiezoMaterial, thickness_m: float, glue: Layer | None) -> _Matrices:
    """K, M, theta and capacitance as `with_potential`, and the loss of K; None where a loss factor is not known."""
    size = float(np.sqrt(material.stiffness_pa[2, 2] / material.permittivity_clamped_f_m[2, 2]))
    law = np.zeros((4, 3, 4, 3))  # of u_x, u_y, u_z and the potential: stresses and charges of their slopes
    law[:3, :, :3] = material.stiffness_pa[VOIGT[:, :, None, None], VOIGT]
    law[3, :, :3] = size * material.stress_c_m2[:, VOIGT]
    law[:3, :, 3] = law[3, :, :3].transpose(1, 2, 0)
    law[3, :, 3] = -(size**2) * material.permittivity_clamped_f_m
    forms, count = Forms(mesh, 1.0), len(mesh.nodes)
    height, inside = _between_electrodes(mesh, thickness_m)
    motion, potential = (4 * np.arange(count)[:, None] + np.arange(3)).ravel(), 4 * np.arange(count) + 3
    laws, densities, losses = law, np.full(len(mesh.cells), material.density_kg_m3), [material.loss_factor]
    if glue:
        elastic, cells = np.zeros_like(law), mesh.regions["glue"]
        elastic[:3, :, :3] = glue.material.tensor_pa
        laws = np.tile(law, (len(mesh.cells), 1, 1, 1, 1))
        laws[cells], densities[cells] = elastic, glue.material.density_kg_m3
        losses.append(glue.material.loss_factor)
    every = forms.stiffness(laws)
    own = np.concatenate([motion, potential[inside]])
    scalar = forms.mass(densities)
    heavy = sp.block_diag([sp.kron(scalar, np.eye(3)), sp.csr_array((inside.sum(),) * 2)], format="csr")
    # a field E_z = -V/t has the potential V z/t: N times it is -theta V; an even field puts no charge on inner nodes
    theta = np.concatenate([every[motion][:, potential] @ height / (-thickness_m * size), np.zeros(inside.sum())])
    area = float(np.ptp(mesh.nodes[:, 0]) * np.ptp(mesh.nodes[:, 1]))
    capacitance = float(material.permittivity_clamped_f_m[2, 2]) * area / thickness_m
    stiffness = sp.csr_array(every[own][:, own])
    return stiffness, sp.csr_array(heavy), theta, capacitance, _lost(stiffness, forms, mesh, glue, losses, own)


def _lost(
    stiffness: sp.csr_array, forms: Forms, mesh: Mesh, glue: Layer | None, losses: Sequence[float | None], own: IntArray
) -> sp.csr_array | None:
    """The stiffness of ceramic and glue times their loss factors: all of it times the ceramic's, and what the glue has more."""
    ceramic, *others = losses
    if ceramic is None or None in others:
        return None
    if glue is None:
        return sp.csr_array(ceramic * stiffness)
    elastic = np.zeros((len(mesh.cells), 4, 3, 4, 3))
    elastic[mesh.regions["glue"], :3, :, :3] = glue.material.tensor_pa
    return sp.csr_array(ceramic * stiffness + (glue.material.lost - ceramic) * forms.stiffness(elastic)[own][:, own])


def _between_electrodes(mesh: Mesh, thickness_m: float) -> tuple[FloatArray, BoolArray]:
    """Heights of the nodes from the ceramic's lower electrode, those beyond it at its ends (n,), and which lie between both."""
    ceramic = np.setdiff1d(np.arange(len(mesh.cells)), mesh.regions.get("glue", []))
    low = mesh.nodes[mesh.cells[ceramic], 2].min()
    height = np.clip(mesh.nodes[:, 2] - low, 0.0, thickness_m)
    return height, (height > SAME * thickness_m) & (height < (1.0 - SAME) * thickness_m)


def patch_mesh(design: Design, tiling: Tiling, box_m: FloatArray) -> HexSettings:
    """Choose the elements of a patch, as short as the target shape and the pillars beneath require.

    Parameters
    ----------
    design : Design
        The plate, lengths in m.
    tiling : Tiling
        Its panels.
    box_m : ndarray, shape (4,)
        Footprint x0, x1, y0, y1.

    Returns
    -------
    HexSettings
        Order and size in m.
    """
    size = design.line_spacing_m / WAVE
    if pillars_beneath(tiling, box_m):
        size = min(size, FOOT * min([design.thickness_m, *(pillar.footprint_m for pillar in design.kinds)]))
    return replace(MESH, size_m=size)


def pillars_beneath(tiling: Tiling, box_m: FloatArray) -> list[tuple[int, int]]:
    """List the panels with a pillar, on either side of the plate, that a rectangle overlaps.

    Parameters
    ----------
    tiling : Tiling
        The panels.
    box_m : ndarray, shape (4,)
        Rectangle x0, x1, y0, y1.

    Returns
    -------
    list of (int, int)
        Panels (i, j).
    """
    x, y = (between(lines, ends, 0.0) for lines, ends in zip((tiling.x, tiling.y), box_m.reshape(2, 2), strict=True))
    return [(i, j) for i, j in tiling.feet if x[0] <= i <= x[1] and y[0] <= j <= y[1]]


@lru_cache(maxsize=8)
def _known(own: _Own, where: _Where) -> BondedPatch:
    if where.cache is None:
        return _alike(*own)
    key = hashlib.sha256(repr(("patch", *own)).encode()).hexdigest()
    flat = where.cache.load(key)
    if flat is None:
        patch = _alike(*own)
        known = {name: getattr(patch, name) for name in KEPT}
        where.cache.keep(key, {name: value for name, value in known.items() if value is not None})
        return patch
    material, x_m, y_m, thickness_m, _, settings, glue = own
    parts: dict[str, Any] = {
        name: flat[name] if flat[name].ndim else float(flat[name]) for name in KEPT if name in flat
    }
    return BondedPatch(material, np.array([0.0, x_m, 0.0, y_m]), thickness_m, settings, **parts, glue=glue)


def _alike(
    material: PiezoMaterial,
    x_m: float,
    y_m: float,
    thickness_m: float,
    above: bool,
    settings: HexSettings,
    glue: Layer | None = None,
) -> BondedPatch:
    """The patch with its first corner at the origin: patches of one size are one."""
    box = np.array([0.0, x_m, 0.0, y_m])
    mesh = _mesh(box, thickness_m, settings, above, glue.thickness_m if glue else 0.0)
    _check_room(mesh, box)
    face = 0.0 if above else thickness_m + (glue.thickness_m if glue else 0.0)
    bond = np.flatnonzero(np.abs(mesh.nodes[:, 2] - face) < 1e-9 * thickness_m + 1e-15)
    matrices, inside = _assembled(mesh, material, thickness_m, glue), _between_electrodes(mesh, thickness_m)[1]
    parts = [_condensed(matrices, *_fields(mesh, symmetry, inside), 3 * bond) for symmetry in CLASSES]
    *added, lost, own_hz = zip(*parts, strict=True)
    stiffness, mass, theta, swell, charged = (np.sum(each, axis=0) for each in added)
    dissipated = None if matrices[4] is None else np.sum(lost, axis=0)
    places = _projection(mesh, "touch" if above else "top", bond)
    capacitance_f = float(matrices[3] + charged)
    return BondedPatch(
        material, box, thickness_m, settings, *places, stiffness, mass, theta, swell, capacitance_f, min(own_hz),
        dissipated, glue,
    )  # fmt: skip


def _condensed(
    matrices: _Matrices, fields: sp.csr_array, own: IntArray, bond: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float, FloatArray | float, float]:
    """Stiffness, mass, theta, swell, capacitance, loss and lowest resonance over fields (dof, m) of one symmetry class.

    The matrices' images of the fields are fields of the class: their rows `own`, one per field, hold them.
    """
    scale = sp.diags_array(1.0 / fields[own, np.arange(len(own))])
    stiffness, mass = (sp.csr_array(scale @ (matrix[own] @ fields)) for matrix in matrices[:2])
    theta, on_bond = fields.T @ matrices[2], fields[(bond[:, None] + np.arange(3)).ravel()]
    b = np.unique(on_bond.indices)
    i = np.setdiff1d(np.arange(fields.shape[1]), b)
    (k_b, k_i), (m_b, m_i) = ((matrix[b], matrix[i]) for matrix in (stiffness, mass))
    k_ii, m_ii, k_bi, m_bi = k_i[:, i], m_i[:, i], k_b[:, i], m_b[:, i]
    inner = Factoriser()(sp.csc_array(k_ii))
    follow = -inner.solve(k_i[:, b].toarray())
    swell = inner.solve(theta[i][:, None])[:, 0]
    condensed = k_b[:, b] + k_bi @ follow
    heavy = m_b[:, b] + m_bi @ follow + follow.T @ (m_i[:, b] + m_ii @ follow)
    place = on_bond[:, b]
    lost: FloatArray | float = 0.0
    if matrices[4] is not None:
        moved = np.empty((fields.shape[1], len(b)))
        moved[b], moved[i] = np.eye(len(b)), follow
        own_loss = moved.T @ (sp.csr_array(scale @ (matrices[4][own] @ fields)) @ moved)
        lost = place @ (place @ (own_loss + own_loss.T) / 2.0).T
    return (
        place @ (place @ (condensed + condensed.T) / 2.0).T,
        place @ (place @ heavy).T,
        place @ (theta[b] + follow.T @ theta[i]),
        place @ (m_bi @ swell + follow.T @ (m_ii @ swell)),
        float(theta[i] @ swell),
        lost,
        _lowest_hz(k_ii, m_ii, inner),
    )


def _fields(mesh: Mesh, symmetry: str, between: BoolArray) -> tuple[sp.csr_array, IntArray]:
    """Orthonormal fields (size, m) of one symmetry class of a patch, which is its own mirror image: motions of all nodes, then
    the potential, which is even or odd as u_z is, of those between the electrodes. And of each field a row in which it
    alone is, (m,).
    """
    grid = [_ranks(places) for places in mesh.nodes.T]
    last = [int(ranks.max()) for ranks in grid]
    number = np.empty([each + 1 for each in last], dtype=np.int64)
    number[tuple(grid)] = np.arange(len(mesh.nodes))
    inside = np.flatnonzero(between)
    size = 3 * len(mesh.nodes) + len(inside)
    motion = np.arange(3 * len(mesh.nodes)).reshape(-1, 3)
    potential = np.full(len(mesh.nodes), -1)
    potential[inside] = motion.size + np.arange(size - motion.size)
    first = (2 * grid[0] <= last[0]) & (2 * grid[1] <= last[1])
    rows, values = [], []
    for flip in product((1.0, -1.0), repeat=2):
        x, y = (ranks if way > 0.0 else end - ranks for ranks, end, way in zip(grid, last, flip, strict=False))
        image, signs = number[x, y, grid[2]][first], mirror_signs(symmetry, np.array(flip))
        has = potential[image] >= 0
        rows.append(np.concatenate([motion[image].ravel(), potential[image][has]]))
        values.append(np.concatenate([np.tile(signs, len(image)), np.full(int(has.sum()), signs[2])]))
    where = np.concatenate(rows), np.tile(np.arange(len(rows[0])), len(rows))
    fields = sp.csc_array(sp.coo_array((np.concatenate(values), where), (size, len(rows[0]))))
    length = np.sqrt(np.asarray(fields.multiply(fields).sum(axis=0)))
    alive = np.flatnonzero(length > 0.5)  # a motion on a mirror line that its class forbids cancels out
    return sp.csr_array(fields[:, alive] @ sp.diags_array(1.0 / length[alive])), rows[0][alive]


def _ranks(places: FloatArray) -> IntArray:
    """The number of each place among the different ones, ascending."""
    order = np.argsort(places, kind="stable")
    out = np.zeros(len(places), dtype=np.int64)
    out[order[1:]] = np.cumsum(np.diff(places[order]) > APART * np.ptp(places))
    return out


def _check_room(mesh: Mesh, box_m: FloatArray) -> None:
    """Raise TooLarge if the dense matrices of the condensation exceed the memory."""
    layers = len(np.unique(np.round(mesh.nodes[:, 2], 12)))
    bond = 3.0 * len(mesh.nodes) / layers
    size = " x ".join(f"{1e3 * each:g}" for each in np.diff(box_m)[::2])
    what = f"a patch of {size} mm with its short elements takes"
    check_room(8.0 * bond**2 * (COPIES * (layers - 1) + SQUARES), what, "use shorter patches")


def _lowest_hz(stiffness: sp.csr_array, mass: sp.csr_array, factor: Factor) -> float:
    """Lowest natural frequency of K and M with the factor of K."""
    inverse = spla.LinearOperator(stiffness.shape, matvec=factor.solve, dtype=float)
    start = np.ones(stiffness.shape[0])
    value = spla.eigsh(
        stiffness, 1, mass, sigma=0.0, OPinv=inverse, v0=start, ncv=BASIS, tol=OWN, return_eigenvectors=False
    )
    return float(np.sqrt(value[0]) / (2.0 * pi))


def _mesh(box_m: FloatArray, thickness_m: float, settings: HexSettings, above: bool, glue_m: float = 0.0) -> Mesh:
    x, y = (grid_lines({float(low): True, float(high): True}, settings.grading) for low, high in box_m.reshape(2, 2))
    joint, top = (glue_m if above else thickness_m), thickness_m + glue_m
    ends = {0.0: above, joint: True, top: not above} if glue_m else {0.0: above, top: not above}
    z = grid_lines(ends, settings.grading)
    region = np.zeros((len(x) - 1, len(y) - 1, len(z) - 1), dtype=np.int64)
    if glue_m:
        region[:, :, (z[1:] + z[:-1]) / 2.0 > joint] = 1
    names = ("glue", "patch") if glue_m and above else ("patch", "glue")  # the lowest one first
    return hex_mesh(Boxes(x, y, z, region, names), settings.order)


def _projection(mesh: Mesh, face: str, nodes: IntArray) -> tuple[FloatArray, FloatArray]:
    """Points (q, 2) of a quadrature over a face and the mean-square projection (b, q) onto the field of its nodes (b,)."""
    rule = face_quadrature(mesh, face)
    value = rule.interpolation[:, nodes].toarray()
    heavy = value.T * rule.weights
    return rule.points[:, :2], np.asarray(np.linalg.solve(heavy @ value, heavy))
