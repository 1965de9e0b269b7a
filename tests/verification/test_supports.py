"""Supported plates against exact solutions, beams, rigid bodies and a whole solid with tied nodes."""

from __future__ import annotations

import re
from itertools import product
from math import cos, cosh, pi, sin, sinh, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import legendre
from scipy.linalg import eigh
from scipy.optimize import brentq
from scipy.special import j1

from geometry.elements import FloatArray
from geometry.hex.boxes import Boxes, hex_mesh
from geometry.hex.scenes import HexSettings
from geometry.layout import Design
from geometry.materials import MATERIALS, Material
from geometry.supports import Support
from geometry.tiling import tile
from pipeline.case.model import Case, case_from_dict
from pipeline.cli.main import main
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models.modes import solve_modes
from pipeline.paths import ROOT
from pipeline.planning.model_choice import Request
from pipeline.questions.modes import Modes
from pipeline.questions.question import ask
from solvers.accuracy.reduction import mode_errors
from solvers.fem.assembly import Scale, assemble
from solvers.fem.eigen import modes_in_band
from solvers.fem.solid import SolidModel, constrain, free_mask
from solvers.plates import held as discs
from solvers.plates.assembled import PlateModel, Reductions
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.superelement.supports import rigid_count

EDGES = ("x-", "x+", "y-", "y+")
LENGTH, WIDTH, THICK = 24e-3, 18e-3, 2e-3
ALUMINIUM = MATERIALS["aluminium"]
THIN = (60e-3, 40e-3, 0.3e-3)  # thickness / length 0.005
MARGIN = 2.0  # of the truncation estimate, as in modes.py


def bare_design(
    supports: list[Support], size_m: tuple[float, float, float] = (LENGTH, WIDTH, THICK), material: Material = ALUMINIUM
) -> Design:
    """A plate without pillars, its zone half as wide."""
    (length, width, thick), nan = size_m, float("nan")
    return Design(length, width / 2.0, thick, 2, material, None, nan, nan, 0, width / 4.0, supports=tuple(supports))


def plate(
    supports: list[Support],
    size_m: tuple[float, float, float] = (LENGTH, WIDTH, THICK),
    material: Material = ALUMINIUM,
    along: int = 4,
) -> PlateModel:
    """A bare plate from reduced cells."""
    design, (_, width, thick) = bare_design(supports, size_m, material), size_m
    reduction = ReductionSettings(
        Interface(along, 2, ()), 2e6, HexSettings(3, min(thick, 1.5e-3) if width > 5e-3 else 2.5e-3, 0), 6e-3, None, 1
    )
    return PlateModel(design, Reductions(design.stack, None, reduction))


def solved(model: PlateModel, low_hz: float, high_hz: float) -> tuple[FloatArray, FloatArray, int]:
    """All modes of every class in a band, ascending, with the half-widths of their bars; the rigid-body modes."""
    tones, bars, rigid = [], [], 0
    for symmetry in model.symmetries:
        pencil = model.pencil(symmetry)
        modes = modes_in_band(pencil, low_hz, high_hz)
        errors = mode_errors(model.assembled(symmetry), pencil, modes.vectors)
        tones += modes.frequency_hz.tolist()
        bars += (MARGIN * errors.total + errors.mesh).tolist()
        rigid += pencil.rigid_count
    order = np.argsort(tones)
    return np.array(tones)[order], np.array(bars)[order], rigid


