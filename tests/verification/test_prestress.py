"""Thermal stress: a clamped strip is the exact beam under axial force, plates are the whole solid with its own stress."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import pi
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import brentq

from geometry.elements import BoolArray, FloatArray
from geometry.hex.boxes import boxes_of, hex_mesh
from geometry.hex.panels import disc_mesh
from geometry.hex.scenes import HexSettings, plate_scene
from geometry.layout import region_materials
from geometry.materials import Layer, Material, Stack
from geometry.mesh import AnyMesh, jacobians
from geometry.supports import Support
from geometry.tiling import Panel
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models.modes import PartModes, solve_modes
from pipeline.planning.model_choice import Request, of_case
from pipeline.questions.drift import Drift
from pipeline.questions.modes import Modes
from pipeline.questions.question import Run, ask
from solvers.fem.assembly import Forms, assemble
from solvers.fem.eigen import modes_in_band, modes_near
from solvers.fem.factor import Factoriser
from solvers.fem.prestress import _expansion, _with_stress
from solvers.fem.solid import constrain, free_mask
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from tests.verification.test_supports import bare_design

EXPANSION = 2e-5
CLAMPS = [Support("clamp", "x-"), Support("clamp", "x+")]
METAL = replace(Material.isotropic("metal", 70e9, 2700.0, 0.34), expansion_per_k=EXPANSION, softening_per_k=0.0)
CORK = replace(Material.isotropic("no sideways strain", 70e9, 2700.0, 0.0), expansion_per_k=EXPANSION)
LENGTH, WIDTH, THICK = 100e-3, 4e-3, 1e-3
EULER = pi**2 / 3.0 * (THICK / LENGTH) ** 2  # strain of a clamped beam at its buckling load
PILLARS: dict[str, Any] = {
    "material": {"young_GPa": 70.0, "poisson": 0.34, "density_kg_m3": 2700.0, "expansion_per_K": EXPANSION, "dE_dT_per_K": 0.0},
    "plate": {"thickness_mm": 1.0}, "zone": {"length_mm": 22.0, "width_mm": 10.0, "nodal_lines": 2},
    "pillar": {"shape": "square", "side_mm": 2.0, "height_mm": 3.0},
    "array": {"pitch_mm": 6.0, "rows": 1, "extension_mm": 3.0}, "solve": {"accuracy": 0.01},
    "support": [{"kind": "clamp", "edge": "x-"}, {"kind": "clamp", "edge": "x+"}],
}  # fmt: skip


def plate(
    warmer: float,
    supports: list[Support],
    size_m: tuple[float, float, float],
    layers: tuple[Layer, ...],
    stressed: bool = True,
) -> PlateModel:
    """A bare plate, its layers at a temperature."""
    warm = tuple(Layer(each.material.at(20.0 + warmer), each.thickness_m) for each in layers)
    design = replace(bare_design(supports, size_m, warm[-1].material), layers=warm)
    stack = design.stack
    reduction = ReductionSettings(Interface(4, 2, stack.joints), 1e6, HexSettings(3, 2.5e-3, 0), 6e-3, None, 1)
    return PlateModel(design, Reductions(stack, None, reduction, stressed=stressed))


def beam_root(share: float) -> float:
    """The square of the lowest (beta L)^2 of a clamped beam that carries a share of Euler's load 4 pi^2 E I / L^2.

    E I w'''' + N w'' = rho A w2 w: 2 a b (cosh a cos b - 1) = (a^2 - b^2) sinh a sin b.
    """
    p = 4.0 * pi**2 * share

    def rest(root: float) -> float:
        middle = np.sqrt(p**2 / 4.0 + root)
        a, b = np.sqrt(middle - p / 2.0), np.sqrt(middle + p / 2.0)
        return float(2.0 * a * b * (np.cosh(a) * np.cos(b) - 1.0) + (b**2 - a**2) * np.sinh(a) * np.sin(b))

    return float(brentq(rest, 1e-3, 1.3 * 4.73**4 * (1.0 - share)))


def test_the_beam_without_force_is_the_textbook_one() -> None:
    assert beam_root(0.0) == pytest.approx(4.730040745**4, rel=1e-8)
    assert beam_root(0.999) < 0.002 * beam_root(0.0)


@pytest.mark.slow
@pytest.mark.parametrize("share", [-1.0, 0.3, 0.6, 0.9])
def test_a_clamped_strip_is_a_beam_under_axial_force(share: float) -> None:
    """Without sideways strain the stress is E a T. Shear takes 6/5 E/G times the strain from the buckling load."""
    warmer = share * EULER / EXPANSION
    cold, warm = (plate(each, CLAMPS, (LENGTH, WIDTH, THICK), (Layer(CORK, THICK),)) for each in (0.0, warmer))
    rest, factor = warm.prestress()
    assert rest.mean_pa[0] == pytest.approx(-70e9 * share * EULER, rel=1.01 * abs(share) * EULER)  # E grows as edges do
    missed = (1.2 * 2.0 + 1.0) * EULER  # of Euler's load, by shear and by E
    if share > 0.0:
        assert factor == pytest.approx(1.0 / share, rel=2.0 * missed)
    tones = [modes_near(model.pencil("SS"), 0.0, 1).frequency_hz[0] for model in (cold, warm)]
    exact = np.sqrt(beam_root(share) / beam_root(0.0))
    assert tones[1] / tones[0] == pytest.approx(exact, rel=missed / (1.0 - max(share, 0.0)))


@pytest.mark.slow
def test_a_clamped_sandwich_is_a_beam_under_the_force_of_its_layers() -> None:
    stiff = replace(Material.isotropic("stiff", 200e9, 4000.0, 0.0), expansion_per_k=0.5 * EXPANSION)
    layers = tuple(Layer(each, THICK / 4.0 * share) for each, share in ((stiff, 1.0), (CORK, 2.0), (stiff, 1.0)))
    stack = Stack(layers)
    force = sum(
        each.material.as_isotropic.young_pa * (each.material.expansion_per_k or 0.0) * each.thickness_m
        for each in layers
    )
    euler = 4.0 * pi**2 * stack.bending_n_m[0, 0] / LENGTH**2
    missed = euler / stack.shear_n_m[0] + 2.0 * EULER
    rest, factor = plate(0.5 * euler / force, CLAMPS, (LENGTH, WIDTH, THICK), layers).prestress()
    assert rest.mean_pa[0] == pytest.approx(-0.5 * euler / THICK, rel=2.0 * EULER)
    assert factor == pytest.approx(2.0, rel=2.0 * missed)


@pytest.mark.slow
def test_one_material_that_is_free_has_no_stress() -> None:
    model = plate(50.0, [], (24e-3, 18e-3, 2e-3), (Layer(METAL, 2e-3),))
    cold = plate(0.0, [], (24e-3, 18e-3, 2e-3), (Layer(METAL, 2e-3),))
    rest, factor = model.prestress()
    assert np.abs(rest.fields).max() < 1e-9 * 50.0 * EXPANSION
    assert factor > 100.0  # rounding next to rigid motion
    for symmetry in ("SS", "AA"):
        tones = [modes_near(each.pencil(symmetry), 0.0, 3).frequency_hz[:3] for each in (cold, model)]
        assert tones[1] / tones[0] == pytest.approx(np.sqrt(1.0 + 50.0 * EXPANSION), rel=1e-9)


@pytest.mark.slow
def test_symmetry_classes_carry_the_stress_of_the_whole_plate() -> None:
    """A spring far too soft to matter takes the mirrors away."""
    known = []
    for more in ([], [Support("spring", "y+", stiffness_n_m=1e-6)]):
        model = plate(30.0, [*CLAMPS, *more], (24e-3, 12e-3, 1e-3), (Layer(METAL, 1e-3),))
        rest, factor = model.prestress()
        tones = [modes_in_band(model.pencil(each), 1e3, 6e4).frequency_hz for each in model.symmetries]
        known.append((np.sort(np.concatenate(tones)), rest.mean_pa, factor))
    assert len(known[0][0]) == len(known[1][0]) > 4
    assert known[1][0] == pytest.approx(known[0][0], rel=1e-8)
    assert known[1][1] == pytest.approx(known[0][1], rel=1e-8)
    assert known[1][2] == pytest.approx(known[0][2], rel=1e-3)


# -- whole solids ------------------------------------------------------------------------------------------------------


def mean_stress_pa(mesh: AnyMesh, materials: dict[str, Material], motion: FloatArray) -> FloatArray:
    """Mean stress of each element moved by (n, 3), m, (elements, 3, 3)."""
    (block,) = mesh.blocks
    rule = block.element.quadrature
    _, gradient = block.element.shape(rule.points)
    jacobian = jacobians(block, np.arange(len(block.cells)), rule.points)
    weight = np.linalg.det(jacobian) * rule.weights
    slope = np.linalg.solve(
        jacobian, np.broadcast_to(gradient.transpose(0, 2, 1), (*jacobian.shape[:3], gradient.shape[1]))
    )
    strain = np.einsum("eqka,eai,eq->eik", slope, motion[block.cells], weight) / weight.sum(axis=1)[:, None, None]
    stress = np.zeros_like(strain)
    for name, cells in mesh.region_of_cells().items():
        free = _expansion(materials[name]) * np.eye(3)
        stress[cells] = np.einsum("ijkl,ekl->eij", materials[name].tensor_pa, strain[cells] - free)
    return stress


def with_own_stress(
    mesh: AnyMesh, materials: dict[str, Material], hold: Callable[[str], BoolArray], count: int, stressed: bool = True
) -> dict[str, FloatArray]:
    """Modes of a quarter, even along y, with the stress of its own motion at rest; hold: free degrees of freedom of a class."""
    system = assemble(mesh, materials)
    scale, forms = system.scale, Forms(mesh, system.scale.length_m)
    warm, tensor = np.zeros(mesh.cell_count), np.zeros((mesh.cell_count, 3, 3, 3, 3))
    for name, cells in mesh.region_of_cells().items():
        warm[cells], tensor[cells] = _expansion(materials[name]), materials[name].tensor_pa / scale.young_pa
    load = forms.stiffness(warm[:, None, None, None, None] * tensor) @ (mesh.nodes / scale.length_m).ravel()
    keep, mass = np.flatnonzero(hold("SS").ravel()), sp.kron(system.mass, sp.eye_array(3), format="csr")
    rest = sp.csr_array(system.stiffness + 1e-9 * mass)[keep][:, keep]  # a free plate may rise as a whole
    motion = np.zeros(load.size)
    motion[keep] = Factoriser()(sp.csc_array(rest)).solve(load[keep])
    if stressed:
        stress = mean_stress_pa(mesh, materials, scale.length_m * motion.reshape(-1, 3))
        system = _with_stress(system, stress)
    classes = {name: constrain(system, hold(name)) for name in ("SS", "AS")}
    return {name: modes_near(pencil, 0.0, count).frequency_hz[:count] for name, pencil in classes.items()}


def solid_hz(case: Case, clamped: bool, count: int, layers: int = 2, stressed: bool = True) -> dict[str, FloatArray]:
    """Modes of the quarter of a case's plate, its end clamped or free."""
    scene = plate_scene(case.design, HexSettings(3, 3e-3, layers, 0.25), quarter=True)
    if clamped:
        scene.x[case.design.half_length_m] = True
    mesh, materials = hex_mesh(boxes_of(scene), 3), region_materials(case.design.stack, case.design.pillar)

    def hold(symmetry: str) -> BoolArray:
        return free_mask(mesh, ("x+",) if clamped else (), {"x-": symmetry[0], "y-": symmetry[1]})

    return with_own_stress(mesh, materials, hold, count, stressed)


@pytest.mark.slow
def test_a_plate_between_screws_is_the_whole_solid() -> None:
    """Their washers hold a disc of the back face: the plate bows, which neither side counts."""
    size, at, radius, known, ours = (30e-3, 24e-3, 1e-3), (9e-3, 6.5e-3), 1.5e-3, [], []
    screws = [Support("clamp", at_m=(x * at[0], y * at[1]), radius_m=radius) for x in (1, -1) for y in (1, -1)]
    for warmer in (0.0, 40.0):
        metal = METAL.at(20.0 + warmer)
        mesh = disc_mesh(
            Panel((0.0, 0.0), (15e-3, 12e-3), at), Stack.of(1e-3, metal), radius, HexSettings(3, 2e-3, 2, 0.25)
        )
        place = mesh.nodes[:, :2] - (np.array(at) - np.array([7.5e-3, 6e-3]))
        disc = (np.hypot(*place.T) < radius * (1.0 + 1e-9)) & (mesh.nodes[:, 2] > 1e-3 * (1.0 - 1e-9))

        def hold(symmetry: str, mesh: AnyMesh = mesh, disc: BoolArray = disc) -> BoolArray:
            free = free_mask(mesh, (), {"x-": symmetry[0], "y-": symmetry[1]})
            free[disc] = False
            return free

        known.append(with_own_stress(mesh, {"plate": metal}, hold, 3))
        model = plate(warmer, screws, size, (Layer(METAL, 1e-3),))
        if warmer:
            rest, factor = model.prestress()
            assert factor > 1.0 and rest.mean_pa[0] < 0.0
        ours.append({name: modes_near(model.pencil(name), 0.0, 3).frequency_hz[:3] for name in ("SS", "AS")})
    for symmetry in ("SS", "AS"):
        pencil = model.pencil(symmetry)
        modes = modes_near(pencil, 0.0, 3)
        missed = model.assembled(symmetry).missed_of_stress(modes.vectors, pencil.scale.eigenvalue(modes.frequency_hz))[
            :3
        ]
        shift, exact = (each[1][symmetry] / each[0][symmetry] - 1.0 for each in (ours, known))
        assert (missed < 5e-3).all() and (np.abs(shift - exact) <= missed + 0.003 * np.abs(exact)).all()


@pytest.mark.slow
def test_a_held_plate_with_pillars_is_the_whole_solid() -> None:
    """A layer of elements more at feet and clamps changes the solid's own shift by 0.1 to 0.3 %."""
    case = case_from_dict(PILLARS)
    warm = case.but({"solve.temperature_C": 60.0})
    known = [solid_hz(each, True, 3, layers=1) for each in (case, warm)]
    for symmetry in ("SS", "AS"):
        query = Request("plate", band_hz=(1e3, 1.03 * known[0][symmetry][-1]), symmetry=symmetry, search=False)
        ours = [solve_modes(each, query, TerminalLog(True)).rows for each in (case, warm)]
        assert all(len(rows) >= 3 for rows in ours)
        for place, (cold, hot) in enumerate(zip(*ours, strict=True)):
            assert cold.error is not None and hot.error is not None and 0.0 < hot.error - cold.error < 5e-3
            shift, exact = (
                pair[1] / pair[0] - 1.0
                for pair in ((cold.frequency_hz, hot.frequency_hz), [each[symmetry][place] for each in known])
            )
            assert exact < -5e-3
            assert shift == pytest.approx(exact, rel=3e-3, abs=hot.error - cold.error)


@pytest.mark.slow
def test_a_free_bimetal_plate_is_the_whole_solid_with_relaxed_stress() -> None:
    """The laminate's stress holds but for a thickness from the free edges: a fifth of the plate, which moves twice as much."""
    stiff = PILLARS["material"] | {"young_GPa": 200.0, "expansion_per_K": 1e-5}
    tables = {key: each for key, each in PILLARS.items() if key not in ("pillar", "support")} | {
        "plate": {"layer": [{"material": each, "thickness_mm": 0.5} for each in (stiff, PILLARS["material"])]},
        "array": {"rows": 0, "extension_mm": 3.0},
    }
    warm = case_from_dict(tables).but({"solve.temperature_C": 220.0})
    none, exact = (solid_hz(warm, False, 4, layers=1, stressed=each) for each in (False, True))
    length, width = warm.design.plate_m
    layers = tuple(Layer(replace(each.material, temperature_c=20.0), each.thickness_m) for each in warm.design.layers)
    ours = [plate(200.0, [], (length, width, 1e-3), layers, stressed) for stressed in (True, False)]
    near = 2.0 * 1e-3 * (length + width) / (length * width)
    for symmetry in ("SS", "AS"):
        free, bound = (modes_near(model.pencil(symmetry), 0.0, 4).frequency_hz[:4] for model in ours)
        shift = exact[symmetry] / none[symmetry] - 1.0
        assert (shift < -4e-5).all()
        assert bound / free - 1.0 == pytest.approx(shift, rel=2.0 * near)


# -- commands ----------------------------------------------------------------------------------------------------------


def strip_case(**changes: Any) -> Case:
    """A bare strip between two clamps, which buckles 23 K above 20 C."""
    tables = {
        "material": PILLARS["material"], "plate": {"thickness_mm": 1.0}, "array": {"rows": 0, "extension_mm": 2.0},
        "zone": {"length_mm": 80.0, "width_mm": 4.0, "nodal_lines": 6}, "support": PILLARS["support"],
        "solve": {"accuracy": 0.1, "temperature_C": 30.0},
    }  # fmt: skip
    return case_from_dict(tables | changes)


@pytest.mark.slow
def test_a_plate_beyond_buckling_is_refused_in_one_line() -> None:
    said = []
    with pytest.raises(InputError) as fault:
        said = solve_modes(
            strip_case(solve={"accuracy": 0.1, "temperature_C": 60.0}),
            Request("plate", near_hz=0.0, count=2),
            TerminalLog(True),
        )
    assert not said and len(fault.value.lines) == 1
    (line,) = fault.value.lines
    limit = float(line.partition("must be below ")[2].partition(",")[0].removesuffix(" C"))
    assert "solve.temperature_C = 60: must be below " in line and line.endswith("at which the held plate buckles")
    assert limit == pytest.approx(20.0 + pi**2 / 3.0 * (1.0 / 80.0) ** 2 / EXPANSION, rel=0.03)  # wider than a beam


def test_layers_whose_expansion_is_not_known_are_refused_in_one_line() -> None:
    material = {key: each for key, each in PILLARS["material"].items() if key != "expansion_per_K"}
    case = strip_case(material=material)
    with pytest.raises(InputError) as fault:
        Modes().suited(case)
    (line,) = fault.value.lines
    assert "expansion_per_K of given: must be given: modes needs it" in line
    Modes().suited(strip_case(material=material | {"expansion_per_K": 0.0}))


@pytest.mark.slow
def test_a_held_plate_drifts_by_its_stress(coarsest_here: None) -> None:
    """Its material alone would let it grow stiffer by 2e-5 a kelvin, as edges grow: clamped sides take ten times as much."""
    sides = [{"kind": "clamp", "edge": edge} for edge in ("y-", "y+")]
    zone = {"length_mm": 60.0, "width_mm": 4.0, "nodal_lines": 4}
    array = {"rows": 0, "extension_mm": 0.5}
    case = strip_case(zone=zone, array=array, support=sides, solve={"accuracy": 0.1, "temperature_C": 25.0})
    found = ask(case, Drift(around_K=3.0, points=3), Run(TerminalLog(True)))
    free = ask(replace(case, design=case.design.unsupported), Drift(around_K=3.0, points=3), Run(TerminalLog(True)))
    tones = [row.frequency_hz if (row := at(case, each).target_row) else 0.0 for each in (22.0, 28.0)]
    assert found.drift_hz_per_K == pytest.approx((tones[1] - tones[0]) / 6.0, rel=1e-3)
    assert found.drift_hz_per_K is not None and free.drift_hz_per_K is not None
    assert free.drift_hz_per_K == pytest.approx(1e-5 * free.points[1].frequency_hz, rel=1e-3)
    assert found.drift_hz_per_K < -10.0 * free.drift_hz_per_K


def at(case: Case, celsius: float) -> PartModes:
    warm = case.but({"solve.temperature_C": celsius})
    return solve_modes(warm, of_case(warm), TerminalLog(True))
