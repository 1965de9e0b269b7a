"""Sections, symmetries and volumes of pillar shapes against closed forms and against what other programs find."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import pi, sqrt
from types import SimpleNamespace

import numpy as np
import pytest

from geometry.cad.printing import features
from geometry.cad.solids import cell_solid, pillar_solid
from geometry.errors import GeometryError
from geometry.hex.boxes import cell_boxes, hex_mesh, pillar_boxes
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS
from geometry.mesh import Mesh, check_mesh
from geometry.pillar_shapes import SHAPES, Cross, Hexagonal, PillarShape, Round, Square, Tapered, shape_of

ALUMINIUM = MATERIALS["aluminium"]
S, A = 2e-3, 0.8e-3  # overall width and arm, m
ARMS = (("arm_m", A),)
CROSS = Pillar("cross", S, S, 6.3e-3, ALUMINIUM, more_m=ARMS)
HEXAGON = Pillar("hexagonal", S, S, 6.3e-3, ALUMINIUM)
KERNEL = 1e-6  # relative: booleans hold to the kernel's own tolerance
SHAPED = {"square": Square(S, S), "round": Round(S, S), "hexagonal": Hexagonal(S, S), "cross": Cross(S, S, ARMS)}
EXACT = {  # area and second moment about any axis in the plane
    "square": (S**2, S**4 / 12),
    "round": (pi * S**2 / 4, pi * S**4 / 64),
    "hexagonal": (sqrt(3) / 2 * S**2, 5 * sqrt(3) / 144 * S**4),
    "cross": (2 * S * A - A**2, (A * S**3 + (S - A) * A**3) / 12),
}


def cell(pillar: Pillar, pitch_x: float = 4e-3, pitch_y: float = 4e-3) -> Design:
    return Design(30e-3, 10e-3, 2e-3, 3, ALUMINIUM, pillar, pitch_x, pitch_y, 1, 3e-3)


@pytest.mark.parametrize("name", SHAPED)
def test_sections_have_their_closed_form(name: str) -> None:
    section, (area, about) = SHAPED[name].section, EXACT[name]
    assert (section.area_m2, section.about_x_m4, section.about_y_m4) == pytest.approx((area, about, about), rel=1e-12)


def test_a_rectangle_is_stiffer_about_one_axis_than_about_the_other() -> None:
    """As no shape of the list is, which all look alike along x and y."""
    x, y = 1.5e-3, 0.5e-3
    corners = np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) + np.array([0.3e-3, -0.2e-3])
    section = PillarShape.section.__get__(SimpleNamespace(outline=lambda: corners))
    about_x, about_y = (4.0 * x * y * (half**2 / 3.0 + off**2) for half, off in ((y, 0.2e-3), (x, 0.3e-3)))
    assert (section.area_m2, section.about_x_m4, section.about_y_m4) == pytest.approx((4.0 * x * y, about_x, about_y))


def test_one_box_on_a_square_foot_is_the_square_alone() -> None:
    assert [name for name, shape in SHAPED.items() if shape.is_square_prism] == ["square"]
    assert not Tapered(S, S / 2.0).is_square_prism


def test_every_registered_shape_is_tested_here() -> None:
    assert {*SHAPES} == {*SHAPED, "tapered", "step"}


def test_outlines_grow_by_the_fillet_on_every_side() -> None:
    for shape in SHAPED.values():
        inner, outer = shape.outline(), shape.outline(0.3e-3)
        assert np.ptp(outer[:, 1]) == pytest.approx(np.ptp(inner[:, 1]) + 0.6e-3, rel=1e-12)
        turning = np.cross(np.roll(outer, -1, axis=0) - outer, np.roll(outer, -2, axis=0) - np.roll(outer, -1, axis=0))
        assert turning.sum() > 0.0  # anticlockwise
    notch = SHAPED["cross"].outline(0.3e-3)
    assert sorted({round(abs(v), 9) for v in notch.ravel()}) == [A / 2 + 0.3e-3, S / 2 + 0.3e-3]


def test_mirrors_are_those_of_the_section() -> None:
    mirrors = {name: shape.mirrors for name, shape in SHAPED.items()}
    assert mirrors == {
        "square": ("x", "y", "d"),
        "round": ("x", "y", "d", "h"),
        "hexagonal": ("x", "y", "h"),
        "cross": ("x", "y", "d"),
    }
    assert Tapered(S, 1e-3).mirrors == ("x", "y", "d")
    assert shape_of("step", S, S).mirrors == ()
    assert cell(HEXAGON).cell_mirrors == ("x", "y") and cell(CROSS).cell_mirrors == ("x", "y", "d")
    assert cell(CROSS, 4e-3, 5e-3).cell_mirrors == ("x", "y")
    assert HEXAGON.is_symmetric and CROSS.is_symmetric


def test_two_flats_of_a_hexagon_face_y_and_two_corners_lie_on_the_x_axis() -> None:
    assert Hexagonal(S, S).extent_m() == pytest.approx((2 / sqrt(3) * S, S), rel=1e-12)
    assert HEXAGON.footprint_m == pytest.approx(2 / sqrt(3) * S, rel=1e-12)
    box = pillar_solid(HEXAGON).shape.BoundingBox()
    assert (box.xlen, box.ylen, box.zlen) == pytest.approx((4 / sqrt(3), 2.0, 6.3), rel=KERNEL)
    gaps = features(cell(HEXAGON))
    assert gaps["gap between pillars along x"] == pytest.approx(4e-3 - 2 / sqrt(3) * S, rel=1e-12)


@pytest.mark.parametrize(
    ("pillar", "area"), [(CROSS, EXACT["cross"][0]), (HEXAGON, EXACT["hexagonal"][0])], ids=["x", "6"]
)
def test_solids_have_the_volume_of_their_section(pillar: Pillar, area: float) -> None:
    volume = area * 6.3e-3
    assert pillar.volume_m3 == pytest.approx(volume, rel=1e-12)
    assert pillar_solid(pillar).volume_m3 == pytest.approx(volume, rel=KERNEL)
    whole = 4e-3 * 4e-3 * 2e-3 + volume
    for mirrors in ("", "x", "y", "xy"):
        assert cell_solid(cell(pillar), mirrors).volume_m3 == pytest.approx(whole / 2 ** len(mirrors), rel=KERNEL)


@pytest.mark.parametrize(
    ("pillar", "perimeter", "turns"), [(HEXAGON, 4 * sqrt(3), 2 * sqrt(3)), (CROSS, 8, 4)], ids=["6", "x"]
)
def test_fillets_grow_the_outline_and_meet_in_mitres(pillar: Pillar, perimeter: float, turns: float) -> None:
    """A polygon moved outwards by g has the area A + P g + g^2 sum tan(turn/2): integrated over a quarter circle's g(z)."""
    r = 0.3
    flare = perimeter * r**2 * (1 - pi / 4) + turns * r**3 * (5 / 3 - pi / 2)
    filleted = replace(pillar, fillet_m=r * 1e-3)
    body = pillar_solid(filleted)
    assert body.volume_m3 * 1e9 == pytest.approx(pillar.volume_m3 * 1e9 + flare, rel=KERNEL)
    box = body.shape.BoundingBox()
    assert (box.xlen, box.ylen) == pytest.approx([1e3 * size for size in filleted.form.extent_m(r * 1e-3)], rel=KERNEL)
    assert filleted.footprint_m * 1e3 == pytest.approx(box.xlen, rel=KERNEL)


