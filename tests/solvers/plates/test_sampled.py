"""Cells reduced over sampled waves: against the whole mesh at other wavevectors, not below it and within the stated error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geometry.elements import FloatArray
from geometry.hex.boxes import Boxes, hex_mesh
from geometry.layout import Design
from geometry.materials import MATERIALS, Material
from geometry.mesh import Mesh, split_hexahedra
from pipeline.case.model import case_from_dict
from solvers.fem.assembly import assemble
from solvers.fem.eigen import lowest_pairs
from solvers.fem.factor import Factoriser
from solvers.plates.own_cell import body_of
from solvers.plates.sampled import sampled_lattice
from solvers.superelement.interface import Interface
from solvers.waves.bloch import BlochCell

PITCH_M, THICK_M, COUNT = 4e-3, 1e-3, 6
ALLOWED = 1e-6
EPS = float(np.finfo(float).eps)
LEAN_MM = 1.0
IN_THE_ZONE = np.array([[0.05, 0.43], [-0.31, 0.22], [0.17, -0.36]])  # of the reciprocal vectors
Drawn = tuple[Mesh, dict[str, Material], Design]


def cell(kind: str, across: int = 6, hole: tuple[int, int, int, int] = (1, 4, 2, 5), lean_mm: float = 0.0) -> Drawn:
    """A cell of 4 x 4 x 1 mm with a hole, an inclusion of steel in PMMA or two layers; of tetrahedra; oblique."""
    lines, layers = np.linspace(0.0, PITCH_M, across + 1), 2 if kind == "layers" else 1
    region, (left, right, low, high) = np.zeros((across, across, layers), dtype=int), hole
    region[left:right, low:high] = 1 if kind == "inclusion" else -1
    region[:, :, 1:] += region[:, :, 1:] == 0
    mesh = hex_mesh(Boxes(lines, lines, np.linspace(0.0, THICK_M, layers + 1), region, ("plate", "other")), 2)
    if kind == "tetrahedra":
        mesh = split_hexahedra(mesh)
    lean = np.array([[1.0, 0.0], [1e-3 * lean_mm / PITCH_M, 1.0]])
    mesh = replace(mesh, nodes=np.column_stack([mesh.nodes[:, :2] @ lean, mesh.nodes[:, 2]]), spans=None)
    array = (
        {"a1_mm": [1e3 * PITCH_M, 0.0], "a2_mm": [lean_mm, 1e3 * PITCH_M]} if lean_mm else {"pitch_mm": 1e3 * PITCH_M}
    )
    case = case_from_dict({"name": "own", "material": "aluminium", "array": array})
    plate = "pmma" if kind == "inclusion" else "aluminium"
    return mesh, {"plate": MATERIALS[plate], "other": MATERIALS["steel"]}, case.design


def rises(drawn: Drawn, face: Interface, zone: FloatArray | None = None) -> tuple[FloatArray, FloatArray, float, int]:
    """Relative excess (places, COUNT) of a reduced cell's frequencies over the whole mesh's, stated error, unknowns saved.

    The second array (places, COUNT) is what rounding may take from them. Places lie on the path, or at those of the zone
    (n, 2), of the reciprocal vectors.
    """
    mesh, materials, design = drawn
    lattice = design.lattice
    body = body_of(mesh, {name: materials[name] for name in mesh.regions}, replace(design, thickness_m=THICK_M))
    labels = "GXMG" if "M" in lattice.high_symmetry else "GXH1CHYG"
    sampled, finer, places = (lattice.path(labels, points).wavevectors for points in (3, 6, 7))
    checked = finer[1::2] if zone is None else np.vstack([finer[1::2], lattice.grid(2, ())])
    system = assemble(body.mesh, body.materials)
    reduced, error = sampled_lattice(system, body.limited(face), sampled[:-1], checked, COUNT, ALLOWED, body.edges_m)
    whole = BlochCell(assemble(mesh, materials), lattice)
    taken = places[3::8] if zone is None else zone @ lattice.reciprocal_per_m
    exact, noise = (np.array(each) for each in zip(*(rounded(whole, k) for k in taken), strict=True))
    found = np.array([reduced.frequencies(k, COUNT) for k in taken])
    return found / exact - 1.0, noise, error, whole.dof // reduced.dof


def rounded(whole: BlochCell, wavevector: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Frequencies of the whole mesh in Hz, and the relative rounding error eps |x|'|K||x| / (2 x'Kx) of two computations."""
    pencil, twice = whole.pencil(wavevector)
    values, x = lowest_pairs(pencil, COUNT, twice, Factoriser())
    size = (np.abs(x) * (abs(pencil.stiffness) @ np.abs(x))).sum(axis=0)
    return whole.scale.frequency(values[::twice]), 2.0 * (EPS * size / (2.0 * values))[::twice]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["hole", "inclusion", "layers", "tetrahedra", "oblique"])
def test_sampled_waves_have_the_bands_of_the_whole_mesh_within_the_stated_error(kind: str) -> None:
    drawn = cell(kind, lean_mm=LEAN_MM if kind == "oblique" else 0.0)
    found, noise, error, fewer = rises(drawn, Interface(12, 2 if kind == "tetrahedra" else 4))
    assert (found > -noise).all() and found.max() < error < ALLOWED and fewer > 3


@pytest.mark.slow
def test_wavevectors_off_the_path_are_as_close_where_the_zone_is_checked() -> None:
    found, _, error, _ = rises(cell("inclusion"), Interface(12, 2), IN_THE_ZONE)
    assert found.max() < min(error, ALLOWED)


@pytest.mark.slow
@pytest.mark.parametrize("rounds", [1, 6])
def test_the_mesh_makes_up_for_boundary_functions_that_are_too_few(
    rounds: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("solvers.plates.sampled.ROUNDS", rounds)
    found, _, error, _ = rises(cell("inclusion"), Interface(5, 2))
    assert found.max() < error < 20.0 * found.max() and (found.max() < ALLOWED) == (rounds > 1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_drawn_cells_keep_their_stated_error(seed: int) -> None:
    draw = np.random.default_rng(seed)
    kind = ("hole", "inclusion", "layers", "tetrahedra")[seed % 4]
    (left, low), (wide, high) = draw.integers(1, 4, 2), draw.integers(2, 5, 2)
    lean_mm = float(draw.choice([0.0, 1.0, 1.5]))
    drawn = cell(kind, 8, (left, left + wide, low, low + high), lean_mm)
    along, through = (10, 2) if kind == "tetrahedra" else (17, 3)  # what their sides' uneven nodes hold
    face, zone = Interface(int(draw.integers(6, along)), through), draw.uniform(-0.5, 0.5, (4, 2))
    found, noise, error, _ = rises(drawn, face, zone if draw.integers(2) else None)
    assert (found > -noise).all() and found.max() < error
