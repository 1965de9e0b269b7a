"""What a printer must know before it starts: is the STL one closed body, how small its features, how steep its undersides.

The file is read back by trimesh, which shares no code with the CAD kernel that wrote it.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geometry.cad.solids import Body
from geometry.errors import GeometryError
from geometry.layout import Design

MM = 1e3
VOLUME_TOLERANCE = 1e-3
SUPPORT_DEG = 45.0  # undersides flatter than this from the vertical need supports in a metal powder bed
ON_BUILD_PLATE = 1e-6  # of the height


@dataclass(frozen=True)
class PrintReport:
    """What was found in an STL file printed with z up, SI units.

    features: named lengths (m) that must be printed; overhang_deg: greatest angle of a downward face from the
    vertical (0 without one, 90 for a ceiling); overhang_area_m2: downward faces beyond 45 degrees, build plate excepted.
    """

    watertight: bool
    bodies: int
    volume_m3: float
    cad_volume_m3: float
    features: dict[str, float]
    overhang_deg: float
    overhang_area_m2: float
    extent_m: tuple[float, float, float]
    mass_kg: float

    @property
    def volume_error(self) -> float:
        """Relative difference of the file's volume from the CAD solid's."""
        return self.volume_m3 / self.cad_volume_m3 - 1.0

    @property
    def smallest_feature(self) -> tuple[str, float]:
        """Name and length (m) of the smallest feature."""
        name = min(self.features, key=self.features.__getitem__)
        return name, self.features[name]

    @property
    def faults(self) -> list[str]:
        """Why the file must not go to a printer; empty when it may."""
        violations = []
        if not self.watertight:
            violations.append("the surface is not closed")
        if self.bodies != 1:
            violations.append(f"{self.bodies} separate bodies, must be 1")
        if not abs(self.volume_error) <= VOLUME_TOLERANCE:
            violations.append(
                f"volume is {self.volume_error:+.2%} off the CAD solid's, allowed is {VOLUME_TOLERANCE:.1%}"
            )
        return violations


def check_print(stl: str | os.PathLike[str], body: Body, design: Design) -> PrintReport:
    """Read an STL (mm, z up) back and measure it against its CAD body. Raises GeometryError when it cannot be read."""
    import trimesh

    try:
        mesh = trimesh.load_mesh(Path(stl), file_type="stl")
    except Exception as fault:  # trimesh raises whatever its readers meet
        raise GeometryError(f"{Path(stl)}: not a readable STL file") from fault
    if not len(mesh.faces):
        raise GeometryError(f"{Path(stl)}: holds no triangle")
    angle, area = overhang(np.asarray(mesh.triangles))
    x, y, z = (float(side) / MM for side in mesh.extents)
    volume = float(mesh.volume) / MM**3
    return PrintReport(
        watertight=bool(mesh.is_watertight and mesh.is_winding_consistent),
        bodies=int(mesh.body_count),
        volume_m3=volume,
        cad_volume_m3=body.volume_m3,
        features=features(design),
        overhang_deg=angle,
        overhang_area_m2=area / MM**2,
        extent_m=(x, y, z),
        mass_kg=volume * design.material.density_kg_m3,
    )


def features(design: Design) -> dict[str, float]:
    """Lengths a printer must resolve, m: thickness, sizes of the pillar's shape, fillet, clear width between pillars.

    Of a pillar from STEP only its foot, tip and height are known.
    """
    widths = {"plate thickness": design.thickness_m}
    pillar = design.pillar
    if pillar is None or not design.rows:
        return widths
    for each in design.kinds:
        widths |= {name: min(size, widths.get(name, size)) for name, size in each.features.items()}
    if pillar.fillet_m > 0.0:
        widths["foot fillet"] = pillar.fillet_m
    reach = np.array([each.reach_m for each in design.row_pillars])
    if len(design.column_centres()) > 1:
        widths["gap between pillars along x"] = design.pitch_x_m - float(reach[:, 0].max())
    if design.rows > 1:
        between = design.row_pitches_m[1:] / 2.0 + design.row_pitches_m[:-1] / 2.0
        widths["gap between pillars along y"] = float((between - (reach[1:, 1] + reach[:-1, 1]) / 2.0).min())
    return widths


def overhang(triangles: np.ndarray) -> tuple[float, float]:
    """Greatest overhang angle (degrees from the vertical) of the downward triangles (n, 3, 3), and the area beyond 45.

    Triangles that lie on the lowest plane rest on the build plate and do not count.
    """
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = np.linalg.norm(normals, axis=1) / 2.0
    heights = triangles[:, :, 2]
    floor = heights.min() + ON_BUILD_PLATE * np.ptp(heights)
    counted = (heights.max(axis=1) > floor) & (areas > 0.0)
    if not counted.any():
        return 0.0, 0.0
    down = -normals[counted, 2] / (2.0 * areas[counted])
    angles = np.degrees(np.arcsin(np.clip(down, 0.0, 1.0)))
    return float(angles.max()), float(areas[counted][angles > SUPPORT_DEG].sum())
