"""Hexagonal and cross-shaped pillars on a clamped foot against meshes of other kinds and against beam theory with shear."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from geometry.hex.boxes import hex_mesh, pillar_boxes
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, Pillar
from geometry.materials import MATERIALS, Stack
from geometry.mesh import Mesh, check_mesh, split_hexahedra
from geometry.tiling import Panel, lattice_panel
from pipeline.case.model import load_case
from pipeline.logs import WarningLog
from pipeline.paths import STUDIES
from pipeline.planning import mesh_rules
from solvers.accuracy import calibration
from solvers.analytic.predesign import pillar_frequencies_hz
from solvers.fem.eigen import modes_in_band
from solvers.fem.solid import SolidModel
from solvers.plates.assembled import Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.lattice import ReducedLattice
from solvers.waves.branches import Mirrors
from tests.helpers import bodies
from tests.helpers.asked import solve_bands

ALUMINIUM = MATERIALS["aluminium"]
CASE = STUDIES / "three-rows.toml"
S = 2e-3  # m
HEXAGON = Pillar("hexagonal", S, S, 6.3e-3, ALUMINIUM)
CROSS = Pillar("cross", S, S, 6.3e-3, ALUMINIUM, more_m=(("arm_m", 0.8e-3),))
SLENDER = 10.0  # heights over widths


def hexagonal_rod(pillar: Pillar, cuts: int, slices: int, order: int) -> Mesh:
    """Three rhombi about the axis, each cut into hexahedra: neither CAD nor a mesher has a hand in it."""
    side = pillar.base_m / sqrt(3.0)
    block = bodies.bricks(bodies.even((1.0, 1.0, pillar.height_m), (cuts, cuts, slices)), order)
    corners = side * np.array([[np.cos(k * np.pi / 3), np.sin(k * np.pi / 3)] for k in range(6)])

    def rhombus(first: int):
        one, two = corners[first], corners[(first + 2) % 6]
        return lambda nodes: np.column_stack([nodes[:, :1] * one + nodes[:, 1:2] * two, nodes[:, 2]])

    return bodies.joined([bodies.mapped(block, rhombus(first)) for first in (0, 2, 4)])


def clamped_hz(mesh: Mesh, high_hz: float) -> np.ndarray:
    pencil = bodies.constrained(mesh, ALUMINIUM, [(bodies.at(mesh, 2, 0.0), [0, 1, 2])])
    return modes_in_band(pencil, 0.0, high_hz).frequency_hz


def theory_error(pillar: Pillar) -> float:
    """What Timoshenko's first frequency of a square pillar as slender was measured to be off the solid by."""
    error = calibration.by_theory("pillar", "timoshenko", pillar.base_m / pillar.height_m)
    assert error is not None
    return error


@pytest.mark.parametrize("height", [6.3e-3, SLENDER * S], ids=["6.3 mm", "slender"])
def test_a_hexagonal_pillar_vibrates_as_a_beam_with_shear_and_alike_in_every_direction(height: float) -> None:
    pillar = replace(HEXAGON, height_m=height)
    beam = pillar_frequencies_hz(pillar, "timoshenko")[0]
    mesh = hexagonal_rod(pillar, 2, 5, 3)
    assert check_mesh(mesh).volume_m3 == pytest.approx(pillar.volume_m3, rel=1e-9)
    result = clamped_hz(mesh, 1.5 * beam)
    assert len(result) == 2 and result[1] == pytest.approx(
        result[0], rel=1e-8
    )  # a third of a turn leaves a hexagon as it is
    assert result[0] == pytest.approx(
        beam, rel=theory_error(pillar) + 2e-3
    )  # and the clamp's singular rim on this mesh
    inner, outer = (
        pillar_frequencies_hz(Pillar("round", width, width, height, ALUMINIUM), "timoshenko")[0]
        for width in (S, 2.0 / sqrt(3.0) * S)
    )
    assert inner < result[0] < outer  # the circles in it and about it


@pytest.mark.slow
@pytest.mark.parametrize("height", [6.3e-3, SLENDER * S], ids=["6.3 mm", "slender"])
@pytest.mark.parametrize("arm", [0.4e-3, 0.8e-3])
def test_a_cross_vibrates_as_a_beam_with_shear(height: float, arm: float) -> None:
    pillar = replace(CROSS, height_m=height, more_m=(("arm_m", arm),))
    beam = pillar_frequencies_hz(pillar, "timoshenko")[0]
    result = lowest(pillar, HexSettings(3, S, 1, 0.15, height / 4.0), "SA", 1.5 * beam)
    assert result == pytest.approx(beam, rel=theory_error(pillar) + 2e-3)