def srinivas_hz(m: int, n: int, degree: int = 14) -> FloatArray:
    """Modes of the simply supported plate (srinivas1970): u = U(z) cos(m pi x/a) sin(n pi y/b) and so on, three-dimensional
    elasticity through the thickness by Legendre polynomials of a degree that leaves rounding alone.
    """
    x, w = legendre.leggauss(degree + 4)
    own, weight, count = legendre.legvander(x, degree), w[:, None] * THICK / 2.0, degree + 1
    slope = np.stack([legendre.legval(x, legendre.legder(each)) for each in np.eye(count)], 1) * 2.0 / THICK
    young, nu = ALUMINIUM.average.young_pa, ALUMINIUM.average.poisson
    shear, lame = young / 2.0 / (1.0 + nu), young * nu / (1.0 + nu) / (1.0 - 2.0 * nu)
    a, b, none = m * pi / LENGTH, n * pi / WIDTH, np.zeros_like(own)
    normal = [np.hstack(each) for each in ((-a * own, none, none), (none, -b * own, none), (none, none, slope))]
    sheared = [np.hstack(each) for each in ((b * own, a * own, none), (slope, none, a * own), (none, slope, b * own))]
    stiffness = sum(shear * each.T @ (weight * each) for each in sheared)
    for i, one in enumerate(normal):
        for j, other in enumerate(normal):
            stiffness = stiffness + (lame + 2.0 * shear * (i == j)) * one.T @ (weight * other)
    mass = ALUMINIUM.density_kg_m3 * np.kron(np.eye(3), own.T @ (weight * own))
    moves = np.repeat([n > 0, m > 0, m > 0 and n > 0], count)
    values = eigh(stiffness[np.ix_(moves, moves)], mass[np.ix_(moves, moves)], eigvals_only=True)
    return np.sqrt(np.maximum(values, 0.0)) / 2.0 / pi


@pytest.mark.slow
def test_every_mode_of_a_simply_supported_plate_is_srinivas() -> None:
    top_hz = 9e4
    exact = np.sort([tone for m in range(9) for n in range(9) if m + n for tone in srinivas_hz(m, n) if tone < top_hz])
    tones, bars, rigid = solved(plate([Support("simple", edge) for edge in EDGES]), 1e2, top_hz)
    assert rigid == 0 and len(tones) == len(exact) > 5
    assert (np.abs(tones / exact - 1.0) <= bars).all() and bars.max() < 0.01


@pytest.mark.slow
def test_supports_that_do_nothing_change_nothing() -> None:
    free, _, six = solved(plate([]), 1e2, 4e4)
    idle, _, rigid = solved(
        plate([Support("foam", "y-"), Support("spring", at_m=(3e-3, 2e-3), radius_m=1e-3)]), 1e2, 4e4
    )
    assert six == rigid == 6 and idle == pytest.approx(free, rel=1e-9)


@pytest.mark.slow
def test_a_foam_of_rising_stiffness_holds_the_edge() -> None:
    """From below, with an error that falls as 1/k, to the modes of a whole solid with u_z of the edge faces held."""
    band = (1e3, 5e4)
    *softer, (tones, bars, rigid) = (
        solved(plate([Support("foam", edge, bedding_n_m2=bedding) for edge in EDGES]), *band)
        for bedding in (1e12, 1e13, 1e14, 1e16)
    )
    left = [tones - other for other, _, _ in softer]
    assert all(left[i] / left[i + 1] == pytest.approx(np.full(2, 10.0), rel=0.05) for i in range(2))
    exact = edges_held_hz(*band)
    assert rigid == 3 and len(exact) == 2 and bars.max() < 5e-3
    assert (np.abs(tones / exact - 1.0) <= bars).all()
    assert tones[0] < solved(plate([Support("simple", edge) for edge in EDGES]), 1e3, 3e4)[0][0]


def edges_held_hz(low_hz: float, high_hz: float) -> FloatArray:
    """Modes of the solid with u_z of its edge faces held; an order less changes them by 7e-4."""
    x = np.append(np.linspace(0.0, LENGTH / 2.0, 7)[:-1], [0.48 * LENGTH, 0.5 * LENGTH])
    y = np.append(np.linspace(0.0, WIDTH / 2.0, 5)[:-1], [0.475 * WIDTH, 0.5 * WIDTH])
    z = THICK * np.array([0.0, 0.25, 0.75, 1.0])
    boxes = Boxes(x, y, z, np.zeros((len(x) - 1, len(y) - 1, len(z) - 1), dtype=np.int64), ("plate",))
    mesh, found = hex_mesh(boxes, 3), []
    system = assemble(mesh, {"plate": ALUMINIUM}, Scale.of(THICK, ALUMINIUM))
    for along, across in product("SA", repeat=2):
        free = free_mask(mesh, (), {"x-": along, "y-": across})
        free[np.concatenate([mesh.nodes_of("x+"), mesh.nodes_of("y+")]), 2] = False
        found += modes_in_band(constrain(system, free), low_hz, high_hz).frequency_hz.tolist()
    return np.sort(found)


