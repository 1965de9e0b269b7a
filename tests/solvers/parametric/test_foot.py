"""Quarter cells of pillars of several shapes: sound meshes, exactly affine matrices, bands of independent meshes."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from geometry.layout import Pillar
from geometry.materials import Material
from geometry.mesh import check_mesh
from geometry.tiling import lattice_panel
from pipeline.case.model import load_case
from pipeline.logs import WarningLog
from pipeline.models.unit_cell import lattice_model
from pipeline.paths import STUDIES
from pipeline.planning import mesh_rules
from pipeline.planning.model_choice import cell_model_choice
from solvers.accuracy.reduction import reduction_error
from solvers.fem.assembly import Scale, assemble
from solvers.fem.surface import face_quadrature
from solvers.parametric.affine import (
    AffineCell,
    DesignBox,
    FixedMesh,
    Foot,
    as_sizes,
    between,
    foot_of,
    plan_lines,
    quarter_mesh,
)
from solvers.parametric.cell import APART, fitted_touch
from solvers.plates.assembled import Reductions
from solvers.superelement.lattice import ReducedLattice
from solvers.superelement.symmetry import diagonal_image

ALUMINIUM, STEEL = Material.isotropic("aluminium", 70e9, 2700.0, 0.34), Material.isotropic("steel", 200e9, 7800.0, 0.3)
MATERIALS = {"plate": ALUMINIUM, "pillar": STEEL}
FEET = {
    "square": Foot(),
    "round": Foot(round=True),
    "narrowing": Foot(taper=0.6),
    "widening": Foot(taper=1.3),
    "cross": Foot(arm=0.4),
    "hexagonal": Foot(hexagonal=True),
}
SIZES = (1.2e-3, 4.4e-3, 1.7e-3, 3.1e-3)


def area(foot: Foot) -> float:
    """Area of the foot over its width squared."""
    if foot.hexagonal:
        return float(np.sqrt(0.75))
    return float(np.pi / 4.0) if foot.round else 1.0 - (1.0 - foot.arm) ** 2


@pytest.fixture(params=FEET.values(), ids=FEET)
def foot(request: pytest.FixtureRequest) -> Foot:
    return request.param


def test_the_quarter_is_sound_and_as_alike_along_x_and_y_as_its_foot(foot: Foot) -> None:
    mesh, _ = quarter_mesh(foot, SIZES, FixedMesh(layers=1))
    t, h, a, p = SIZES
    volume = area(foot) * (1.0 + foot.taper + foot.taper**2) / 3.0
    check_mesh(mesh, t * p * p / 4.0 + volume * a * a * h / 4.0, 2e-5)
    assert (diagonal_image(mesh) is not None) == foot.is_alike
    (local,) = mesh.element.facets
    shared = Counter(tuple(sorted(facet)) for face in local for facet in mesh.cells[:, face].tolist())
    assert max(shared.values()) == 2
    named = {tuple(sorted(facet)) for name in mesh.faces for facet in mesh.faces[name].tolist()}
    assert all(shared[facet] == 1 for facet in named)
    flat = [face_quadrature(mesh, name).weights.sum() for name in ("touch", "top")]
    assert flat == pytest.approx([p * p / 4.0, foot.taper**2 * area(foot) * a * a / 4.0], rel=2e-5)


@pytest.mark.parametrize("mesh", [FixedMesh(), FixedMesh(2, beside=1, along=3, layers=0)], ids=["shipped", "coarse"])
def test_a_touch_face_follows_what_its_elements_do(foot: Foot, mesh: FixedMesh) -> None:
    """Cubic polynomials (of coarse elements quadratic ones) are kept, and no value grows much, though few of the elements that
    stand along a round foot's block tell polynomials of a high degree apart.
    """
    layers = min(mesh.layers, 1) if foot.arm < 1.0 else mesh.layers
    quarter, _ = quarter_mesh(foot, SIZES, replace(mesh, layers=layers))
    points, weights, rows = fitted_touch(quarter, plan_lines(SIZES, DesignBox(foot=foot)))
    at, half = face_quadrature(quarter, "touch").points[:, :2], SIZES[3] / 2.0

    def moved(places: np.ndarray) -> np.ndarray:
        x, y = places.T / half
        return np.asarray((1.0 + x - x**mesh.order) * (2.0 + y**mesh.order))

    assert rows @ moved(at) == pytest.approx(moved(points), abs=1e-10)
    assert np.abs(rows).sum(axis=1).max() < 6.0 * APART  # of 36 products at most 1 each, by Schwarz's inequality
    assert weights.sum() == pytest.approx(half**2)


def test_a_foot_is_as_large_as_the_pillar_of_its_shape() -> None:
    """Area and largest extent, against the outline that is built."""
    for shape, foot in (("square", Foot()), ("round", Foot(round=True)), ("hexagonal", Foot(hexagonal=True))):
        pillar = Pillar(shape, 2e-3, 2e-3, 6e-3, STEEL)
        assert area(foot) * 4e-6 == pytest.approx(pillar.form.section.area_m2, rel=1e-9)
        assert foot.footprint * 2e-3 == pytest.approx(pillar.footprint_m, rel=1e-12)
        assert foot.widest * 2e-3 == pytest.approx(pillar.widest_m, rel=1e-12)


def test_matrices_of_stretched_cells_are_sums_of_products(foot: Foot) -> None:
    box = DesignBox((1.5e-3, 4e-3, 1.5e-3, 3e-3), (2.5e-3, 7e-3, 2.5e-3, 5e-3), foot=foot)
    cell = AffineCell(box, FixedMesh(order=2, along=2, layers=0), ALUMINIUM, STEEL)
    for sizes in as_sizes(box.sample(between(2, seed=5))):
        mesh = replace(cell.mesh, nodes=cell.plan(cell.mesh.nodes, sizes), spans=None)
        system = assemble(mesh, MATERIALS, replace(cell.scale))
        for form, target in ((cell.stiffness, system.stiffness), (cell.mass, system.mass)):
            pairs = zip(cell.theta(form, sizes), form.matrices, strict=True)
            combined = sum(weight * matrix for weight, matrix in pairs)
            assert abs(combined - target).max() < 1e-12 * abs(target).max()


@pytest.mark.slow
def test_a_cylinder_has_its_inertia() -> None:
    """Mass and moment of inertia of the pillar about the cell's axes, as a solid cylinder has them."""
    _, h, a, _ = SIZES
    mesh, _ = quarter_mesh(Foot(round=True), SIZES, FixedMesh())
    system = assemble(mesh, MATERIALS, Scale(1.0, 1.0, 1.0))
    mass = system.region_mass("pillar")
    assert mass is not None
    weight = 7800.0 * np.pi / 4.0 * a * a * h
    assert 4.0 * mass.sum() == pytest.approx(weight, rel=1e-5)
    about_z = 4.0 * (mesh.nodes[:, 0] @ (mass @ mesh.nodes[:, 0]) + mesh.nodes[:, 1] @ (mass @ mesh.nodes[:, 1]))
    assert about_z == pytest.approx(weight * a * a / 8.0, rel=1e-4)


