"""Integrals over the part of a face on one side of a line, on facets that no mesh line parts there."""

from __future__ import annotations

import numpy as np
import pytest

from geometry.elements import FloatArray
from geometry.hex.panels import panel_mesh
from geometry.hex.scenes import HexSettings
from geometry.layout import Pillar
from geometry.materials import MATERIALS, Stack
from geometry.tiling import Panel
from solvers.fem.surface import FaceQuadrature, face_quadrature, facet_quadrature

T, H, R, SIDE = 2e-3, 6e-3, 1e-3, 4e-3
STACK = Stack.of(T, MATERIALS["aluminium"])
PANEL = Panel((-SIDE / 2, -SIDE / 2), (SIDE / 2, SIDE / 2), (0.0, 0.0))
LINES = {"tangent": R, "just within": 0.999 * R, "crossing": 0.37 * R, "middle": 0.0, "outside": 1.3 * R}
EXACT = 1e-10  # of the integral, straight edges: polynomials on polygons
AREA = 1e-7  # of the area below a line, curved edges: a tenth of what levels ask for


def below(rule: FaceQuadrature, line_m: float, powers: tuple[int, int]) -> float:
    """The integral of x^a y^b over y < line."""
    x, y = rule.points[:, 0], rule.points[:, 1]
    return float((rule.weights * x ** powers[0] * y ** powers[1])[y < line_m].sum())


def exact(line_m: float, powers: tuple[int, int]) -> float:
    """The same over the panel."""
    along, across = powers[0] + 1, powers[1] + 1
    return (2.0 * (SIDE / 2) ** along / along) * (line_m**across - (-SIDE / 2) ** across) / across


@pytest.mark.parametrize("shape", ["round", "hexagonal"])
@pytest.mark.parametrize("place", LINES)
@pytest.mark.parametrize("order", [*(pytest.param(order, marks=pytest.mark.slow) for order in (2, 4)), 3])
def test_integrals_end_at_a_line_about_a_foot(shape: str, place: str, order: int) -> None:
    """The facets about the foot fill a rectangle whatever their edges: moments of its part below a line are known."""
    pillar = Pillar(shape, 2.0 * R, 2.0 * R, H, MATERIALS["aluminium"])
    mesh = panel_mesh(PANEL, STACK, pillar, HexSettings(order, SIDE, 1, 0.15, H)).mesh
    rule = face_quadrature(mesh, "touch", [-LINES[place], LINES[place]])
    for powers in ((0, 0), (2, 0), (2, 1), (0, 3)) if shape == "hexagonal" else ((0, 0),):
        for line in (-LINES[place], LINES[place]):
            want = exact(line, powers)
            scale = abs(exact(SIDE / 2, (powers[0], 0))) * (SIDE / 2) ** powers[1]
            limit = AREA if shape == "round" else EXACT
            assert below(rule, line, powers) == pytest.approx(want, abs=limit * scale)


def test_a_rule_without_lines_in_reach_stays_the_same() -> None:
    """Lines along edges of straight facets and beyond the face part nothing."""
    square = Pillar("square", 2.0 * R, 2.0 * R, H, MATERIALS["aluminium"])
    mesh = panel_mesh(PANEL, STACK, square, HexSettings(3, SIDE, 1, 0.15, H)).mesh
    plain, cut = (face_quadrature(mesh, "touch", lines) for lines in ((), (R, -R, SIDE)))
    order = [np.lexsort(rule.points[:, :2].T) for rule in (plain, cut)]
    assert len(plain.weights) == len(cut.weights)
    for name in ("points", "weights"):
        one, other = (getattr(rule, name)[own] for rule, own in zip((plain, cut), order, strict=True))
        assert one == pytest.approx(other, rel=1e-12, abs=1e-18)


@pytest.mark.parametrize("line_m", [0.31, 0.5, 0.77])
@pytest.mark.parametrize("bent", [0.0, 0.06])
def test_triangles_straight_and_bent(line_m: float, bent: float) -> None:
    """Two quadratic triangles fill the unit square whatever becomes of their common edge."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    facets = np.array([[0, 1, 2, 4, 5, 8], [0, 2, 3, 8, 6, 7]])
    middles = [(0.5, 0.0), (1.0, 0.5), (0.5, 1.0), (0.0, 0.5), (0.5 - bent, 0.5 + bent)]
    nodes = np.column_stack([np.vstack([corners, middles]), np.zeros(9)])
    rule = facet_quadrature(nodes, facets, 2, [line_m])
    under = rule.points[:, 1] < line_m
    assert rule.weights[under].sum() == pytest.approx(line_m, rel=EXACT)
    field: FloatArray = rule.interpolation @ (nodes[:, 0] * nodes[:, 1])
    if not bent:  # u = x y is among the functions: its square is integrated exactly
        assert rule.weights[under] @ field[under] ** 2 == pytest.approx(line_m**3 / 9.0, rel=EXACT)
