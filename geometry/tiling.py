"""Tiling of a finite plate by rectangular panels: grid lines, the pillar of each panel, and distinct panels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import ceil
from typing import Any

import numpy as np

from geometry.elements import FloatArray
from geometry.layout import ROUNDING, Design, Pillar
from geometry.supports import Support


@dataclass(frozen=True)
class Panel:
    """A rectangular panel of plate.

    Attributes
    ----------
    low, high : tuple of float
        Corners (x0, y0) and (x1, y1) in m.
    foot : tuple of float or None
        Centre (x, y) of its pillar in m; None for a bare panel.
    halved : tuple of int
        Axes along which only the half beyond the panel's middle is meshed, with a mirror there.
    free : tuple of str
        Sides (x-, x+, y-, y+) to which nothing is attached.
    pillar : Pillar or None
        Its pillar if rows differ; None for the design's.
    attached : tuple of Support
        Masses, springs and resonators on discs, from its middle.
    edges_m : tuple of tuple or None
        Vectors along the sides of an oblique cell about the origin, which low and high do not describe; None for a rectangle.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    foot: tuple[float, float] | None = None
    halved: tuple[int, ...] = ()
    free: tuple[str, ...] = ()
    pillar: Pillar | None = None
    attached: tuple[Support, ...] = ()
    edges_m: tuple[tuple[float, float], tuple[float, float]] | None = None

    @property
    def middle(self) -> tuple[float, float]:
        """Centre of the panel, m."""
        return ((self.low[0] + self.high[0]) / 2.0, (self.low[1] + self.high[1]) / 2.0)


Signature = tuple[float | str | Pillar | tuple[object, ...], ...]
INNERMOST = 0.25  # of half a zone's width: panels of its first row begin no nearer to its middle
NARROW = 0.2  # of a pitch: a narrower strip between two pillars' panels is shared by both
DIGITS = 12  # of a length in m: panels that agree to a picometre are the same


