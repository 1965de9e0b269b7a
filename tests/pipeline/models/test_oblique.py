"""Pillared cells of oblique lattices: the whole mesh, another finite-element cell, and lattices turned under round pillars."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from geometry.elements import FloatArray
from geometry.hex.boxes import Boxes, hex_mesh
from geometry.hex.oblique import oblique_mesh
from geometry.hex.scenes import HexSettings
from geometry.layout import Design, region_materials
from geometry.materials import MATERIALS
from geometry.mesh import Mesh, cell_volumes, check_mesh
from geometry.tiling import lattice_panel
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from solvers.fem.assembly import assemble
from solvers.plates.assembled import Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.lattice import ReducedLattice
from solvers.waves.bloch import BlochCell
from tests.helpers.asked import bands_of
from tests.helpers.other_program import other_bands

LOG = TerminalLog(True)
SHAPES: dict[str, dict[str, Any]] = {
    "round": {"diameter_mm": 2.0},
    "square": {"side_mm": 2.0},
    "hexagonal": {"side_mm": 2.0},
    "cross": {"side_mm": 2.5, "arm_mm": 0.8},
    "tapered": {"base_mm": 2.0, "tip_mm": 1.2},
}
OBLIQUE, TURNED = {"a1_mm": [5.0, 0.0], "a2_mm": [1.5, 4.5]}, {"a1_mm": [4.0, 3.0], "a2_mm": [-3.0, 4.0]}
WIDE = {"a1_mm": [4.0, 1.0], "a2_mm": [-1.0, 6.0]}


def case(shape: str = "round", array: dict[str, Any] | None = None, *more: str) -> Case:
    raw = {
        "name": "oblique",
        "material": "aluminium",
        "plate": {"thickness_mm": 1.0},
        "pillar": {"shape": shape, **SHAPES[shape], "height_mm": 3.0},
        "array": {"rows": 1, **(OBLIQUE if array is None else array)},
        "bands": {"points": 1, "count": 6},
        "solve": {"accuracy": 0.02},
    }
    return case_from_dict(raw, None, more)


def mesh_of(design: Design, settings: HexSettings) -> Mesh:
    return oblique_mesh(lattice_panel(design), design.stack, design.pillar, settings).mesh


@pytest.mark.parametrize("array", [OBLIQUE, TURNED, WIDE])
@pytest.mark.parametrize("shape", SHAPES)
def test_elements_follow_every_foot_and_fill_the_cell(shape: str, array: dict[str, Any]) -> None:
    """Positive Jacobians, the volume of plate and pillar, and sides along both vectors."""
    design = case(shape, array).design
    mesh = mesh_of(design, HexSettings(order=3, size_m=2e-3, layers=1))
    check_mesh(mesh)
    assert design.pillar is not None
    exact = design.lattice.area_m2 * design.thickness_m + design.pillar.volume_m3
    assert float(cell_volumes(mesh).sum()) == pytest.approx(exact, rel=1e-4)
    for axis, sides in enumerate((("x-", "x+"), ("y-", "y+"))):
        for side, end in zip(sides, (-0.5, 0.5), strict=True):
            shares = mesh.nodes[mesh.nodes_of(side), :2] @ np.linalg.inv(design.lattice.vectors_m)
            assert shares[:, axis] == pytest.approx(end) and np.ptp(shares[:, 1 - axis]) == pytest.approx(1.0)


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["round", "square"])
def test_the_reduced_cell_has_the_waves_of_its_mesh(shape: str) -> None:
    """Within what boundary functions of degree 5 and modes to 1 MHz leave out of it, and never below, anywhere in the zone."""
    design = case(shape).design
    settings = HexSettings(order=2, size_m=2e-3, layers=0)
    mesh = mesh_of(design, settings)
    whole = BlochCell(assemble(mesh, region_materials(design.stack, design.pillar)), design.lattice)
    reduction = ReductionSettings(Interface(5, 2), 1e6, settings)
    lattice = ReducedLattice(Reductions(design.stack, design.pillar, reduction).cell(lattice_panel(design)))
    for k in (*design.lattice.high_symmetry.values(), np.array([300.0, 150.0]), np.array([-420.0, 210.0])):
        ours, theirs = lattice.frequencies(k, 6), whole.frequencies(k, 6)
        assert (ours >= theirs * (1.0 - 1e-6) - 1.0).all() and ours == pytest.approx(theirs, rel=3e-3, abs=1.0)
    waves, step = lattice.waves(np.array([300.0, 150.0]), 4), 1e-2
    for axis, velocity in enumerate(lattice.group_velocity(waves).T):
        ends = [lattice.frequencies(waves.wavevector + sign * step * np.eye(2)[axis], 4) for sign in (-1.0, 1.0)]
        assert velocity == pytest.approx(np.pi * (ends[1] - ends[0]) / step, rel=1e-3, abs=1.0)


@pytest.mark.parametrize(
    ("shape", "array", "change"),
    [
        ("round", {"a1_mm": [5.0, 0.0], "a2_mm": [2.2, 4.3]}, "pillar.diameter_mm=4.5"),
        ("hexagonal", {"a1_mm": [1.38, 4.81], "a2_mm": [-6.15, 1.89]}, "pillar.side_mm=4.33"),
    ],
)
def test_a_pillar_that_elements_cannot_follow_is_refused_in_one_line(
    shape: str, array: dict[str, Any], change: str
) -> None:
    """Beyond the sides of the cell, or so near to them that elements between turn inside out."""
    wide = case(shape, array, change)
    with pytest.raises(InputError, match=r"array\.a2_mm: a cell along two vectors of the lattice") as fault:
        bands_of(wide, LOG)
    assert len(fault.value.lines) == 1


@pytest.mark.slow
def test_round_pillars_do_not_feel_how_the_lattice_is_turned() -> None:
    """Against the square lattice's own cell, a quarter of which is meshed by other elements: within the sum of the bars."""
    turned, plain = (bands_of(case("round", array), LOG) for array in (TURNED, {"pitch_mm": 5.0}))
    assert turned.labels == plain.labels == ("G", "X", "M", "G")
    for one, two in zip(turned.points, plain.points, strict=True):
        for hz, bar, other, its in zip(one.frequencies_hz, one.error, two.frequencies_hz, two.error, strict=True):
            assert bar is not None and its is not None and bar < 0.02
            assert hz < 1.0 or abs(hz / other - 1.0) <= bar + its