@pytest.mark.slow
def test_an_edge_of_rising_mass_is_clamped() -> None:
    """From above, with an error that falls as 1/m; the edge's own modes go as m^(-1/2), to below the band."""
    band, weight = (1.5e4, 4e4), ALUMINIUM.density_kg_m3 * LENGTH * WIDTH * THICK
    clamped, bars, _ = solved(plate([Support("clamp", "x-")]), *band)
    tones = [solved(plate([Support("mass", "x-", mass_kg=times * weight)]), *band)[0] for times in (1e4, 1e5, 1e8)]
    assert all(len(each) == len(clamped) == 4 for each in tones)
    assert (tones[0] - tones[2]) / (tones[1] - tones[2]) == pytest.approx(np.full(4, 10.0), rel=0.1)
    assert (np.abs(tones[2] / clamped - 1.0) <= bars).all() and bars.max() < 6e-3


@pytest.mark.parametrize(
    ("supports", "rigid"),
    [
        ([Support("clamp", "x-")], 0),
        ([Support("simple", "x-")], 3),  # along x, about the edge and about z at the edge
        ([Support("foam", "y-", bedding_n_m2=1.0)], 4),
        ([Support("foam", "y-", bedding_n_m2=1.0), Support("foam", "y+", bedding_n_m2=1.0)], 3),
        ([Support("spring", at_m=(5e-3, 0.0), radius_m=1e-3, stiffness_n_m=1.0)], 3),  # a disc resists tilting, too
        ([Support("mass", "y-", mass_kg=1.0)], 6),
    ],
)
def test_rigid_motions_that_are_left(supports: list[Support], rigid: int) -> None:
    assert rigid_count(tile(bare_design(supports), 6e-3), THICK) == rigid


@pytest.mark.slow
def test_a_plate_on_a_soft_spring_bounces_as_a_rigid_body() -> None:
    """w2 = k / (M + m), lower by the plate's own softness: k over that of its first bending, 1e-4 here."""
    plain = LENGTH * WIDTH * THICK * ALUMINIUM.density_kg_m3
    spring = Support("spring", radius_m=2e-3, stiffness_n_m=100.0)
    heavy = Support("mass", radius_m=1e-3, mass_kg=3e-3)
    for more, mass in (([], 0.0), ([heavy], 3e-3)):
        model = plate([spring, *more])
        tones = modes_in_band(model.pencil("SS"), 10.0, 1e3).frequency_hz
        assert tones == pytest.approx([sqrt(100.0 / (plain + mass)) / 2.0 / pi], rel=2e-4)


def strip(supports: list[Support]) -> tuple[FloatArray, float, float]:
    """Bending modes of a strip, thickness / length 0.005, without Poisson's ratio; its bending stiffness and mass per metre."""
    size, material = (60e-3, 1.2e-3, 0.3e-3), replace_poisson(ALUMINIUM)
    model = plate(supports, size, material)
    bending = material.average.young_pa * size[1] * size[2] ** 3 / 12.0
    tones = [
        tone
        for s in model.symmetries
        if s in (None, "SS", "AS")
        for tone in modes_in_band(model.pencil(s), 20.0, 3e3).frequency_hz
    ]
    return np.sort(tones), bending, material.density_kg_m3 * size[1] * size[2]


def replace_poisson(material: Material) -> Material:
    """The material with Poisson's ratio 0, of which a strip is an Euler beam."""
    own = material.average.young_pa / 1e9
    return Material.of_table("no poisson", {"young_GPa": own, "poisson": 0.0, "density_kg_m3": material.density_kg_m3})


def test_a_strip_on_foam_is_a_beam_on_an_elastic_foundation() -> None:
    """w2 = w2(free) + k / m; theory errs by rotary inertia and shear, (pi n t / L)^2 / 3 < 1e-3 of the third mode, and the
    foam at the edges bends a strip of W / t = 4 across by k W^4 / D < 1e-6.
    """
    bedding = 5e3
    foam = [Support("foam", edge, bedding_n_m2=bedding) for edge in ("y-", "y+")]
    (tones, bending, mass), roots = strip(foam), np.array([0.0, 0.0, 4.730041, 7.853205])
    expected = np.sqrt((roots / 60e-3) ** 4 * bending / mass + 2.0 * bedding / mass) / 2.0 / pi
    assert tones[:4] == pytest.approx(expected, rel=2e-3)


