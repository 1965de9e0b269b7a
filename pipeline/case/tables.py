"""The tables of a case as keyword arguments, typed; `schema` has their limits and defaults and checks them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, TypedDict

Numbers = Iterable[float]  # lists, tuples, arrays
Material = str | dict[str, float]  # a name, or young_GPa, density_kg_m3 and poisson


class Zone(TypedDict, total=False):
    """The active zone: a strip length_mm along x and width_mm across; the target mode has nodal_lines nodes along x.

    >>> from antinode import Zone
    >>> Zone(length_mm=115.5, width_mm=20.0, nodal_lines=8)["width_mm"]
    20.0
    """

    length_mm: float
    width_mm: float
    nodal_lines: int
    count: int
    shared_rows: int
    gap_mm: float


class Pillar(TypedDict, total=False):
    """One pillar: its shape with the sizes in mm that this shape takes, height_mm, fillet_mm, faces, a material of its own.

    >>> from antinode import Pillar
    >>> Pillar(shape="round", diameter_mm=2.0, height_mm=6.3)
    {'shape': 'round', 'diameter_mm': 2.0, 'height_mm': 6.3}
    """

    shape: str
    side_mm: float
    diameter_mm: float
    base_mm: float
    tip_mm: float
    arm_mm: float
    file: str
    height_mm: float
    fillet_mm: float
    faces: Literal["back", "both"]
    material: Material


class Tip(TypedDict, total=False):
    """A heavy tip on every pillar: a square prism of side_mm and height_mm, of a material of its own where that is given.

    >>> from antinode import Tip
    >>> Tip(side_mm=2.0, height_mm=1.0, material="brass")
    {'side_mm': 2.0, 'height_mm': 1.0, 'material': 'brass'}
    """

    side_mm: float
    height_mm: float
    material: Material


class Array(TypedDict, total=False):
    """Rows of pillars on each side of the zone at pitch_mm (or pitch_x_mm, pitch_y_mm), and extension_mm of plate beyond.

    Rows that differ have a list each, from the zone outwards: heights_mm, sides_mm, pitches_y_mm. stagger shifts every other
    row by half a pitch.

    >>> from antinode import Array
    >>> Array(pitch_mm=4.0, rows=3, extension_mm=25.0)["rows"]
    3
    """

    pitch_mm: float
    pitch_x_mm: float
    pitch_y_mm: float
    rows: int
    heights_mm: Numbers
    sides_mm: Numbers
    pitches_y_mm: Numbers
    stagger: bool
    extension_mm: float


class Solve(TypedDict, total=False):
    """What to look for and how exactly: band_kHz or near_kHz with count, accuracy (relative), model, mesh.

    >>> from antinode import Solve
    >>> Solve(band_kHz=(30.0, 34.0), accuracy=0.003)["band_kHz"]
    (30.0, 34.0)
    """

    band_kHz: Numbers
    near_kHz: float
    count: int
    accuracy: float
    model: Literal["auto", "analytic", "superelement", "solid"]
    mesh: Literal["auto", "hex", "tet"]


class BandPath(TypedDict, total=False):
    """The table [bands]: path through the irreducible Brillouin zone, points (intervals per segment), count of bands.

    >>> from antinode import BandPath
    >>> BandPath(path="GXMG", points=25, count=10)["path"]
    'GXMG'
    """

    path: str
    points: int
    count: int
    grid: int


class Damping(TypedDict, total=False):
    """Losses of the whole plate by its quality factor.

    >>> from antinode import Damping
    >>> Damping(quality=300.0)["quality"]
    300.0
    """

    quality: float


class Patches(TypedDict, total=False):
    """Piezoelectric patches: material, size_mm along x, y and z, face, at or centres_mm, sensors, drive_V, circuit.

    >>> from antinode import Patches
    >>> Patches(material="pz26", size_mm=(12.0, 3.0, 0.3), at="antinodes", sensors=(7,))["sensors"]
    (7,)
    """

    material: str
    size_mm: Numbers
    face: Literal["back", "touch"]
    at: Literal["antinodes"]
    centres_mm: Iterable[Numbers]
    behind_mm: float
    sensors: Iterable[int]
    drive_V: float
    circuit: Literal["short", "open"]


class Scatter(TypedDict, total=False):
    """The table [tolerance]: standard deviations height_mm, side_mm, position_mm of single pillars, samples, seed.

    >>> from antinode import Scatter
    >>> Scatter(height_mm=0.05, samples=20)["samples"]
    20
    """

    height_mm: float
    side_mm: float
    position_mm: float
    samples: int
    seed: int


class Finger(TypedDict, total=False):
    """The table [touch]: impedance (a name or a dictionary), at_mm, radius_mm, force_N with gap_um, the amplifier's limit_V.

    >>> from antinode import Finger
    >>> Finger(radius_mm=5.0, at_mm=(0.0, 0.0))["at_mm"]
    (0.0, 0.0)
    """

    impedance: str | dict[str, float]
    at_mm: Numbers
    radius_mm: float
    force_N: float
    gap_um: Numbers
    limit_V: float