def test_boxes_of_a_cross_fill_its_volume_and_mirror_onto_themselves() -> None:
    settings = HexSettings(2, 2e-3, 1, 0.2)
    for quarter in (True, False):
        mesh = hex_mesh(pillar_boxes(CROSS, settings, quarter), 2)
        assert check_mesh(mesh).volume_m3 * (4 if quarter else 1) == pytest.approx(CROSS.volume_m3, rel=1e-12)
    mesh = hex_mesh(cell_boxes(cell(CROSS), settings), 2)
    assert volume_of(mesh, "pillar") == pytest.approx(CROSS.volume_m3, rel=1e-12)
    nodes = {tuple(node) for node in np.round(mesh.nodes * 1e12).astype(np.int64)}
    for axes, signs in (([0, 1, 2], [-1, 1, 1]), ([0, 1, 2], [1, -1, 1]), ([1, 0, 2], [1, 1, 1])):
        assert {tuple(node) for node in np.round(mesh.nodes[:, axes] * signs * 1e12).astype(np.int64)} == nodes


def volume_of(mesh: Mesh, region: str) -> float:
    return float(mesh.spans[mesh.regions[region]].prod(axis=1).sum())


def test_lines_along_the_arms_are_graded_as_along_a_squares_sides() -> None:
    """Both sides of every line where a foot's edge runs are cut by the factor of the grading."""
    settings = HexSettings(3, 4e-3, 1, 0.2)
    cross, square = (
        cell_boxes(cell(CROSS), settings),
        cell_boxes(cell(replace(CROSS, shape="square", more_m=())), settings),
    )
    for lines in (cross.x, cross.y):
        for edge in (-S / 2, -A / 2, A / 2, S / 2):
            assert_graded(lines, edge, 0.2)
    for lines in (square.x, square.y):
        for edge in (-S / 2, S / 2):
            assert_graded(lines, edge, 0.2)


def assert_graded(lines: np.ndarray, edge: float, factor: float) -> None:
    """On both sides of an edge the interval next to it is `factor` of the two that it was cut from."""
    at = int(np.argmin(np.abs(lines - edge)))
    assert lines[at] == pytest.approx(edge, abs=1e-15)
    for choice in (-1, 1):
        near, far = abs(lines[at + choice] - edge), abs(lines[at + 2 * choice] - edge)
        assert near == pytest.approx(factor * far, rel=1e-9)