def lowest(pillar: Pillar, settings: HexSettings, symmetry: str, high_hz: float) -> float:
    """The lowest frequency of a symmetry class of the pillar's quarter."""
    mesh = hex_mesh(pillar_boxes(pillar, settings), settings.order)
    model = SolidModel(mesh, {"pillar": ALUMINIUM}, ("touch",), True)
    return float(modes_in_band(model.pencil(symmetry), 0.0, high_hz).frequency_hz[0])


@pytest.mark.slow
def test_hexahedra_and_tetrahedra_of_a_cross_fall_towards_one_limit() -> None:
    """Quadratic tetrahedra on the same nodes are stiffer; both lie above hexahedra of a higher order, which are graded, too."""
    finest = lowest(CROSS, HexSettings(3, S, 1, 0.15, S), "SA", 60e3)
    result = []
    for size in (S / 2, S / 4):
        mesh = hex_mesh(pillar_boxes(CROSS, HexSettings(2, size, 0, pillar_size_m=2 * size), quarter=False), 2)
        result.append((clamped_hz(mesh, 60e3)[0], clamped_hz(split_hexahedra(mesh), 60e3)[0]))
    (coarse_hex, coarse_tet), (fine_hex, fine_tet) = result
    assert finest < fine_hex < coarse_hex < coarse_tet and fine_hex < fine_tet < coarse_tet
    assert fine_tet / finest - 1.0 < 0.6 * (coarse_tet / finest - 1.0)


@pytest.mark.slow
def test_the_meshes_chosen_for_squares_are_as_good_for_a_cross() -> None:
    """Expected errors of the planner's hexahedra were measured on square pillars; a cross keeps within them."""
    design = Design(30e-3, 10e-3, 2e-3, 3, ALUMINIUM, CROSS, 4e-3, 4e-3, 1, 3e-3)
    coarse, fine = (mesh_rules.MESH_LEVELS["pillar"][at] for at in (0, 2))
    one, other = (
        lowest(CROSS, mesh_rules.pillar_mesh(design, mesh_level), "SA", 60e3) for mesh_level in (coarse, fine)
    )
    errors = [mesh_rules.expected_error("pillar", mesh_level) for mesh_level in (coarse, fine)]
    assert None not in errors and 0.0 < one / other - 1.0 <= sum(error for error in errors if error)


@pytest.mark.slow
def test_a_hexagon_through_cad_and_tetrahedra_is_that_of_its_hexahedra() -> None:
    from geometry.tet.scenes import tet_pillar

    short = replace(HEXAGON, height_m=3e-3)
    exact = clamped_hz(hexagonal_rod(short, 2, 5, 4), 150e3)[0]
    mesh = tet_pillar(short, mesh_rules.tet_edge_m(short.form.smallest_m, 0.01))
    assert check_mesh(mesh).volume_m3 == pytest.approx(short.volume_m3, rel=1e-6)
    model = SolidModel(mesh, {"body": ALUMINIUM, "pillar": ALUMINIUM, "plate": ALUMINIUM}, ("foot",), False)
    assert modes_in_band(model.pencil(None), 0.0, 150e3).frequency_hz[0] == pytest.approx(exact, rel=0.01)


def lattice_of(pillar: Pillar, pitch_m: float, mesher: Callable[[Panel], Mesh] | None = None) -> ReducedLattice:
    """A coarse cell of a square pitch, reduced."""
    design = Design(30e-3, 10e-3, 2e-3, 3, ALUMINIUM, pillar, pitch_m, pitch_m, 1, 3e-3)
    reduction = ReductionSettings(Interface(3, 2), 400e3, HexSettings(2, pitch_m, 0, pillar_size_m=pillar.height_m))
    reductions = Reductions(Stack.of(2e-3, ALUMINIUM), pillar, reduction, None, mesher)
    return ReducedLattice(reductions.cell(lattice_panel(design)))


def exchanged(lattice: ReducedLattice, count: int = 6) -> float:
    """The largest relative change of the lowest bands when kx and ky change places."""
    here = np.pi / lattice.cell.size_m[0] * np.array([0.9, 0.2])
    one, other = (np.sqrt(lattice.waves(k, count).eigenvalue) for k in (here, here[::-1]))
    return float(np.abs(one / other - 1.0).max())


def test_the_bands_of_a_cross_stay_when_kx_and_ky_change_places() -> None:
    lattice = lattice_of(replace(CROSS, height_m=3e-3), 4e-3)
    assert Mirrors(lattice.cell).names == ("x", "y", "d")
    assert exchanged(lattice) < 1e-8
    assert exchanged(lattice_of(Pillar("square", S, S, 3e-3, ALUMINIUM), 4e-3)) < 1e-8