@dataclass(frozen=True)
class Tiling:
    """Panels of a plate.

    Attributes
    ----------
    x, y : ndarray, shape (nx + 1,) or (ny + 1,)
        Grid lines in m, symmetric about 0.
    feet : dict of tuple
        Centres (x, y) of the pillars in m by column and row (i, j) of their panels.
    mirrored : bool
        Whether every pillar, and with it the plate, is its own mirror image.
    bare : tuple of int
        Axes along which bare plate is its own mirror image.
    pillars : mapping of Pillar
        Pillars by row j of panels if rows differ.
    lines_m, cuts_m : tuple of float
        Lines y, and lines x, at which parts of the touch face meet.
    supports : tuple of Support
        Supports of the plate.
    """

    x: FloatArray
    y: FloatArray
    feet: dict[tuple[int, int], tuple[float, float]]
    mirrored: bool = True
    pillars: Mapping[int, Pillar] = field(default_factory=dict)
    lines_m: tuple[float, ...] = ()
    bare: tuple[int, ...] = (0, 1)
    cuts_m: tuple[float, ...] = ()
    supports: tuple[Support, ...] = ()

    def panel(self, i: int, j: int) -> Panel:
        """Panel in column i, row j, halved along every axis about which it is its own mirror image.

        The outer sides of a panel with a pillar are left free: its foot may stand flush with the plate's edge, where
        no polynomial follows it. Bare panels keep all four sides, so that one reduction serves inside and at the edge.
        """
        low, high = (float(self.x[i]), float(self.y[j])), (float(self.x[i + 1]), float(self.y[j + 1]))
        foot = self.feet.get((i, j))
        whole = Panel(low, high, foot)
        free = self.free_sides(i, j)
        centred = [
            axis in self.bare
            if foot is None
            else self.mirrored and abs(foot[axis] - whole.middle[axis]) < 10.0**-DIGITS
            for axis in (0, 1)
        ]
        even = [(f"{axis}-" in free) == (f"{axis}+" in free) for axis in "xy"]
        halved = tuple(axis for axis in (0, 1) if centred[axis] and even[axis])
        return Panel(low, high, foot, halved, free, self.pillars.get(j) if foot else None)

    def representatives(self, whole: bool) -> list[tuple[int, int]]:
        """Panels (i, j) that stand for the others: those with middle x >= 0 and y >= 0, or all."""
        nx, ny = len(self.x) - 1, len(self.y) - 1
        first = (0, 0) if whole else (nx // 2, ny // 2)
        return [(i, j) for i in range(first[0], nx) for j in range(first[1], ny)]

    def free_sides(self, i: int, j: int) -> tuple[str, ...]:
        """Sides of panel (i, j) to which nothing is attached and nothing need be: not those of a supported edge."""
        if (i, j) not in self.feet:
            return ()
        ends = {"x-": i == 0, "x+": i == len(self.x) - 2, "y-": j == 0, "y+": j == len(self.y) - 2}
        supported = {each.edge for each in self.supports}
        return tuple(side for side, at_end in ends.items() if at_end and side not in supported)


def lattice_panel(design: Design, count: int = 1) -> Panel:
    """Return the unit cell as a panel, pitch_x x pitch_y or oblique, with its pillar in the middle; bare without a pillar.

    Parameters
    ----------
    design : Design
        The plate as built.
    count : int, optional
        Number of panels side by side in a pitch, of which the middle one is returned.

    Returns
    -------
    Panel
        The panel in m, halved along every axis along which the cell is its own mirror image.
    """
    half_x, half_y = design.pitch_x_m / count / 2.0, design.pitch_y_m / 2.0
    halved, foot = mirrored_along(design.cell_mirrors), (0.0, 0.0) if design.pillar or design.cell_file else None
    return Panel((-half_x, -half_y), (half_x, half_y), foot, halved, attached=design.attached, edges_m=design.oblique_m)


def mirrored_along(mirrors: Iterable[str]) -> tuple[int, ...]:
    """List the axes along which a body is its own mirror image.

    Parameters
    ----------
    mirrors : iterable of str
        Its mirrors: x, y, d.

    Returns
    -------
    tuple of int
        0 for x, 1 for y.
    """
    return tuple(axis for axis, name in enumerate("xy") if name in mirrors)


def row_panels(design: Design) -> list[Panel]:
    """Return the panels of one pitch along a row.

    Parameters
    ----------
    design : Design
        The plate as built.

    Returns
    -------
    list of Panel
        The unit cell; for staggered rows one half with the pillar and a bare one.
    """
    if not design.stagger:
        return [lattice_panel(design)]
    own = lattice_panel(design, 2)
    return [own, replace(own, foot=None)]


def signature(panel: Panel) -> Signature:
    """Return the key of a panel's reduction: panels with equal keys are reduced once.

    Parameters
    ----------
    panel : Panel
        The panel.

    Returns
    -------
    tuple
        Edge lengths, place of the foot from the middle (m; infinite without one), free sides, the panel's own pillar.
    """
    size = (panel.high[0] - panel.low[0], panel.high[1] - panel.low[1])
    offset = (panel.foot[0] - panel.middle[0], panel.foot[1] - panel.middle[1]) if panel.foot else (np.inf, np.inf)
    own: tuple[Any, ...] = ((panel.pillar,) if panel.pillar else ()) + tuple(each.key for each in panel.attached)
    own += () if panel.edges_m is None else (panel.edges_m,)
    return (*(round(v, DIGITS) + 0.0 for v in (*size, *offset)), *panel.free, *own)


def tile(design: Design, max_edge_m: float) -> Tiling:
    """Cut a plate into one panel per pillar and bare panels elsewhere.

    Parameters
    ----------
    design : Design
        The plate as built.
    max_edge_m : float
        Largest edge of a bare panel in m.

    Returns
    -------
    Tiling
        Grid lines in m and the foot of each panel.
    """
    x, y = grid(design, max_edge_m)
    plain: dict[str, Any] = {
        "lines_m": design.touch_lines_m,
        "cuts_m": design.touch_cuts_m,
        "bare": mirrored_along(design.stack.mirrors),
        "supports": design.supports,
    }
    if not design.rows:
        return Tiling(x, y, {}, design.is_mirrored, **plain)
    lines = design.lines_of_feet()
    places = (np.searchsorted(y, [row for row, _ in lines]) - 1).tolist()
    pillars = dict(zip(places, (*design.graded[::-1], *design.graded), strict=True)) if design.graded else {}
    return Tiling(x, y, _feet(x, y, lines), design.is_mirrored, pillars, **plain)


def tightest_panels(design: Design) -> list[Panel]:
    """Return the panel of every row whose foot comes nearest to a side: that of its last column.

    Parameters
    ----------
    design : Design
        The plate as built.

    Returns
    -------
    list of Panel
        One panel per row; none without rows.
    """
    if not design.rows:
        return []
    x, y = grid(design, design.thickness_m)
    lines = design.lines_of_feet()
    pillars = (*design.graded[::-1], *design.graded) or (None,) * len(lines)
    panels = []
    for (row, columns), pillar in zip(lines, pillars, strict=True):
        column = float(columns[-1])
        i, j = int(np.searchsorted(x, column)) - 1, int(np.searchsorted(y, row)) - 1
        panels.append(
            Panel((float(x[i]), float(y[j])), (float(x[i + 1]), float(y[j + 1])), (column, row), pillar=pillar)
        )
    return panels


def grid(design: Design, max_edge_m: float) -> tuple[FloatArray, FloatArray]:
    """Compute the grid lines of `tile`.

    Parameters
    ----------
    design : Design
        The plate as built.
    max_edge_m : float
        Largest edge of a bare panel in m.

    Returns
    -------
    x : ndarray, shape (nx + 1,)
        Ascending x in m of the lines along y.
    y : ndarray, shape (ny + 1,)
        Ascending y in m of the lines along x.
    """
    if design.larger_m is not None:
        return _around(design, max_edge_m)
    columns, pitch = design.column_centres() if design.rows else np.empty(0), design.pitch_x_m
    if design.is_staggered:
        columns, pitch = np.sort(np.concatenate([columns, design.column_centres(1)])), pitch / 2.0
    half_x = design.length_m / 2.0
    x = _lines_about(columns, pitch, half_x, max_edge_m) if len(columns) else _bare(-half_x, half_x, max_edge_m)
    rows = design.row_places() if design.rows else np.empty(0)
    return x, _refined(_cuts(design) if design.zones == 1 else _cuts_between(design), rows, max_edge_m)


def _around(design: Design, longest: float) -> tuple[FloatArray, FloatArray]:
    """Lines of a plate larger than its zone and rows: half-way between pillars, half a pitch beyond the outer ones, and no
    farther than `longest` apart in between; without pillars through the corners of the zone.
    """
    lines, half = design.lines_of_feet(), design.width_m / 2.0
    columns = _distinct(x for _, own in lines for x in own.tolist())
    rows, pitches, halves = [y for y, _ in lines], (design.pitch_x_m, design.pitch_y_m), np.array(design.plate_m) / 2.0
    if not lines and design.others_m:  # borders of several zones may be too near to one another
        return _bare_between((), halves[0], longest), _bare_between((), halves[1], longest)
    if not lines:
        corners = design.zone_ends_m, (design.centre_m[1] - half, design.centre_m[1] + half)
        return _bare_between(corners[0], halves[0], longest), _bare_between(corners[1], halves[1], longest)
    if design.is_staggered:
        pitches = (design.pitch_x_m / 2.0, design.pitch_y_m)
    cuts = [
        _about(places, pitch, float(end))
        for places, pitch, end in zip((columns, np.array(rows)), pitches, halves, strict=True)
    ]
    return _refined(cuts[0], columns, longest), _refined(cuts[1], np.array(rows), longest)


def _bare_between(corners: tuple[float, ...], half: float, longest: float) -> FloatArray:
    """Lines across bare plate through some places."""
    return _refined(_distinct([-half, *corners, half]), np.empty(0), longest)


def _about(centres: FloatArray, pitch: float, end: float) -> FloatArray:
    """Lines half a pitch on either side of every pillar, within the plate: one half-way between neighbours, unless they stand
    farther apart, so that pillars are in the middle of equal panels.
    """
    lines = [-end, end]
    for low, high in pairwise([-np.inf, *centres.tolist(), np.inf]):
        if high - low <= (1.0 + NARROW) * pitch * (1.0 + ROUNDING):
            lines.append((low + high) / 2.0)
        else:
            lines += [each for each in (low + pitch / 2.0, high - pitch / 2.0) if abs(each) < end - 10.0**-DIGITS]
    return _distinct(lines)


def _cuts_between(design: Design) -> FloatArray:
    """Lines across a plate of several zones: its ends, and those of every row's strip, a strip no wider than leaves each zone
    its middle; without rows the zones' borders.
    """
    half, middles = design.width_m / 2.0, design.zone_centres_m
    ends = [-design.half_span_m, design.half_span_m]
    if not design.rows:
        borders = np.concatenate([middles - half, middles + half])
        return _distinct([*ends, *borders])
    for row in design.row_places():
        for end in (row - design.pitch_y_m / 2.0, row + design.pitch_y_m / 2.0):
            middle = middles[int(np.argmin(np.abs(middles - end)))]
            toward = np.sign(row - middle)
            end = end if (end - middle) * toward > INNERMOST * half else middle + toward * half / 2.0
            ends.append(min(max(float(end), ends[0]), ends[1]))
    lines = _distinct(ends)
    return lines[np.concatenate([[True], np.diff(lines) > 10.0**-DIGITS])]


def _cuts(design: Design) -> FloatArray:
    """Lines across a plate of one zone, whose rows may differ in width."""
    inner, outer, rows = design.width_m / 2.0, design.half_span_m, design.row_centres() if design.rows else np.empty(0)
    upper = [inner, outer]
    if len(rows):
        reach = design.row_pitches_m / 2.0
        starts = rows - reach
        starts[0] = starts[0] if starts[0] > INNERMOST * inner else inner / 2.0
        upper = [*starts, min(rows[-1] + reach[-1], outer)]
        if outer - upper[-1] > 10.0**-DIGITS:
            upper.append(outer)
    return _distinct([-c for c in upper] + upper)


def _distinct(places_m: Iterable[float]) -> FloatArray:
    """Places in ascending order, each once, not rounded: a square panel stays one; numpy.unique would load masked arrays."""
    return np.array(sorted({round(float(place), DIGITS) + 0.0: float(place) + 0.0 for place in places_m}.values()))


def _lines_about(centres: FloatArray, pitch: float, end: float, longest: float) -> FloatArray:
    """Lines half-way between pillars; the last panel reaches the plate's end, cut again when it is much longer."""
    between = (centres[1:] + centres[:-1]) / 2.0
    reach = min(centres[-1] + pitch / 2.0, end)
    lines = [-reach, *between, reach]
    if end - reach > 10.0**-DIGITS:
        tail = _bare(reach, end, longest)[1:]
        lines = [*(-tail[::-1]), *lines, *tail]
    return np.array(lines)


def _bare(low: float, high: float, longest: float) -> FloatArray:
    return np.linspace(low, high, 1 + max(1, ceil((high - low) / longest - 1e-9)))


def _refined(cuts: FloatArray, feet: FloatArray, longest: float) -> FloatArray:
    """Cut every interval without a pillar into panels no longer than `longest`, the middle one into an even number."""
    lines = [cuts[:1]]
    for low, high in pairwise(cuts.tolist()):
        if ((feet > low) & (feet < high)).any():
            lines.append(np.array([high]))
            continue
        count = max(1, ceil((high - low) / longest - 1e-9))
        if low < 0.0 < high:
            count += count % 2
        lines.append(np.linspace(low, high, count + 1)[1:])
    return np.concatenate(lines)


def _feet(
    x: FloatArray, y: FloatArray, rows: list[tuple[float, FloatArray]]
) -> dict[tuple[int, int], tuple[float, float]]:
    """The panel of each pillar, from y of every row and x of its pillars."""
    return {
        (int(i), int(np.searchsorted(y, cy)) - 1): (float(cx), cy)
        for cy, columns in rows
        for i, cx in zip(np.searchsorted(x, columns) - 1, columns, strict=True)
    }
