"""Write housing.step, the plate of 31-housing.toml: a front panel with rounded corners, a notch and a hole; lengths in mm.

Run it in the folder of 31-housing.toml after a change, then `antinode view 31-housing.toml`.
"""

from __future__ import annotations

import cadquery as cq

LENGTH, WIDTH, THICKNESS, CORNER = 46.0, 30.0, 1.0, 5.0


def housing() -> cq.Workplane:
    """Build the panel, its touch face on z = 0; the file's origin is the middle of the rectangle."""
    panel = cq.Workplane().box(LENGTH, WIDTH, THICKNESS, centered=(True, True, False)).edges("|Z").fillet(CORNER)
    hole = cq.Workplane().center(17.5, 9.0).circle(3.0).extrude(THICKNESS)
    notch = cq.Workplane().center(-3.0, -WIDTH / 2.0).rect(12.0, 6.0).extrude(THICKNESS).edges("|Z and >Y").fillet(2.0)
    return panel.cut(hole).cut(notch)


if __name__ == "__main__":
    cq.exporters.export(housing(), "housing.step")
    print("wrote housing.step: set plate.file of a case next to it")
