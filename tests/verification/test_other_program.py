"""Drawn cells and plates against scikit-fem: other elements on two meshes of its own, graded towards every edge.

The lines of n elements between two edges follow the square of their number, so that a displacement as r^s at a re-entrant edge
makes a frequency converge as n^(-4 s), where it is not smooth enough for n^-4. s is 0.5 to 0.8 where one of both bodies is
rigid, and somewhat less for a stiff pillar on a soft plate: the limit lies between those of the orders 1.6 and 4.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from geometry.elements import FloatArray
from geometry.hex.boxes import VOID, Boxes, hex_mesh
from geometry.layout import Design
from geometry.materials import Material
from geometry.mesh import Mesh
from pipeline.case.model import Case, case_from_dict
from pipeline.logs import TerminalLog
from pipeline.models.modes import solve_modes
from pipeline.planning.model_choice import Request
from tests.helpers.asked import bands_of
from tests.helpers.other_program import other_bands, other_modes

SEED, CELLS, PLATES = 2026, 28, 12
STIFF = ("aluminium", "steel", "glass", "brass", "titanium", "lead", "pmma", "epoxy", "tungsten")
LOG = TerminalLog(True)
COUNT = 8
ORDERS = 1.6, 4.0
MESHES = 2, 3, 4  # elements between neighbouring edges
ABOVE = 0.2  # of the distance to the next mode


def number(draw: np.random.Generator, low: float, high: float) -> float:
    """Three digits between two numbers, evenly over their logarithm."""
    return float(f"{np.exp(draw.uniform(np.log(low), np.log(high))):.3g}")


def cell_of(seed: int) -> dict[str, Any]:
    """A case with a drawn cell: materials, sizes over a factor of 50, and pitches of their own along x and y."""
    draw = np.random.default_rng([SEED, seed])
    thickness = number(draw, 0.1, 5.0)
    side = number(draw, 0.6 * thickness, 3.0 * thickness)
    pitches = [number(draw, 1.25 * side, 3.0 * side) for _ in range(2)]
    if seed % 3 == 0:
        pitches[1] = pitches[0]
    return {
        "name": f"cell {seed}",
        "material": str(draw.choice(STIFF)),
        "plate": {"thickness_mm": thickness},
        "pillar": {
            "shape": "square",
            "side_mm": side,
            "height_mm": number(draw, 0.4 * side, 4.0 * side),
            "material": str(draw.choice(STIFF)),
        },
        "array": {"pitch_x_mm": pitches[0], "pitch_y_mm": pitches[1], "rows": 1},
        "bands": {"path": "GXM", "points": 1, "count": COUNT},
        "solve": {"accuracy": float(draw.choice([0.003, 0.01, 0.03]))},
    }


def plate_of(seed: int) -> dict[str, Any]:
    """A case with a small drawn plate, one row of two or three pillars on either side of its zone."""
    draw = np.random.default_rng([SEED, CELLS + seed])
    thickness = number(draw, 0.3, 3.0)
    side = number(draw, 0.8 * thickness, 2.0 * thickness)
    pitch = number(draw, 1.5 * side, 2.5 * side)
    columns = int(draw.integers(2, 4))
    return {
        "name": f"plate {seed}",
        "material": str(draw.choice(STIFF)),
        "plate": {"thickness_mm": thickness},
        "zone": {"length_mm": columns * pitch, "width_mm": number(draw, 1.5 * pitch, 3.0 * pitch), "nodal_lines": 2},
        "pillar": {
            "shape": "square",
            "side_mm": side,
            "height_mm": number(draw, 0.6 * side, 3.0 * side),
            "material": str(draw.choice(STIFF)),
        },
        "array": {"pitch_mm": pitch, "rows": 1, "extension_mm": number(draw, 0.3 * pitch, pitch)},
        "solve": {"accuracy": float(draw.choice([0.003, 0.01, 0.03]))},
    }


def boxes_of(low: FloatArray, high: FloatArray, feet: FloatArray, design: Design, parts: int) -> Boxes:
    """A plate between two corners with square pillars: so many elements between neighbouring edges, fine at these."""
    assert design.pillar
    side, height = design.pillar.base_m, design.pillar.height_m
    lines = []
    for axis in (0, 1):
        edges = [low[axis], high[axis], *(feet[:, axis] - side / 2.0), *(feet[:, axis] + side / 2.0)]
        lines.append(graded(edges, parts, side))
    z = graded([0.0, design.thickness_m, design.thickness_m + height], parts, side)
    x, y, middle = np.meshgrid(*((line[:-1] + line[1:]) / 2.0 for line in (*lines, z)), indexing="ij")
    under = np.zeros(x.shape, dtype=bool)
    for foot in feet:
        under |= (np.abs(x - foot[0]) < side / 2.0) & (np.abs(y - foot[1]) < side / 2.0)
    region = np.where(middle < design.thickness_m, 0, np.where(under, 1, VOID))
    return Boxes(lines[0], lines[1], z, region, ("plate", "pillar"))


def graded(edges: list[float], parts: int, side: float) -> FloatArray:
    """Edges, each once, and lines between them, nearer to each other towards the edges; more where the edges are far apart."""
    own, lines = np.unique(np.round(edges, 12)), list[FloatArray]()
    for one, two in pairwise(own):
        t = np.linspace(0.0, 1.0, parts * max(1, round((two - one) / side)) + 1)[:-1]
        lines.append(one + (two - one) * np.where(t < 0.5, 2.0 * t**2, 1.0 - 2.0 * (1.0 - t) ** 2))
    return np.concatenate([*lines, own[-1:]])


def own_mesh(design: Design, parts: int, whole: bool) -> Mesh:
    """The other program's mesh: a plate with all its pillars, or a cell."""
    if whole:
        half = np.array(design.plate_m) / 2.0
        return hex_mesh(boxes_of(-half, half, design.pillar_centres(), design, parts), 2)
    half = np.array([design.pitch_x_m, design.pitch_y_m]) / 2.0
    return hex_mesh(boxes_of(-half, half, np.zeros((1, 2)), design, parts), 2)