def quarter_cell(corner: tuple[float, float], flat: tuple[float, float], pitch_m: float) -> Callable[[Panel], Mesh]:
    """A quarter cell of three blocks of hexahedra about a foot 0, (corner, 0), `flat`, (0, flat), its pillar on the first."""
    half, thickness, height = pitch_m / 2.0, 2e-3, 3e-3
    feet = np.array([[0.0, 0.0], corner, flat, [0.0, flat[1]]])
    outer = np.array([[half, 0.0], [half, half], [0.0, half]])
    blocks = [feet, [feet[1], outer[0], outer[1], feet[2]], [feet[3], feet[2], outer[1], outer[2]]]

    def bilinear(corners: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        a, b, c, d = (np.asarray(point) for point in corners)
        return lambda n: np.column_stack(
            [
                (1 - n[:, :1]) * ((1 - n[:, 1:2]) * a + n[:, 1:2] * d)
                + n[:, :1] * ((1 - n[:, 1:2]) * b + n[:, 1:2] * c),
                n[:, 2],
            ]
        )

    def mesh(panel: Panel) -> Mesh:
        plate = bodies.bricks(bodies.even((1.0, 1.0, thickness), (1, 1, 1)), 3)
        above = bodies.mapped(
            bodies.bricks(bodies.even((1.0, 1.0, height), (1, 1, 1)), 3), lambda n: n + np.array([0.0, 0.0, thickness])
        )
        parts = [bodies.mapped(plate, bilinear(corners)) for corners in blocks]
        whole = bodies.joined([*parts, bodies.mapped(above, bilinear(feet))])
        regions = {"plate": np.arange(3), "pillar": np.array([3])}
        planes = {"x-": (0, 0.0), "x+": (0, half), "y-": (1, 0.0), "y+": (1, half), "touch": (2, 0.0)}
        faces = {name: on_plane(whole, bodies.at(whole, *plane)) for name, plane in planes.items()}
        below = whole.nodes[whole.cells][:, :, 2].mean(axis=1) < thickness
        sides = {name: on_plane(whole, bodies.at(whole, *planes[name]), below) for name in ("x+", "y+")}
        return Mesh(whole.nodes, whole.cells, "hex", 3, regions, faces | sides)

    return mesh


def on_plane(mesh: Mesh, nodes: np.ndarray, cells: np.ndarray | None = None) -> np.ndarray:
    """Faces of the elements all of whose nodes are in a mask."""
    chosen = mesh.cells if cells is None else mesh.cells[cells]
    return np.concatenate([chosen[nodes[chosen[:, face]].all(axis=1)][:, face] for face in mesh.element.facets[0]])


def test_the_bands_of_a_hexagon_do_not() -> None:
    """The same three blocks about a square foot have the mirror to rounding."""
    corner, half, pitch = S / sqrt(3.0), S / 2.0, 2.5e-3
    hexagon = lattice_of(
        replace(HEXAGON, height_m=3e-3), pitch, quarter_cell((corner, 0.0), (corner / 2.0, half), pitch)
    )
    square = lattice_of(replace(HEXAGON, height_m=3e-3), pitch, quarter_cell((half, 0.0), (half, half), pitch))
    assert Mirrors(hexagon.cell).names == ("x", "y") and Mirrors(square.cell).names == ("x", "y", "d")
    assert exchanged(square) < 1e-8 and exchanged(hexagon) > 1e-3


OTHERS = {
    "round": (),
    "hexagonal": (),
    "tapered": ("pillar.base_mm=2.2", "pillar.tip_mm=1.3"),
}


@pytest.mark.slow
@pytest.mark.parametrize("shape", OTHERS)
def test_bands_by_curved_hexahedra_are_those_by_tetrahedra(shape: str) -> None:
    """Steel pillars on PMMA, unlike pitches: two meshes that share nothing but the bars that each tells of itself."""
    own = ("pillar.shape=round", "pillar.diameter_mm=1.8") if shape == "round" else (f"pillar.shape={shape}",)
    scene = ("material=pmma", "pillar.material=steel", *own, *OTHERS[shape], "pillar.height_mm=4", "plate.thickness_mm=1.3",
             "array.pitch_x_mm=3.1", "array.pitch_y_mm=3.6", "bands.points=1", "bands.count=8")  # fmt: skip
    (hexes, bar), (tets, other) = (
        bands_and_bars(*scene, f"solve.mesh={mesh}", f"solve.accuracy={accuracy}")
        for mesh, accuracy in (("hex", 0.003), ("tet", 0.01))
    )
    moving = hexes > 1e-3 * hexes.max()
    difference = np.abs(tets[moving] / hexes[moving] - 1.0)
    assert (difference <= (bar + other)[moving]).all()
    assert np.median(bar[moving]) < np.median(other[moving]), "hexahedra are the finer mesh"


def bands_and_bars(*overrides: str) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and half-widths of their bars, (wavevectors, bands), as `antinode bands` gives them."""
    case = load_case(CASE, overrides)
    result = solve_bands(case, WarningLog(), every_gap=False)
    return result.frequencies_hz, np.array(result.error, dtype=float)
