"""Where zone, pillars and plate edges stand: arrays only, no CAD.

Axes: x along the zone, y across, z = 0 the touch face, pillars on z = thickness, origin at the plate's centre.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, pi

import numpy as np
from numpy.typing import NDArray

from geometry.materials import Material

FloatArray = NDArray[np.float64]
SHORT = 2.0  # thicknesses in half a wave: there thin-plate theory lies 45 % high, Mindlin's some percent
ROUNDING = 1e-9  # relative: 4.0 mm seven times is 28 mm, whatever binary fractions say


@dataclass(frozen=True)
class Pillar:
    """One pillar: its section at foot and tip, height and foot fillet. Lengths in m.

    shape is square, round, tapered (square frustum) or step (a CAD file, foot on z = 0, axis +z).
    """

    shape: str
    base_m: float
    tip_m: float
    height_m: float
    material: Material
    fillet_m: float = 0.0
    file: str | None = None

    @property
    def footprint_m(self) -> float:
        """Largest foot section, fillet included, m."""
        return self.base_m + 2.0 * self.fillet_m

    @property
    def is_box(self) -> bool:
        """True when structured hexahedra can follow the pillar exactly."""
        return self.shape == "square" and self.fillet_m == 0.0

    @property
    def is_own_image(self) -> bool:
        """True when the pillar is its own mirror image in x and y; one from a CAD file need not be."""
        return self.shape != "step"

    @property
    def section_area_m2(self) -> float:
        """Foot section without fillet, m2."""
        return self.base_m**2 * (pi / 4.0 if self.shape == "round" else 1.0)


@dataclass(frozen=True)
class Design:
    """The plate as built: zone, pillar rows on both sides, passive extension. Lengths in m."""

    length_m: float
    width_m: float
    thickness_m: float
    nodal_lines: int
    material: Material
    pillar: Pillar | None
    pitch_x_m: float
    pitch_y_m: float
    rows: int
    extension_m: float

    @property
    def half_wavelength_m(self) -> float:
        """Half-wavelength of the wanted mode along the zone, L / N, m; the zone's width for rigid shapes."""
        return self.length_m / self.nodal_lines if self.nodal_lines > 1 else self.width_m

    @property
    def is_short_wave(self) -> bool:
        """Whether half a wave of the wanted mode is shorter than SHORT thicknesses: no plate theory describes it."""
        return self.half_wavelength_m < SHORT * self.thickness_m

    @property
    def footprint_m(self) -> float:
        """Footprint of a pillar, 0 without pillars, m."""
        return self.pillar.footprint_m if self.pillar and self.rows else 0.0

    @property
    def half_span_m(self) -> float:
        """Half of the plate's whole width across the zone, m."""
        rows_m = (self.rows - 1) * self.pitch_y_m + self.footprint_m if self.rows else 0.0
        return self.width_m / 2.0 + rows_m + self.extension_m

    @property
    def is_mirrored(self) -> bool:
        """True when the plate is its own mirror image in x = 0 and y = 0: its quarter stands for the whole."""
        return not (self.pillar and self.rows) or self.pillar.is_own_image

    @property
    def needs_cad(self) -> bool:
        """True when some solid of the scene is not made of boxes."""
        return bool(self.pillar and self.rows and not self.pillar.is_box)

    def column_centres(self) -> FloatArray:
        """x of the pillar columns, shape (columns,), m: floor((length - footprint)/pitch_x) + 1, centred."""
        room = (self.length_m - self.footprint_m) / self.pitch_x_m
        count = floor(room * (1.0 + ROUNDING) + ROUNDING) + 1
        return np.asarray((np.arange(count) - (count - 1) / 2.0) * self.pitch_x_m)

    def row_centres(self) -> FloatArray:
        """y of the rows on the positive side, shape (rows,), m: width/2 + footprint/2, then every pitch_y."""
        return np.asarray(self.width_m / 2.0 + self.footprint_m / 2.0 + self.pitch_y_m * np.arange(self.rows))

    def pillar_centres(self) -> FloatArray:
        """Centres of every pillar, shape (2 rows columns, 2), m; empty without pillars."""
        if not self.pillar or not self.rows:
            return np.empty((0, 2))
        rows = self.row_centres()
        y, x = np.meshgrid(np.concatenate([-rows[::-1], rows]), self.column_centres(), indexing="ij")
        return np.column_stack([x.ravel(), y.ravel()])