@pytest.mark.slow
def test_a_clamped_strip_with_a_mass_at_its_end_is_a_cantilever_with_a_tip() -> None:
    """cosh cos + 1 + r b (cos sinh - sin cosh) = 0; theory errs by (pi n t / L)^2 / 3, 3e-4 of the second mode."""
    ratio = 0.5
    _, bending, mass = strip([])
    tones, _, _ = strip([Support("clamp", "x-"), Support("mass", "x+", mass_kg=ratio * mass * 60e-3)])

    def tip(b: float) -> float:
        return 1.0 + cosh(b) * cos(b) + ratio * b * (cos(b) * sinh(b) - sin(b) * cosh(b))

    roots = np.array([brentq(tip, 1.0, 1.8), brentq(tip, 3.5, 4.69)])
    expected = (roots / 60e-3) ** 2 * sqrt(bending / mass) / 2.0 / pi
    in_band = expected[expected > 20.0]
    assert tones[0] == pytest.approx(in_band[0], rel=2e-3)


def navier_hz(mass_kg: float, disc: Support, sheared: bool = False, spread: bool = False) -> FloatArray:
    """Lowest three modes of a simply supported thin plate with a mass, roots of 1 = m w2 sum phi2 / (M (w_mn2 - w2)).

    sheared: every w_mn2 falls by 1 + (k h)2 / 12 (1 + 2 / (5/6 (1 - nu))), Mindlin's rotary inertia and shear to first order.
    spread: the mass moves as the mean over its disc, of a wave 2 J1(k r) / (k r). Waves beyond 100 x 100 bring less than 3e-5.
    """
    (length, width, thick), own, n = THIN, ALUMINIUM.average, np.arange(1, 101)
    x, y = ((0.5 + at / edge) * pi for at, edge in zip(disc.at_m, (length, width), strict=True))
    k, wave = pi * np.hypot(n[:, None] / length, n / width), np.outer(np.sin(n * x), np.sin(n * y))
    square = own.young_pa * thick**2 / 12.0 / (1.0 - own.poisson**2) / ALUMINIUM.density_kg_m3 * k**4
    if sheared:
        square = square / (1.0 + (k * thick) ** 2 / 12.0 * (1.0 + 2.4 / (1.0 - own.poisson)))
    if spread:
        wave = wave * 2.0 * j1(k * disc.radius_m) / (k * disc.radius_m)
    share = 4.0 * mass_kg / (ALUMINIUM.density_kg_m3 * length * width * thick) * wave**2
    bare = np.sqrt(np.sort(square, axis=None)[:3])
    ends = zip([1.0, *bare], bare, strict=False)
    roots = [
        brentq(lambda w: 1.0 - w**2 * float((share / (square - w**2)).sum()), low * (1.0 + 1e-9), high * (1.0 - 1e-9))
        for low, high in ends
    ]
    return np.array(roots) / 2.0 / pi


@pytest.mark.slow
def test_a_mass_off_the_middle_of_a_simply_supported_plate_is_navier_s_series() -> None:
    """Within the bar and what theory leaves out: shear, rotary inertia, the disc's radius, and its tilt with the back face.

    A tilting disc r wide at h / 2 has m (r2 + h2) / 4 (grad w)2, at most (m / M) k2 (r2 + h2) of a wave's energy, half of it in
    frequency. Ten per cent more mass is beyond that in both modes that it moves most.
    """
    disc = Support("mass", at_m=(9e-3, 5e-3), radius_m=0.5e-3, mass_kg=0.5e-3)
    design = bare_design([*(Support("simple", edge) for edge in EDGES), disc], THIN)
    reduction = ReductionSettings(Interface(4, 2, ()), 1e5, HexSettings(3, 2e-3, 0), 6e-3, None, 1)
    tones, bars, rigid = solved(PlateModel(design, Reductions(design.stack, None, reduction)), 100.0, 2.1e3)
    exact = navier_hz(disc.mass_kg, disc)
    others = navier_hz(disc.mass_kg, disc, sheared=True), navier_hz(disc.mass_kg, disc, spread=True)
    own, weight = ALUMINIUM.average, ALUMINIUM.density_kg_m3 * THIN[0] * THIN[1] * THIN[2]
    bending = sqrt(own.young_pa / 12.0 / (1.0 - own.poisson**2) / ALUMINIUM.density_kg_m3) * THIN[2]
    tilt = disc.mass_kg / weight / 2.0 * 2.0 * pi * exact / bending * (disc.radius_m**2 + THIN[2] ** 2)
    left = sum(np.abs(other / exact - 1.0) for other in others) + tilt + 3e-5
    assert rigid == 0 and len(tones) == 3 and (bars + left).max() < 0.01
    assert (np.abs(tones / exact - 1.0) <= bars + left).all()
    assert (np.abs(tones / navier_hz(1.1 * disc.mass_kg, disc) - 1.0) > bars + left)[:2].all()