def test_a_shape_that_boxes_cannot_make_is_not_meshed_as_a_square() -> None:
    from geometry.errors import MeshError

    for pillar in (HEXAGON, Pillar("square", S, S, 6.3e-3, ALUMINIUM, 0.2e-3)):
        with pytest.raises(MeshError, match="is not made of boxes"):
            pillar_boxes(pillar, HexSettings())


def test_an_unknown_shape_is_named() -> None:
    with pytest.raises(GeometryError, match="'oval' is not one of square, round"):
        _ = Pillar("oval", S, S, 6e-3, ALUMINIUM).footprint_m


def saint_venant(mesh: object) -> tuple[float, float]:
    """P, Q of the shear factor (1 + nu)/(P + Q nu) of a section symmetric in x and y, bent along x (cowper1966, eq. 43).

    The harmonic flexure function chi by quadratic triangles, d chi/dn = -n_x (nu x^2/2 + (1 - nu/2) y^2) - n_y (2 + nu) x y:
    1/kappa = [nu (I_x - I_y)/2 - A/I_y int x (chi + x y^2)]/(2 (1 + nu) I_y).
    """
    skfem = pytest.importorskip("skfem", reason="scikit-fem, the oracle of this test, is not installed (extra: dev)")
    from skfem.helpers import dot, grad

    basis = skfem.Basis(mesh, skfem.ElementTriP2(), intorder=6)
    rim = skfem.FacetBasis(mesh, skfem.ElementTriP2(), intorder=6)
    stiffness = skfem.BilinearForm(lambda u, v, w: dot(grad(u), grad(v))).assemble(basis)
    first = skfem.LinearForm(lambda v, w: w.x[0] * v).assemble(basis)

    def over(power_x: int, power_y: int) -> float:
        return float(skfem.Functional(lambda w: w.x[0] ** power_x * w.x[1] ** power_y).assemble(basis))

    area, about_x, about_y = over(0, 0), over(0, 2), over(2, 0)
    result = []
    for nu in (0.0, 0.5):

        def pull(v, w, nu=nu):
            (x, y), (nx, ny) = w.x, w.n
            return (-nx * (nu * x**2 / 2 + (1 - nu / 2) * y**2) - ny * (2 + nu) * x * y) * v

        chi = skfem.solve(*skfem.condense(stiffness, skfem.LinearForm(pull).assemble(rim), D=np.array([0])))
        chi -= skfem.LinearForm(lambda v, w: v).assemble(basis) @ chi / area  # a constant does no work against x
        inner = nu / 2 * (about_x - about_y) - area / about_y * (first @ chi + over(2, 2))
        result.append(inner / (2 * about_y))
    return result[0], (result[1] - result[0]) / 0.5


def sections() -> dict[str, object]:
    skfem = pytest.importorskip("skfem", reason="scikit-fem, the oracle of this test, is not installed (extra: dev)")

    def crossed(ratio: float, count: int = 10) -> object:
        half = (1 - np.cos(np.pi * (1 - np.cos(np.pi * np.linspace(0, 1, count + 1))) / 2)) / 2  # graded to both ends
        ends = np.array([-0.5, -ratio / 2, ratio / 2, 0.5])
        lines = np.unique(np.concatenate([a + (b - a) * half for a, b in pairwise(ends)]).round(12))
        mesh = skfem.MeshTri.init_tensor(lines, lines)
        middle = np.abs(mesh.p[:, mesh.t].mean(axis=1))
        return mesh.restrict(np.flatnonzero((middle < ratio / 2).any(axis=0)))

    corners = Hexagonal(1.0, 1.0).outline()
    fan = np.array([[k, (k + 1) % 6, 6] for k in range(6)])
    grid = np.linspace(-0.5, 0.5, 9)
    return {
        "square": skfem.MeshTri.init_tensor(grid, grid),
        "round": skfem.MeshTri.init_circle(4),
        "hexagonal": skfem.MeshTri(np.vstack([corners, [0, 0]]).T, fan.T).refined(3),
    } | {f"cross {ratio}": crossed(ratio) for ratio in (0.05, 0.2, 0.4, 0.7, 0.95)}


def test_shear_factors_are_those_of_saint_venants_flexure() -> None:
    """Square and circle have closed forms that prove the solve itself; the elements' own error is below 4e-4 at the notches."""
    for name, mesh in sections().items():
        p, q = saint_venant(mesh)
        kind, _, ratio = name.partition(" ")
        shape = shape_of(kind, 1.0, 1.0, (("arm_m", float(ratio)),) if ratio else ())
        for nu in (0.0, 0.34, 0.49):
            assert shape.shear_factor(nu) == pytest.approx((1 + nu) / (p + q * nu), rel=8e-4 if ratio else 1e-4), name