@pytest.mark.parametrize(
    ("change", "target"),
    [
        ({"shape": "round"}, Foot(round=True)),
        ({"shape": "tapered", "tip_m": 1e-3}, Foot(taper=0.5)),
        ({"shape": "cross", "more_m": (("arm_m", 0.8e-3),)}, Foot(arm=0.4)),
        ({"shape": "hexagonal"}, Foot(hexagonal=True)),
        ({"fillet_m": 2e-4}, None),
        ({"faces": 2}, None),
    ],
)
def test_the_section_of_a_pillar(change: dict[str, object], target: Foot | None) -> None:
    assert foot_of(replace(Pillar("square", 2e-3, 2e-3, 6e-3, STEEL), **change)) == target


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["round", "tapered", "cross", "hexagonal"])
def test_bands_are_those_of_an_independent_mesh(shape: str) -> None:
    """Against tetrahedra, and a cross against structured hexahedra: within their bars and what the quarter's mesh may miss."""
    kind = "hex" if shape == "cross" else "tet"
    case = load_case(STUDIES / "three-rows.toml", ["solve.accuracy=0.005", f"solve.mesh={kind}"])
    design, count = case.design, 10
    assert design.pillar is not None
    more = {"tapered": {"tip_m": 1.2e-3}, "cross": {"more_m": (("arm_m", 0.8e-3),)}}.get(shape, {})
    pillar = replace(design.pillar, shape=shape, **more)
    case = replace(case, design=replace(design, pillar=pillar), bands=case.bands.but(count=count))
    foot, pitch = foot_of(pillar), design.pitch_x_m
    assert foot is not None
    corners = np.pi / pitch * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    sizes = (design.thickness_m, pillar.height_m, pillar.base_m, pitch)
    mesh, _ = quarter_mesh(foot, sizes, FixedMesh(layers=1 if shape == "cross" else 2))
    reduction = mesh_rules.lattice_reduction(design, case.solve.accuracy)
    reductions = Reductions(design.stack, pillar, reduction, None, lambda panel: mesh)
    own = ReducedLattice(reductions.cell(lattice_panel(design)))
    other = lattice_model(case, cell_model_choice(case), corners, WarningLog(), [], finer=False)
    ours, theirs = (np.array([each.waves(k, count).frequency_hz for k in corners]) for each in (own, other.lattice))
    moving = theirs > 1e-3 * theirs.max()
    assert other.mesh_error is not None
    bar = other.mesh_error + other.reduction_error + reduction_error(own, corners, count).total + 0.004
    assert np.abs(ours[moving] / theirs[moving] - 1.0).max() < bar < 0.02