def brick(finer: int) -> Mesh:
    """A 5 x 4.5 mm brick of boxes: its lines, moved by a2, are its own lines."""
    x, y = np.linspace(-2.5, 2.5, 10 * finer + 1), np.linspace(-2.25, 2.25, 9 * finer + 1)
    z = np.linspace(0.0, 4.0, 4 * finer + 1)
    middle = [(each[1:] + each[:-1]) / 2.0 for each in (x, y, z)]
    foot = (np.abs(middle[0]) < 1.0)[:, None, None] & (np.abs(middle[1] + 0.25) < 1.0)[None, :, None]
    region = np.where(middle[2] < 1.0, 0, np.where(foot, 1, -1))
    return hex_mesh(Boxes(1e-3 * x, 1e-3 * y, 1e-3 * z, region, ("plate", "pillar")), 1)


@pytest.mark.slow
def test_a_square_pillar_has_the_bands_of_a_brick_by_another_program() -> None:
    """Another domain, boxes alone, scikit-fem; complete hexahedra overestimate f by at most its fall as elements are halved."""
    design_case = case("square", None, "bands.points=2")
    ours, lattice = bands_of(design_case, LOG), design_case.design.lattice
    for point in (ours.points[1], ours.points[3]):
        k: FloatArray = np.array([point.kx_per_m, point.ky_per_m])
        own = dict.fromkeys(("plate", "pillar"), MATERIALS["aluminium"])
        coarse, fine = (other_bands(brick(finer), lattice, k, 6, own) for finer in (1, 2))
        for hz, bar, above, over in zip(point.frequencies_hz, point.error, fine, coarse - fine, strict=True):
            assert bar is not None and bar < 0.02
            assert above - over - bar * hz <= hz <= above + bar * hz
