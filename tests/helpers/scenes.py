"""Small cases that several tests of the commands share."""

from __future__ import annotations

from typing import Any

# two patches drive, the third senses
THREE_PATCHES = """name = "small"
material = "aluminium"
[plate]
thickness_mm = 2.0
[zone]
length_mm = 30.0
width_mm = 10.0
nodal_lines = 3
[array]
rows = 0
extension_mm = 3.0
[patches]
size_mm = [4.0, 2.0, 0.3]
centres_mm = [[-7.5, 0.0], [7.5, 0.0], [12.0, 1.0]]
sensors = [2]
"""

# for export to other programs: pillars of a different material than the plate
STEEL_PILLARS: dict[str, Any] = {
    "name": "small",
    "material": "aluminium",
    "plate": {"thickness_mm": 2.0},
    "zone": {"length_mm": 20.0, "width_mm": 10.0, "nodal_lines": 3},
    "pillar": {"shape": "square", "side_mm": 2.0, "height_mm": 6.0, "material": "steel"},
    "array": {"pitch_mm": 5.0, "rows": 1, "extension_mm": 4.0},
}


def three_patches(band_khz: tuple[float, float], accuracy: float) -> str:
    """The patched plate's case file with its band and accuracy."""
    return f"{THREE_PATCHES}[solve]\nband_kHz = [{band_khz[0]}, {band_khz[1]}]\naccuracy = {accuracy}\n"