@pytest.mark.slow
def test_a_mass_on_a_small_disc_dips_a_plate_more_than_wide_panels_do() -> None:
    """Waves shorter than the panels' own are missing beneath it; a plate of narrow panels with more modes shows them."""
    disc = Support("mass", at_m=(9e-3, 5e-3), radius_m=0.5e-3, mass_kg=0.5e-3)
    design = bare_design([*(Support("simple", edge) for edge in EDGES), disc], THIN)

    def found(face: Interface, top_hz: float, panel_m: float) -> tuple[FloatArray, FloatArray, int]:
        reduction = ReductionSettings(face, top_hz, HexSettings(3, 2e-3, 0), panel_m, None, 1)
        return solved(PlateModel(design, Reductions(design.stack, None, reduction)), 100.0, 2.1e3)

    (tones, bars, _), (fine, own, _) = (
        found(Interface(along, 2, ()), top_hz, panel_m) for along, top_hz, panel_m in ((5, 1e5, 10e-3), (7, 4e5, 4e-3))
    )
    errors = tones / fine - 1.0
    assert len(errors) == 3 and (errors > 3e-4).all()
    assert (errors <= bars + own).all() and (own < errors).all()


@pytest.mark.slow
def test_a_clamped_plate_lies_within_its_bars_of_the_whole_solid() -> None:
    """Tied nodes on elements graded to the edges, whose own error is below 1e-3: an order and a layer less change 4e-4."""
    query = Request("plate", band_hz=(1e3, 6e4), search=False)
    found = solve_modes(clamped_case(("solve.accuracy", 0.003)), query, TerminalLog(True)).rows
    ours = [(row.symmetry, row.frequency_hz, row.error) for row in found]
    whole = {name: iter(tones) for name, tones in solid_hz(1e3, 6e4).items()}
    assert len(ours) == 6
    for symmetry, tone, error in ours:
        assert error is not None and symmetry is not None
        assert tone == pytest.approx(next(whole[symmetry]), rel=error + 1e-3) and error < 0.004


def clamped_case(*changes: tuple[str, Any]) -> Case:
    """The bare plate clamped at two opposite edges, as a case."""
    raw: dict[str, Any] = {
        "material": "aluminium", "plate": {"thickness_mm": 2.0},
        "zone": {"length_mm": 24.0, "width_mm": 9.0, "nodal_lines": 2}, "array": {"rows": 0, "extension_mm": 4.5},
        "solve": {"accuracy": 0.01}, "support": [{"kind": "clamp", "edge": "x-"}, {"kind": "clamp", "edge": "x+"}],
    }  # fmt: skip
    return case_from_dict(raw, None, list(changes))


def solid_hz(low_hz: float, high_hz: float) -> dict[str, FloatArray]:
    """Modes of the quarter with its nodes at x+ tied, by class."""
    graded = [LENGTH / 2.0 - THICK * 0.5**k for k in range(3)]
    x = np.array([0.0, LENGTH / 8.0, LENGTH / 4.0, LENGTH * 0.34, *graded, LENGTH / 2.0])
    y, z = np.linspace(0.0, WIDTH / 2.0, 4), THICK * np.array([0.0, 0.125, 0.375, 0.625, 0.875, 1.0])
    boxes = Boxes(x, y, z, np.zeros((len(x) - 1, len(y) - 1, len(z) - 1), dtype=np.int64), ("plate",))
    solid = SolidModel(hex_mesh(boxes, 3), {"plate": ALUMINIUM}, ("x+",), True)
    return {name: modes_in_band(solid.pencil(name), low_hz, high_hz).frequency_hz for name in solid.symmetries if name}


