"""Scenes drawn at random for the page of error bars, the same for a seed each time: plates and pillars of every material, free
blocks, slender and soft pillars, patches as stiff as their plates.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS, Material
from pipeline.case.model import load_case
from studies.bonded_solid import BondedPlate

CASE = Path(__file__).with_name("three-rows.toml")
TUNGSTEN = Material.isotropic("tungsten", 400e9, 19300.0, 0.28)  # the hardest contrast, beside the library's materials
KNOWN = [*MATERIALS.values(), TUNGSTEN]
CARRIERS = ("pmma", "glass", "aluminium", "steel")
NONE = float("nan")


def ordinary(draw: np.random.Generator) -> Design:
    """A plate 0.5 to 5 mm thick with stubby and slender pillars of any material."""
    plate, pillar = (KNOWN[int(draw.integers(len(KNOWN)))] for _ in range(2))
    thickness = draw.uniform(0.5e-3, 5e-3)
    side = thickness * draw.uniform(0.5, 1.5)
    pitch, height = side * draw.uniform(1.3, 4.0), side * draw.uniform(0.6, 5.0)
    return replace(
        load_case(CASE).design,
        thickness_m=thickness,
        material=plate,
        pillar=Pillar("square", side, side, height, pillar),
        pitch_x_m=pitch,
        pitch_y_m=pitch,
        length_m=thickness * draw.uniform(40.0, 60.0),
        width_m=thickness * draw.uniform(8.0, 12.0),
        nodal_lines=int(draw.integers(3, 6)),
    )


def slender(draw: np.random.Generator) -> Design:
    """The same with rods 8 to 60 times as high as wide."""
    return _with_height(ordinary(draw), np.exp(draw.uniform(np.log(8.0), np.log(60.0))))


def soft(draw: np.random.Generator) -> Design:
    """The same with pillars of rubber, from 1 MPa to 1 GPa."""
    design = _with_height(ordinary(draw), draw.uniform(0.4, 3.0))
    assert design.pillar
    young = 10.0 ** draw.uniform(6.0, 9.0)
    rubber = Material.isotropic(
        f"rubber of {young / 1e6:.3g} MPa", young, draw.uniform(1000.0, 1600.0), draw.uniform(0.44, 0.48)
    )
    return replace(design, pillar=replace(design.pillar, material=rubber))


def _with_height(design: Design, slenderness: float) -> Design:
    assert design.pillar
    return replace(design, pillar=replace(design.pillar, height_m=slenderness * design.pillar.base_m))


def block(draw: np.random.Generator) -> Design:
    """A free block whose thickness is 0.25 to 1 times its width."""
    length = draw.uniform(10e-3, 40e-3)
    width = length * draw.uniform(0.4, 0.95)
    material = KNOWN[int(draw.integers(len(KNOWN)))]
    return Design(length, width, width * draw.uniform(0.25, 1.0), 1, material, None, NONE, NONE, 0, 0.0)


def stiff_patch(draw: np.random.Generator) -> BondedPlate:
    """A bare plate with a patch 0.2 to 1 times as thick on either face."""
    material = MATERIALS[CARRIERS[int(draw.integers(len(CARRIERS)))]]
    thickness = draw.uniform(0.8e-3, 2e-3)
    length = thickness * draw.uniform(18.0, 24.0)
    span = length * draw.uniform(0.55, 0.8)
    patch = (length * draw.uniform(0.25, 0.5), span * draw.uniform(0.25, 0.5), thickness * draw.uniform(0.2, 1.0))
    bare = Design(length, 0.6 * span, thickness, 2, material, None, NONE, NONE, 0, 0.2 * span)
    return BondedPlate(bare, patch, bool(draw.integers(2)))
