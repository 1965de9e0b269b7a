"""The frame of a mesh's touch face, wherever the face lies: plane, middle and the direction of the zone's length."""

from __future__ import annotations

from math import pi

import numpy as np

from geometry.elements import FloatArray
from geometry.layout import Design
from geometry.mesh import AnyMesh
from pipeline.errors import InputError
from pipeline.units import MM
from solvers.fem.surface import Frame

FLAT = 1e-3  # of the length: how far the face's nodes may lie off a plane
FITS = 0.01  # relative: how far the face may be from the zone's length
IN_PLACE = 1e-6  # of the length, and of a right angle: below it the file's own axes serve


def touch_frame(mesh: AnyMesh, design: Design, file: str, is_held: bool = False) -> Frame | None:
    """Return the frame of the face `touch`: z into the body, x along the zone's length, the origin at its middle.

    Parameters
    ----------
    mesh : Mesh or MixedMesh
    design : Design
        Its zone: length along x, width along y, in m.
    file : str
        Name of the mesh's file for messages.
    is_held : bool
        Whether groups are at rest: the face may then be what mirror planes x = 0 and y = 0 leave of it, in place.

    Returns
    -------
    Frame or None
        None where the file's own axes are that frame.

    Raises
    ------
    InputError
        For a face that is not flat, or whose smallest rectangle does not hold the zone.
    """
    points = mesh.nodes[mesh.nodes_of("touch")]
    if is_held and _is_cut_by_mirrors(points, design):
        return None
    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - middle, full_matrices=False)
    off = float(np.abs((points - middle) @ axes[2]).max())
    if off > FLAT * design.length_m:
        raise _unfit(file, f"is not flat: its nodes lie up to {off / MM:g} mm off a plane")
    along_z = axes[2] * np.sign((_inside(mesh) - middle) @ axes[2])
    sides, ends = _rectangle((points - middle) @ axes[:2].T)
    spans = ends[1] - ends[0]
    along = _of_the_length(spans, sides @ axes[:2], design, file)
    origin = middle + (ends.mean(axis=0) @ sides) @ axes[:2]
    along_x = sides[along] @ axes[:2]
    along_x = along_x * (1.0 if along_x[np.argmax(np.abs(along_x))] > 0.0 else -1.0)
    return _unless_in_place(Frame(origin, np.array([along_x, np.cross(along_z, along_x), along_z])), design)


def _is_cut_by_mirrors(points: FloatArray, design: Design) -> bool:
    """Whether points (n, 3) cover a half or a quarter of the zone where the file's axes have it."""
    near, (low, high) = FITS * design.length_m, (points.min(axis=0), points.max(axis=0))
    half, wide = design.length_m / 2.0, (1.0 - FITS) * design.width_m / 2.0
    at_x = any(
        np.abs(np.array([low[0], high[0]]) - ends).max() <= near for ends in ((-half, 0.0), (0.0, half), (-half, half))
    )
    at_y = (abs(low[1]) <= near or low[1] <= -wide) and (abs(high[1]) <= near or high[1] >= wide)
    return bool(high[2] - low[2] <= FLAT * design.length_m and at_x and at_y and high[1] - low[1] >= wide)


def _inside(mesh: AnyMesh) -> FloatArray:
    """Mean of the nodes of all elements behind the face, (3,)."""
    on = np.zeros(len(mesh.nodes), dtype=bool)
    on[mesh.nodes_of("touch")] = True
    behind = [block.cells[on[block.cells].sum(axis=1) >= 3].ravel() for block in mesh.blocks]
    return np.asarray(mesh.nodes[np.concatenate(behind)].mean(axis=0))


def _rectangle(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Directions of the sides (2, 2), and low and high ends along them (2, 2), of the smallest rectangle about points.

    One of its sides lies on the points' convex hull (freeman1975).
    """
    from scipy.spatial import ConvexHull

    outline = points[ConvexHull(points).vertices]
    edges = np.roll(outline, -1, axis=0) - outline
    angles = np.unique(np.arctan2(edges[:, 1], edges[:, 0]) % (pi / 2.0))
    turns = np.array([[np.cos(angles), np.sin(angles)], [-np.sin(angles), np.cos(angles)]]).transpose(2, 0, 1)
    seen = np.einsum("ist,pt->ips", turns, outline)
    ends = np.stack([seen.min(axis=1), seen.max(axis=1)], axis=1)
    best = int(np.argmin((ends[:, 1] - ends[:, 0]).prod(axis=1)))
    return turns[best], ends[best]


def _of_the_length(spans: FloatArray, directions: FloatArray, design: Design, file: str) -> int:
    """Which side has the zone's length; of two the one nearer to the file's x. InputError for none."""
    fitting = np.flatnonzero(np.abs(spans / design.length_m - 1.0) <= FITS)
    whole = [side for side in fitting if spans[1 - side] >= (1.0 - FITS) * design.width_m]
    if not whole:
        size = " x ".join(f"{span / MM:g}" for span in sorted(spans, reverse=True))
        raise _unfit(file, f"is {size} mm", design)
    return int(max(whole, key=lambda side: abs(directions[side, 0])))


def _unless_in_place(frame: Frame, design: Design) -> Frame | None:
    """None for the file's own axes; a plane z = const off 0 leaves x and y as they are."""
    moved = np.abs(frame.origin_m[:2]).max() > IN_PLACE * design.length_m
    turned = np.abs(frame.axes - np.eye(3)).max() > IN_PLACE
    return frame if moved or turned else None


def _unfit(file: str, what: str, design: Design | None = None) -> InputError:
    zone = "" if design is None else f" of {design.length_m / MM:g} mm (zone.length_mm) within 1 %"
    wide = "" if design is None else f" and at least {design.width_m / MM:g} mm wide (zone.width_mm)"
    allowed = f"must be a plane face{zone}{wide}, or have another name: then nothing is measured on it"
    return InputError(f"{file}: group TOUCH {what}: {allowed}")