@pytest.mark.parametrize(
    ("support", "said"),
    [
        (
            [{"kind": "clamp", "edge": "x-"}, {"kind": "foam", "edge": "x-", "stiffness_N_per_m2": 1.0}],
            "support.1.edge",
        ),
        ([{"kind": "foam", "edge": "x-"}], "must have stiffness_N_per_m2"),
        ([{"kind": "spring", "at_mm": [11.5, 0], "radius_mm": 1.0, "stiffness_N_per_m": 1.0}], "x from -12 to 12"),
        ([{"kind": "spring", "edge": "x-"}], "must have stiffness_N_per_m or damping_Ns_per_m"),
        ([{"kind": "mass", "edge": "x-", "mass_g": 1.0, "stiffness_N_per_m": 1.0}], "support.0.stiffness_N_per_m = 1"),
        ([{"kind": "clamp"}], "either edge, or at_mm with radius_mm"),
        ([{"kind": "clamp", "edge": "x"}], "must be x-, x+, y- or y+"),
        ({"kind": "clamp"}, "tables [[support]]"),
    ],
)
def test_a_support_that_cannot_be_is_one_line(support: Any, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)) as fault:
        clamped_case(("support", support))
    assert len(fault.value.lines) == 1


@pytest.mark.parametrize("words", [["explore"], ["export", "aster"], ["hybrid"], ["travel"]])
def test_commands_that_know_no_supports_refuse_them(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "held.toml"
    support = '[[support]]\nkind = "clamp"\nedge = "y-"\n'
    file.write_text((ROOT / "examples" / "small.toml").read_text() + support)
    assert main([words[0], *words[1:], str(file)]) == 2
    assert "[[support]]: must be left out" in capsys.readouterr().err


@pytest.mark.slow
def test_a_supported_plate_reports_its_target_mode_without_supports() -> None:
    """The same figures as the same plate solved without them: the target mode is found in the same window."""
    case = clamped_case(("solve.accuracy", 0.05), ("support.1.kind", "foam"), ("support.1.stiffness_N_per_m2", 1e6))
    held = ask(case, Modes(), TerminalLog(True))
    free = ask(case.but({"support": []}), Modes(), TerminalLog(True))
    loose, target = held.without_supports, free.found
    assert loose is not None and target is not None and free.without_supports is None
    for name in ("frequency_hz", "confinement_db", "mac", "frequency_error", "confinement_error_db"):
        assert getattr(loose, name) == pytest.approx(getattr(target, name), rel=1e-6)
    assert held.found is None or abs(held.found.frequency_hz / target.frequency_hz - 1.0) > 0.01
    (line,) = [line for line in held.lines() if line.startswith("without the supports: ")]
    assert "confinement by" in line or held.found is None


DISC = {"at_mm": [9.0, 0.0], "radius_mm": 1.0}


@pytest.mark.slow
@pytest.mark.parametrize(
    "support",
    [
        {"kind": "clamp", "edge": "x-"},
        {"kind": "simple", "edge": "y+"},
        {"kind": "foam", "edge": "y-", "stiffness_N_per_m2": 1e6},
        {"kind": "spring", "edge": "x+", "stiffness_N_per_m": 1e4},
        {"kind": "mass", "edge": "y-", "mass_g": 0.1},
        {"kind": "clamp", **DISC},
        {"kind": "simple", **DISC},
        {"kind": "spring", **DISC, "stiffness_N_per_m": 1e4, "damping_Ns_per_m": 0.1},
        {"kind": "mass", **DISC, "mass_g": 0.1},
    ],
    ids=lambda support: f"{support['kind']} {support.get('edge', 'disc')}",
)
def test_every_mount_says_what_it_costs(support: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """One line after the target mode, and the same in JSON; the mount changes what it says."""
    monkeypatch.setattr(discs, "LAYERS", 1)
    case = clamped_case(("solve.accuracy", 0.1), ("support", [support]))
    answer = ask(case, Modes(), TerminalLog(True))
    loose, own = answer.without_supports, answer.found
    (line,) = [line for line in answer.lines() if line.startswith("without the supports: ")]
    assert loose is not None and loose.confinement_db is not None and "dB" in line
    if own is not None and own.confinement_db is not None:
        assert "the supports shift it by" in line and "change its confinement by" in line
        assert own.frequency_hz != loose.frequency_hz and own.confinement_db != loose.confinement_db
