"""Cells of oblique lattices meshed by hexahedra: a foot in the middle, and patches from its rim to the sides of the cell."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise, product

import numpy as np

from geometry.elements import FloatArray
from geometry.errors import MeshError
from geometry.hex.panels import (
    PLANS,
    Map,
    Patch,
    PatchedMesh,
    PlanLines,
    Rim,
    between,
    disc,
    filled,
    hexagon,
    joined,
    leaning,
    lines_along_z,
    straight,
    unit_lines,
)
from geometry.hex.scenes import Grading, HexSettings, breaks_through, grid_lines
from geometry.layout import Pillar
from geometry.materials import Layer, Stack
from geometry.mesh import check_mesh
from geometry.tiling import Panel

QUARTER, SIXTH = np.pi / 2.0, np.pi / 3.0  # turns that leave a square, and a hexagon, as they are
BEHIND = 0.65  # of the rim's half-widths: a corner of the cell beyond so much of both lies behind a corner of the rim
SAME = 1e-9  # of a half-width: one place
SNAP = 15  # digits of a place in m
TRIAL = 3.0  # elements along the shorter side of a cell on which a pillar is tried
REACH = 0.98  # of the cell's half-lengths: a foot must not come nearer to its sides
Quadrant = tuple[
    list[Patch], Rim, Rim, FloatArray
]  # patches of the foot, its rim to the right and above, lines along it


def oblique_mesh(panel: Panel, stack: Stack, pillar: Pillar | None, settings: HexSettings) -> PatchedMesh:
    """Mesh an oblique cell with its pillar, if any, and its middle at the origin.

    Parameters
    ----------
    panel : Panel
        Edges and foot in m.
    stack : Stack
        Layers of the plate.
    pillar : Pillar or None
        Pillar of a panel that does not name its own.
    settings : HexSettings
        Order, element sizes and grading.

    Returns
    -------
    PatchedMesh
        The mesh in m; its opposite sides need not match.

    Raises
    ------
    MeshError
        For a pillar that hexahedra cannot follow.
    """
    assert panel.edges_m
    own, edges = panel.pillar or pillar, np.array(panel.edges_m)
    if panel.foot is None or own is None:
        return _bare(edges, stack, settings)
    if not fits(panel.edges_m, own):
        raise MeshError(f"hexahedra cannot follow a {own.shape} pillar in a cell of this shape")
    return _with_pillar(edges, stack, own, settings)


def _with_pillar(edges: FloatArray, stack: Stack, pillar: Pillar, settings: HexSettings) -> PatchedMesh:
    z, patches = lines_along_z(stack, pillar, settings), list(_patches(edges, pillar, settings.grading))
    mesh = joined(patches, z, stack.thickness_m, settings.order, stack.joints_m, pillar.levels_m[1:-1], edges)
    if pillar.form.taper == 1.0:
        return mesh
    frustum = leaning(mesh.mesh, np.zeros(2), stack.thickness_m, pillar.height_m, pillar.form.taper)
    return replace(mesh, mesh=frustum)


@lru_cache(maxsize=64)
def fits(edges_m: tuple[tuple[float, float], tuple[float, float]], pillar: Pillar) -> bool:
    """Check that hexahedra can follow a pillar in the middle of an oblique cell.

    Parameters
    ----------
    edges_m : tuple of tuple
        Vectors (x, y) along the sides of the cell, m.
    pillar : Pillar
        Pillar in its middle.

    Returns
    -------
    bool
        True where all its sections are one prism, or a frustum, within the sides of the cell, and no element of a coarse mesh
        is turned inside out.
    """
    upright = {section.outline for section in pillar.sections} == {pillar.sections[0].outline}
    if not pillar.takes_hexahedra or not upright or pillar.fillet_m:
        return False
    corners = np.abs(pillar.form.outline() @ np.linalg.inv(np.array(edges_m))) * max(1.0, pillar.form.taper)
    if corners.max() >= REACH / 2.0:
        return False
    edges = np.array(edges_m)
    stack = Stack((Layer(pillar.material, pillar.base_m),))
    try:
        trial = HexSettings(3, float(np.linalg.norm(edges, axis=1).min()) / TRIAL, 1)
        check_mesh(_with_pillar(edges, stack, pillar, trial).mesh)
    except MeshError:
        return False
    return True


def _bare(edges: FloatArray, stack: Stack, settings: HexSettings) -> PatchedMesh:
    lengths = np.linalg.norm(edges, axis=1)
    u, v = (unit_lines(length, (False, False), settings.grading) - 0.5 for length in lengths)
    patch = Patch(u, v, lambda s, t: np.outer(s, edges[0]) + np.outer(t, edges[1]), filled(u, v))
    z = grid_lines(breaks_through(stack, False, False), settings.through_grading(stack))
    return joined([patch], z, stack.thickness_m, settings.order, stack.joints_m, (), edges)


def _patches(edges: FloatArray, pillar: Pillar, grading: Grading) -> Iterator[Patch]:
    """Patches of the foot, and those from its rim to the sides of the cell."""
    if pillar.form.plan in PLANS:
        yield from _of_quadrants(edges, pillar, grading)
        return
    yield from _of_rectangles(edges, pillar, grading)


def _of_quadrants(edges: FloatArray, pillar: Pillar, grading: Grading) -> Iterator[Patch]:
    """Patches of a disc or a hexagon, and those from each side of its rim to a side of the cell, quadrant by quadrant."""
    sides, turn = _facing(edges / 2.0, pillar.form.plan)
    core, right, upper, under = _quadrant(pillar, sides, grading)
    reach = np.linalg.norm(sides, axis=1).mean() - pillar.base_m / 2.0
    fill = unit_lines(float(reach), (True, False), grading)
    for sign in product((1.0, -1.0), repeat=2):
        signs = np.array(sign)

        def beyond(u: FloatArray, v: FloatArray, signs: FloatArray = signs) -> FloatArray:
            outer = signs[0] * sides[0] + np.outer(signs[1] * v, sides[1])
            return between((signs * right(v)) @ turn.T, outer, u)

        def above(u: FloatArray, v: FloatArray, signs: FloatArray = signs) -> FloatArray:
            outer = np.outer(signs[0] * u, sides[0]) + signs[1] * sides[1]
            return between((signs * upper(u)) @ turn.T, outer, v)

        yield from (_turned(patch, _laid(patch.place, signs, turn), signs) for patch in core)
        yield _turned(Patch(fill, under, beyond, filled(fill, under)), beyond, signs)
        yield _turned(Patch(under, fill, above, filled(under, fill)), above, signs)


def _laid(place: Map, signs: FloatArray, turn: FloatArray) -> Map:
    """The image of a quadrant's places in another quadrant, turned about the foot's middle."""
    return lambda u, v: np.asarray((signs * place(u, v)) @ turn.T)


def _turned(patch: Patch, place: Map, signs: FloatArray) -> Patch:
    """A patch in its place; with u backwards where that keeps the handedness of its elements."""
    if signs.prod() > 0.0:
        return replace(patch, place=place)
    return replace(patch, u=-patch.u[::-1], place=lambda u, v: place(-u, v), inside=patch.inside[::-1])


def _facing(halves: FloatArray, plan: str) -> tuple[FloatArray, FloatArray]:
    """Half-edges (2, 2) of the cell, first that to the right of the foot, and the turn (2, 2) of the foot that suits them.

    A disc is turned as the sides are, a hexagon by sixths of a turn.
    """
    one, two = np.arctan2(halves[:, 1], halves[:, 0])
    aside = (one + two - QUARTER) / 2.0 + (np.pi if two < one else 0.0)
    steps = [aside] if plan == "disc" else [SIXTH * step for step in range(-2, 3)]
    pairs = [(abs(np.remainder(aside - own + QUARTER * k + np.pi, 2.0 * np.pi) - np.pi), own, k)
             for own in steps for k in range(4)]  # fmt: skip
    _, own, k = min(pairs, key=lambda each: (round(each[0], 9), abs(each[1]), each[2]))
    for _ in range((4 - k) % 4):
        halves = np.array([-halves[1], halves[0]])
    return halves, np.array([[np.cos(own), -np.sin(own)], [np.sin(own), np.cos(own)]])


def _quadrant(pillar: Pillar, sides: FloatArray, grading: Grading) -> Quadrant:
    """The part x, y >= 0 of a foot: its patches, its rim to the right and above by shares, and the lines along the rim."""
    half, plan = pillar.base_m / 2.0, pillar.form.plan
    outer = float(np.linalg.norm(sides, axis=1).max())
    if plan == "disc":
        count = max(grading.least, int(np.ceil(max(np.pi / 4.0 * half, outer) / grading.size_m - 1e-6)))
        turn, inner = np.linspace(0.0, 1.0, count + 1), unit_lines(half / 2.0, (False, True), grading)
        core = [patch for patch in disc(half, (half, half), PlanLines(turn, inner, turn)) if patch.inside.any()]

        def arc(v: FloatArray) -> FloatArray:
            return half * np.column_stack([np.cos(np.pi / 4.0 * v), np.sin(np.pi / 4.0 * v)])

        return core, arc, lambda u: arc(u)[:, ::-1], turn
    finer = replace(grading, size_m=min(grading.size_m / outer, grading.size_m / half))
    inner = grid_lines({0.0: False, 1.0: True}, finer)
    core = [patch for patch in hexagon(half, (half, half), PlanLines(inner, inner, inner)) if patch.inside.any()]
    place = core[0].place
    return core, lambda v: place(np.ones_like(v), v), lambda u: place(u, np.ones_like(u)), inner


def _of_rectangles(edges: FloatArray, pillar: Pillar, grading: Grading) -> Iterator[Patch]:
    """One patch of a foot that is a union of rectangles about the middle, and those from its rim to the sides of the cell.

    They lie between rays from the middle through the rim's corners and the cell's corners, so that none is turned inside out,
    whichever way the foot stands in the cell.
    """
    half, outer = np.array(pillar.form.extent_m()) / 2.0, float(np.linalg.norm(edges, axis=1).max()) / 2.0
    rectangles = pillar.form.rectangles
    if rectangles is None:
        rectangles = np.array([[-half[0], half[0], -half[1], half[1]]])
    finer = replace(grading, size_m=grading.size_m * min(1.0, float(half.min()) / outer))
    rays = _rays(edges, half)
    x, y = (
        grid_lines(
            {float(end): True for end in np.unique(np.round(rectangles[:, 2 * axis : 2 * axis + 2], SNAP))}
            | {float(rim[axis]): False for rim, _ in rays if abs(rim[axis]) < half[axis] * (1.0 - SAME)},
            finer,
        )
        for axis in (0, 1)
    )
    middles = np.meshgrid((x[1:] + x[:-1]) / 2.0, (y[1:] + y[:-1]) / 2.0, indexing="ij")
    inside = np.zeros(middles[0].shape)
    for x0, x1, y0, y1 in rectangles:
        inside[(middles[0] > x0) & (middles[0] < x1) & (middles[1] > y0) & (middles[1] < y1)] = 1.0
    yield Patch(x, y, straight, inside)
    fill = unit_lines(outer - float(half.mean()), (True, False), grading)
    for (rim, far), (after, beyond) in pairwise([*rays, rays[0]]):
        axis = int(np.argmax(np.abs(after - rim)))
        lines, (low, high) = (x, y)[axis], sorted((rim[axis], after[axis]))
        own = lines[(lines > low - SAME * half[axis]) & (lines < high + SAME * half[axis])]
        shares = np.sort((own - rim[axis]) / (after[axis] - rim[axis]))

        def place(u: FloatArray, v: FloatArray, ends: tuple[FloatArray, ...] = (rim, after, far, beyond)) -> FloatArray:
            near, last = (between(ends[k], ends[k + 1], v) for k in (0, 2))
            return between(near, last, u)

        yield Patch(fill, shares, place, filled(fill, shares))


def _rays(edges: FloatArray, half: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Places (2,) on the rim of a rectangle and on the sides of the cell along each ray from the middle, anticlockwise.

    A corner of the cell that lies nearly behind one of the rim's belongs to the ray of that.
    """
    inverse = np.linalg.inv(edges)
    corners = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    found = []
    for corner in corners / 2.0 @ edges:
        rim = corner / np.abs(corner / half).max()
        is_behind = (np.abs(rim) >= BEHIND * half).all()
        found.append((np.sign(corner) * half if is_behind else rim, corner))
    taken = [rim for rim, _ in found]
    for corner in corners * half:
        if not any(np.allclose(corner, rim, rtol=SAME, atol=SAME * half.max()) for rim in taken):
            found.append((corner, corner / (2.0 * np.abs(corner @ inverse).max())))
    return sorted(found, key=lambda pair: float(np.arctan2(pair[0][1], pair[0][0])))