def materials_of(case: Case) -> Mapping[str, Material]:
    """Materials by region."""
    assert case.design.pillar
    return {"plate": case.design.material, "pillar": case.design.pillar.material}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(CELLS))
def test_a_drawn_cell_has_the_other_programs_bands_inside_both_bars(seed: int) -> None:
    """At X or M, where a cell is real."""
    case = case_from_dict(cell_of(seed))
    point, design = bands_of(case, LOG, every_gap=False).points[1 + seed % 2], case.design
    k = np.array([point.kx_per_m, point.ky_per_m])

    def theirs(parts: int) -> FloatArray:
        return other_bands(own_mesh(design, parts, False), design.lattice, k, COUNT, materials_of(case))

    check(np.array(point.frequencies_hz), np.array(point.error, dtype=float), theirs)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(PLATES))
def test_a_drawn_plate_has_the_other_programs_modes_inside_both_bars(seed: int) -> None:
    """All modes of a band counted and compared; it ends little above a mode of the other program, which is too high."""
    case = case_from_dict(plate_of(seed))

    @cache
    def theirs(parts: int) -> FloatArray:
        return other_modes(own_mesh(case.design, parts, True), COUNT + 3, materials_of(case))

    found = theirs(MESHES[1])
    last = COUNT - 2 + int(np.argmax(found[COUNT - 1 :] / found[COUNT - 2 : -1]))  # below the widest of the last gaps
    band = 0.5 * found[0], float(found[last] * (found[last + 1] / found[last]) ** ABOVE)
    query = Request("plate", band_hz=band, search=False)
    rows = sorted(solve_modes(case, query, LOG).rows, key=lambda row: row.frequency_hz)
    assert len(rows) == last + 1
    ours, bars = (np.array([getattr(row, name) for row in rows], dtype=float) for name in ("frequency_hz", "error"))
    check(ours, bars, lambda parts: theirs(parts)[: last + 1])


def check(ours: FloatArray, bars: FloatArray, theirs: Callable[[int], FloatArray]) -> None:
    """Require every frequency inside its bar about the range of the other program's limits, and that both say something.

    Its coarse meshes need not be near their order yet: then the next one decides.
    """
    coarse, middle = (theirs(parts) for parts in MESHES[:2])
    if (beyond(ours, coarse, middle, MESHES[1] / MESHES[0]) > bars).any():
        coarse, middle = middle, theirs(MESHES[2])
        off = beyond(ours, coarse, middle, MESHES[2] / MESHES[1])
        assert (off <= bars).all(), (off / bars).round(2).tolist()
    assert np.median(bars + (coarse - middle) / ours) < 0.05


def beyond(ours: FloatArray, coarse: FloatArray, fine: FloatArray, ratio: float) -> FloatArray:
    """How far a frequency lies outside the range of limits of two meshes, relative to it."""
    low, high = (fine - (coarse - fine) / (ratio**order - 1.0) for order in ORDERS)
    return np.maximum(low - ours, ours - high) / ours
