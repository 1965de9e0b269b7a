"""Clamped and simply supported discs of an assembled plate's back face.

The reduced panels about a disc cannot come to rest on it: their functions are those of a plate without one. A disc's forces
f move it by E u + R f = 0, E u the reduced plate's motion there and R = F - E K_r^-1 E' the flexibility that the panels lack,
F that of a fine mesh of them, graded towards the rim, both with the border around them held (macneal1971). R^-1 is what the
plate feels: E' R^-1 E next to its K. With S = F^-1, which holding the nodes of the disc gives, and A = E' S E it is

    A + A_i (K_i - A_ii)^-1 A_i',

i the degrees of freedom inside the border: the fine mesh's energy once the reduced motion at the disc is taken back, and K_i >
A_ii.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator
from math import ceil
from typing import Protocol

import numpy as np
from scipy.linalg import eigh

from geometry.elements import BoolArray, FloatArray, IntArray
from geometry.hex.panels import disc_mesh
from geometry.hex.scenes import HexSettings
from geometry.materials import Material, Stack
from geometry.mesh import Mesh
from geometry.supports import Support, is_held_disc
from geometry.tiling import Panel
from solvers.accuracy.mesh import held_shares
from solvers.fem.assembly import System
from solvers.fem.factor import Factoriser
from solvers.fem.solid import AXES, constrain, free_mask
from solvers.fem.surface import SAME_M
from solvers.superelement.bond import Contact, JoinedPanels, Panels
from solvers.superelement.interface import ReductionSettings
from solvers.superelement.plate import WHOLE, AssembledPlate
from solvers.superelement.supports import Hold

ORDER, LAYERS, FACTOR = 3, 2, 0.15  # of elements; towards the rim, on either side and through the plate
REACH = 1.0  # thicknesses around the disc within which bare panels are meshed with it
RANK = 1e-4
YIELD = 1e-6  # least part of a motion's stiffness that is left once its disc is taken back


class Panelled(Protocol):
    """Reductions of a plate's panels: its layers and materials, the matrices of a mesh, and symmetric ones kept by a key."""

    stack: Stack
    reduction: ReductionSettings

    @property
    def materials(self) -> tuple[Material, ...]:
        """The materials of plate and pillar, each once."""
        ...

    def system(self, mesh: Mesh) -> System:
        """Matrices of a mesh."""
        ...

    def kept(self, key: str, computed: Callable[[], FloatArray]) -> FloatArray:
        """A symmetric matrix from a cache, or computed and kept there."""
        ...


def holds_of(plate: AssembledPlate, reductions: Panelled) -> list[Hold]:
    """Find what the held discs of a plate do to its reduced panels.

    Parameters
    ----------
    plate : AssembledPlate
        A symmetry class, or the whole plate.
    reductions : Panelled
        Materials and elements of its panels.

    Returns
    -------
    list of Hold
        One for each disc that is no other's mirror image, in the numbers of the plate's grid.
    """
    discs = distinct(plate.tiling.supports, plate.symmetry == WHOLE)
    return [_hold(plate, reductions, *each) for each in discs]


def distinct(supports: Iterable[Support], whole: bool) -> Iterator[tuple[Support, int]]:
    """Choose the held discs that are no other's mirror image.

    Parameters
    ----------
    supports : iterable of Support
        Those of a plate.
    whole : bool
        Whether the plate is solved whole, where every disc counts.

    Yields
    ------
    support : Support
        A held disc.
    count : int
        How many images it has, itself included.
    """
    for each in filter(is_held_disc, supports):
        if whole:
            yield each, 1
        elif min(each.at_m) >= -SAME_M:
            yield each, 2 ** sum(place > SAME_M for place in each.at_m)


def _hold(plate: AssembledPlate, reductions: Panelled, disc: Support, count: int) -> Hold:
    panels = Panels.beneath(plate.grid, disc.box_m, REACH * reductions.stack.thickness_m)
    tiling = plate.grid.tiling
    spans = zip((tiling.x, tiling.y), (panels.columns, panels.rows), strict=True)
    longest = max(float(np.diff(lines[first : last + 2]).max()) for lines, (first, last) in spans)
    joined, settings = JoinedPanels(panels, plate), disc_settings(reductions.reduction, longest)
    own, layer = (_felt(joined, _answer(joined, disc, reductions, each)) for each in (settings, settings.coarser))
    material = reductions.stack.back
    shares, number = held_shares(material, settings), reductions.materials.index(material)
    missed = shares.correction + shares.uncertainty
    return Hold(joined.numbers, own, layer - own, missed, count, number, material.loss_factor or 0.0)


