"""The tables of a case as keyword arguments: names, units, defaults and checks are those of a case file."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from typing import Any


class Frozen:
    """What never changes once it is made: no public attribute can be set or removed."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not name.startswith("_"):
            raise FrozenInstanceError(f"cannot assign to {name!r}: a {type(self).__name__} never changes")
        object.__setattr__(self, name, value)

    def __delattr__(self, name: str) -> None:
        raise FrozenInstanceError(f"cannot delete {name!r}: a {type(self).__name__} never changes")


class Table(dict[str, Any]):
    """Keys of one table; they are checked by the case file's schema when a Plate is made of them."""

    def __init__(self, **keys: Any) -> None:
        super().__init__({key: plain(value) for key, value in keys.items() if value is not None})

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{key}={value!r}' for key, value in self.items())})"


class Zone(Table):
    """The active zone: a strip length_mm along x and width_mm across; the wanted mode has nodal_lines nodes along x.

    >>> from antinode import Zone
    >>> Zone(length_mm=115.5, width_mm=20.0, nodal_lines=8)["width_mm"]
    20.0
    """


class Pillar(Table):
    """One pillar: its shape with the sizes in mm that this shape takes, height_mm, fillet_mm, faces, a material of its own.

    >>> from antinode import Pillar
    >>> Pillar(shape="round", diameter_mm=2.0, height_mm=6.3)
    Pillar(shape='round', diameter_mm=2.0, height_mm=6.3)
    """


class Tip(Table):
    """A heavy tip on every pillar: a square prism of side_mm and height_mm, of a material of its own where that is given.

    >>> from antinode import Tip
    >>> Tip(side_mm=2.0, height_mm=1.0, material="brass")
    Tip(side_mm=2.0, height_mm=1.0, material='brass')
    """


class Array(Table):
    """Rows of pillars on each side of the zone at pitch_mm (or pitch_x_mm, pitch_y_mm), and extension_mm of plate beyond.

    Rows that differ have a list each, from the zone outwards: heights_mm, sides_mm, pitches_y_mm. stagger shifts every other
    row by half a pitch.

    >>> from antinode import Array
    >>> Array(pitch_mm=4.0, rows=3, extension_mm=25.0)["rows"]
    3
    """


class Solve(Table):
    """What to look for and how exactly: band_kHz or near_kHz with count, accuracy (relative), model, mesh.

    >>> from antinode import Solve
    >>> Solve(band_kHz=(30.0, 34.0), accuracy=0.003)["band_kHz"]
    [30.0, 34.0]
    """


class BandPath(Table):
    """The table [bands]: path through the irreducible Brillouin zone, points (intervals per segment), count of bands.

    >>> from antinode import BandPath
    >>> BandPath(path="GXMG", points=25, count=10)["path"]
    'GXMG'
    """


class Damping(Table):
    """Losses of the whole plate by its quality factor.

    >>> from antinode import Damping
    >>> Damping(quality=300.0)["quality"]
    300.0
    """


class Patches(Table):
    """Piezoelectric patches: material, size_mm along x, y and z, face, at or centres_mm, sensors, drive_V, circuit.

    >>> from antinode import Patches
    >>> Patches(material="pz26", size_mm=(12.0, 3.0, 0.3), at="antinodes", sensors=(7,))["sensors"]
    [7]
    """


class Scatter(Table):
    """The table [tolerance]: standard deviations height_mm, side_mm, position_mm of single pillars, samples, seed.

    >>> from antinode import Scatter
    >>> Scatter(height_mm=0.05, samples=20)["samples"]
    20
    """


class Finger(Table):
    """The table [touch]: impedance (a name or a dictionary), at_mm, radius_mm, force_N with gap_um, the amplifier's limit_V.

    >>> from antinode import Finger
    >>> Finger(radius_mm=5.0, at_mm=(0.0, 0.0))["at_mm"]
    [0.0, 0.0]
    """


def plain(value: Any) -> Any:
    """A value as a parsed case file holds it: tuples and arrays are lists, tables are dictionaries, numpy's scalars numbers."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, (list, tuple)) else value