def disc_settings(reduction: ReductionSettings, longest_m: float) -> HexSettings:
    """Choose elements no longer than those of the reduced panels about a disc, graded to its rim.

    Parameters
    ----------
    reduction : ReductionSettings
        That of the panels.
    longest_m : float
        Longest side of a panel in m.

    Returns
    -------
    HexSettings
        Order, size and grading.
    """
    size = reduction.bare_size_m or reduction.hexahedra.size_m
    along = ceil(reduction.interface.along / (ORDER - 1))
    return HexSettings(ORDER, min(size, longest_m / along), LAYERS, FACTOR)


def _answer(joined: JoinedPanels, disc: Support, reductions: Panelled, settings: HexSettings) -> FloatArray:
    """A, (n, n): the fine mesh's energy where the disc alone moves, as the reduced panels move it.

    It is kept by what it is made of, the panels' own motion included: panels that are reduced again may change its sign.
    """
    panels, axes = joined.panels, np.array([AXES.index(axis) for axis in disc.held_axes])
    span, middle = panels.span_m, panels.middle_m
    at = np.array(disc.at_m) - middle
    around = Panel((span[0], span[2]), (span[1], span[3]), (float(at[0]), float(at[1])))
    mesh = disc_mesh(around, reductions.stack, disc.radius_m, settings)
    nodes = _on_disc(mesh, at, disc.radius_m, reductions.stack.thickness_m)
    contact = Contact(mesh.nodes[nodes, :2] + middle, np.eye(len(nodes)), True)
    rows = (3 * np.arange(len(nodes))[:, None] + axes).ravel()
    moved, unit = joined.motion(contact)[rows], 1.0 / np.sqrt(np.maximum(np.diag(joined.stiffness), 1e-300))

    def energy() -> FloatArray:
        left, size, right = np.linalg.svd(moved * unit, full_matrices=False)
        kept = size > RANK * size[0]
        motions, weights = left[:, kept], (size[kept, None] * right[kept]) / unit
        stiff = _stiffness(reductions.system(mesh), free_mask(mesh, panels.clamped), (nodes, axes), motions)
        whole = weights.T @ stiff @ weights
        return np.asarray((whole + whole.T) / 2.0)

    made_of = hashlib.sha256(repr((mesh.sha256, reductions.stack, disc.held_axes, panels.clamped)).encode())
    for part in (moved, unit):
        made_of.update(part.tobytes())
    return reductions.kept(made_of.hexdigest(), energy)


def _stiffness(system: System, free: BoolArray, held: tuple[IntArray, IntArray], motions: FloatArray) -> FloatArray:
    """Stiffness (k, k) of motions of held nodes along some axes, the other free degrees of freedom at rest under no force."""
    nodes, axes = held
    still = np.zeros_like(free)
    still[np.ix_(nodes, axes)] = True
    pencil, rows = constrain(system, free & ~still), (3 * nodes[:, None] + axes).ravel()
    inner = np.flatnonzero(pencil.free.ravel())
    pull = system.stiffness[rows]
    answer = Factoriser()(pencil.stiffness).solve(pull[:, inner].T @ motions)
    return np.asarray(motions.T @ (pull[:, rows] @ motions - pull[:, inner] @ answer))


def _on_disc(mesh: Mesh, at: FloatArray, radius_m: float, thickness_m: float) -> IntArray:
    """Nodes of the disc, its rim included."""
    away = np.hypot(*(mesh.nodes[:, :2] - at).T)
    return np.flatnonzero((np.abs(mesh.nodes[:, 2] - thickness_m) < SAME_M) & (away < radius_m + SAME_M))


def _felt(joined: JoinedPanels, energy: FloatArray) -> FloatArray:
    """Stiffness (n, n) that the plate feels of a held disc from A."""
    inside = joined.free & (np.diag(joined.stiffness) > 0.0)
    own, square = energy[inside], np.ix_(inside, inside)
    shares, turn = eigh(energy[square], joined.stiffness[square])
    coupled = turn.T @ own
    stiffness = energy + (coupled.T / np.maximum(1.0 - shares, YIELD)) @ coupled
    return np.asarray((stiffness + stiffness.T) / 2.0)
