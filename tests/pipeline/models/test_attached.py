"""Masses, springs and resonators on a unit cell against the plane-wave expansion of a thin plate that carries them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from geometry.elements import FloatArray
from geometry.hex.boxes import Boxes, hex_mesh
from geometry.lattice import Lattice
from geometry.materials import MATERIALS
from geometry.supports import Support
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models.unit_cell import lattice_model
from pipeline.planning.model_choice import by_vectors, cell_model_choice
from pipeline.questions.attenuation import Attenuation
from pipeline.questions.bands import Bands, BandsResult
from pipeline.questions.broadband import Broadband
from pipeline.questions.question import Run, ask
from solvers.accuracy.reduction import mesh_error
from solvers.errors import SolverError
from solvers.fem.assembly import assemble
from solvers.superelement.attached import with_attached
from studies.plane_waves import LoadedPlate

LOG = TerminalLog(True)
PITCH_M, THICK_M = 20e-3, 0.5e-3
ALLOY, DENSITY = MATERIALS["aluminium"].average, MATERIALS["aluminium"].density_kg_m3
PLATE_KG = DENSITY * THICK_M * PITCH_M**2
TRIANGULAR = {"pitch_mm": 1e3 * PITCH_M, "lattice": "triangular"}
TONE_HZ = 1500.0  # of the resonator on a wall
STIFF_N_M = 0.5 * PLATE_KG * (2.0 * np.pi * TONE_HZ) ** 2


def case(attached: list[dict[str, Any]] | None, **own: Any) -> Case:
    plain: dict[str, Any] = {"name": "own", "material": "aluminium", "plate": {"thickness_mm": 1e3 * THICK_M}}
    plain |= {"array": {"pitch_mm": 1e3 * PITCH_M}, "solve": {"accuracy": 0.03}}
    plain |= {"bands": {"points": 1, "count": 4, "path": "GX"}}
    return case_from_dict(plain | ({"cell": {"attached": attached}} if attached is not None else {}) | own)


def bands(attached: list[dict[str, Any]] | None, **own: Any) -> BandsResult:
    return ask(case(attached, **own), Bands(), Run(LOG))


def expanded(k: FloatArray, mass: float, spring: float, count: int, reach: int = 10) -> FloatArray:
    """Flexural waves of a thin plate, loaded on a disc in the middle of the cell, Hz."""
    stiff = ALLOY.young_pa * THICK_M**3 / 12.0 / (1.0 - ALLOY.poisson**2)
    own = Support("spring" if spring else "mass", radius_m=THICK_M / 2.0, mass_kg=mass, stiffness_n_m=spring)
    plate = LoadedPlate(Lattice.of_rows(PITCH_M, PITCH_M), stiff, DENSITY * THICK_M, (own,))
    return plate.frequencies(k, count, reach)


def missed(frequency_hz: float, mass: float) -> float:
    """Largest relative overestimate of thin-plate theory at a frequency: shear, rotary inertia, and that of a mass on a face.

    A wave of wavenumber q is (q h)^2 (1 + 2/(5/6 (1 - nu))) / 24 slower by Mindlin's theory, half more at a point load.
    """
    stiff = ALLOY.young_pa * THICK_M**3 / 12.0 / (1.0 - ALLOY.poisson**2)
    square = 2.0 * np.pi * frequency_hz * np.sqrt(DENSITY * THICK_M / stiff) * THICK_M**2
    sheared = (1.0 + 2.4 / (1.0 - ALLOY.poisson)) / 24.0
    return float(1.5 * sheared * square + mass / PLATE_KG * square / 4.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("keys", "mass", "spring"),
    [
        ({"mass_g": 500.0 * PLATE_KG}, 0.5 * PLATE_KG, 0.0),
        ({"stiffness_N_per_m": STIFF_N_M}, 0.0, STIFF_N_M),
        ({"mass_g": 500.0 * PLATE_KG, "stiffness_N_per_m": STIFF_N_M}, 0.5 * PLATE_KG, STIFF_N_M),
    ],
    ids=["mass", "spring to ground", "resonator"],
)
def test_flexural_waves_are_those_of_the_plane_wave_expansion(
    keys: dict[str, float], mass: float, spring: float
) -> None:
    found = bands([{"at_mm": [3.0, -2.0], **keys}])
    for point in found.points:
        k = np.array([point.kx_per_m, point.ky_per_m])
        pairs = zip(point.frequencies_hz, point.error, point.plate_polarisation or (), strict=True)
        ours = [(hz, bar) for hz, bar, name in pairs if name == "flexural" and hz > 1.0]
        theory = expanded(k, mass, spring, 6)
        theory = theory[theory > 1.0]
        assert ours
        for (hz, bar), other in zip(ours, theory, strict=False):
            assert bar is not None and bar < 0.03
            assert -missed(other, mass) - bar <= hz / other - 1.0 <= 0.5 * missed(other, mass) + bar
    at_x = np.array([found.points[1].kx_per_m, 0.0])
    shift = np.abs(expanded(at_x, mass, spring, 2) / expanded(at_x, 0.0, 0.0, 2) - 1.0)
    assert shift.max() > 10.0 * missed(found.points[1].frequencies_hz[0], mass)  # more than theory misses


@pytest.mark.slow
def test_a_resonator_of_no_stiffness_changes_nothing() -> None:
    quick: dict[str, Any] = {"solve": {"accuracy": 0.1}, "bands": {"points": 1, "count": 3, "path": "GX"}}
    quick["array"] = {"pitch_mm": 2.0}
    none, loose = bands(None, **quick), bands([{"at_mm": [0.5, 0.0], "mass_g": 1.0, "stiffness_N_per_m": 0.0}], **quick)
    assert [p.frequencies_hz for p in none.points] == [p.frequencies_hz for p in loose.points]


@pytest.mark.slow
def test_matrices_hold_what_is_attached() -> None:
    line = np.linspace(-2e-3, 2e-3, 5)
    mesh = hex_mesh(Boxes(line, line, np.array([0.0, 1e-3]), np.zeros((4, 4, 1), dtype=int), ("plate",)), 2)
    system = assemble(mesh, {"plate": MATERIALS["aluminium"]})
    at, radius = (0.4e-3, -0.3e-3), 0.5e-3
    own = [
        Support("mass", at_m=at, radius_m=radius, mass_kg=1e-3),
        Support("spring", at_m=at, radius_m=radius, stiffness_n_m=1e4),
    ]
    found = with_attached(system, own, 1e-3)
    assert found.grounded and not found.upright
    assert (found.mass.sum() - system.mass.sum()) * system.scale.mass_kg == pytest.approx(1e-3)
    unit = system.scale.young_pa * system.scale.length_m
    more, x = (found.stiffness - system.stiffness) * unit, mesh.nodes[:, 0]
    for field, value in ((np.ones(len(x)), 1.0), (x, at[0]), (x**2, at[0] ** 2 + radius**2 / 4.0)):
        lifted = np.kron(field, [0.0, 0.0, 1.0])
        assert lifted @ (more @ lifted) == pytest.approx(1e4 * value**2)  # the mean over the disc
    hung = with_attached(system, [Support("spring", at_m=at, radius_m=radius, stiffness_n_m=1e4, mass_kg=1e-3)], 1e-3)
    assert not hung.grounded and hung.upright == (len(x),)
    lift = np.kron(np.ones(len(x) + 1), [0.0, 0.0, 1.0])
    assert np.abs(hung.stiffness @ lift).max() < 1e-12 * np.abs(hung.stiffness).max()
    with pytest.raises(SolverError, match="does not lie on the plate's bare back face"):
        with_attached(system, [Support("mass", at_m=(2e-3, 0.0), radius_m=radius, mass_kg=1e-3)], 1e-3)


@pytest.mark.parametrize(
    ("attached", "words"),
    [
        ({"at_mm": [0, 0]}, r"cell.attached.0: missing, must have mass_g, stiffness_N_per_m or both"),
        ({"mass_g": 1.0}, r"cell.attached.0.at_mm: missing"),
        ({"at_mm": [9.9, 0], "mass_g": 1.0}, r"cell.attached.0.at_mm = .*: must be at most 9.75 and 9.75 mm"),
        ({"at_mm": [0, 0], "mass_g": -1.0}, r"cell.attached.0.mass_g = -1"),
        ({"at_mm": [0, 0], "mass": 1.0}, r"cell.attached.0.mass = 1"),
        (
            {"at_mm": [0, 0], "mass_g": 1.0, "damping_Ns_per_m": 2.0},
            r"damping_Ns_per_m = 2: must be left out: waves of bands",
        ),
    ],
)
def test_faults_are_one_line(attached: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words) as fault:
        case([attached])
    assert len(fault.value.lines) == 1


def test_what_cannot_honour_it_refuses_it() -> None:
    own = [{"at_mm": [0.0, 0.0], "mass_g": 0.1}]
    pillar = {"side_mm": 1.0, "height_mm": 2.0}
    with pytest.raises(InputError, match=r"at_mm = .*: must lie on bare plate: the pillar takes 1 x 1 mm of it"):
        case(own, pillar=pillar)
    aside = [{"at_mm": [3.0, 0.0], "mass_g": 0.1}]
    zone, array = {"length_mm": 60.0, "width_mm": 20.0, "nodal_lines": 4}, {"pitch_mm": 1e3 * PITCH_M, "rows": 1}
    with pytest.raises(InputError, match=r"\[\[cell.attached\]\]: broadband cannot honour it"):
        ask(case(aside, pillar=pillar, zone=zone, array=array), Broadband(), Run(LOG))
    with pytest.raises(
        InputError, match=r"solve.model = 'solid': must be auto or superelement for bands with \[cell\]"
    ):
        ask(case(aside, solve={"model": "solid"}), Bands(), Run(LOG))
    with pytest.raises(
        InputError, match=r"at_mm = \[10, 0\]: must not cross a side of the cell along \[20, 0\] and \[10, 17"
    ):
        case([{"at_mm": [10, 0], "mass_g": 0.1}], array=TRIANGULAR)
    with pytest.raises(InputError, match=r"at_mm = .*: must lie on bare plate: the pillar takes 1 x 1 mm of it"):
        case([{"at_mm": [10.0, 1e3 * HEIGHT_M], "mass_g": 0.1}], array=TRIANGULAR, pillar=pillar)


HEIGHT_M = PITCH_M * np.sqrt(3.0) / 2.0  # of the rows of a triangular lattice


def lattice_waves(scene: Case, places: FloatArray, count: int) -> list[tuple[FloatArray, FloatArray]]:
    """Lowest waves at wavevectors (n, 2), Hz, and their relative bars."""
    scene = by_vectors(scene)
    model = lattice_model(scene, cell_model_choice(scene), places, LOG, [])
    solved = [model.lattice.waves(k, count) for k in places]
    by_mesh = (mesh_error(model.lattice.cell, each).half_width[:count] for each in solved)
    bars = [one + two for one, two in zip(model.truncation(solved, count), by_mesh, strict=True)]
    return [(each.frequency_hz, bar) for each, bar in zip(solved, bars, strict=True)]


@pytest.mark.slow
def test_resonators_of_a_triangular_lattice_move_plane_waves_and_its_rectangular_supercell() -> None:
    """At general wavevectors: one resonator in a rhombus, two in a rectangle, and a thin plate's plane waves."""
    keys = {"mass_g": 500.0 * PLATE_KG, "stiffness_N_per_m": STIFF_N_M}
    places = np.array([[70.0, 40.0], [-35.0, 110.0]])
    quarters = [1e3 * PITCH_M / 4.0, 1e3 * HEIGHT_M / 2.0]
    pair = [{"at_mm": [sign * each for each in quarters], **keys} for sign in (-1.0, 1.0)]
    wide = {"pitch_x_mm": 1e3 * PITCH_M, "pitch_y_mm": 2e3 * HEIGHT_M}
    primitive = case([{"at_mm": [2.0, 1e3 * HEIGHT_M + 1.0], **keys}], array=TRIANGULAR)  # an image, in the next row
    folded = np.vstack([places, places + np.array([0.0, np.pi / HEIGHT_M])])
    ours = lattice_waves(primitive, folded, 4)
    theirs = lattice_waves(case(pair, array=wide), places, 5)
    for place, (hz, bar) in enumerate(theirs):
        parts = [ours[place], ours[place + len(places)]]
        order = np.argsort(np.concatenate([part[0] for part in parts]))[:5]
        own, its = (np.concatenate([part[k] for part in parts])[order] for k in (0, 1))
        assert (np.abs(hz / own - 1.0) <= bar + its).all() and (bar + its).max() < 0.06
    stiff = ALLOY.young_pa * THICK_M**3 / 12.0 / (1.0 - ALLOY.poisson**2)
    hung = Support("spring", radius_m=THICK_M / 2.0, mass_kg=0.5 * PLATE_KG, stiffness_n_m=STIFF_N_M)
    plate = LoadedPlate(primitive.design.lattice, stiff, DENSITY * THICK_M, (hung,))
    for k, (hz, bar) in zip(folded, ours, strict=True):
        theory = plate.frequencies(k, 3, 8)
        less = np.array([missed(tone, 0.5 * PLATE_KG) for tone in theory])
        assert (hz[:3] / theory - 1.0 <= 0.5 * less + bar[:3]).all() and (
            hz[:3] / theory - 1.0 >= -less - bar[:3]
        ).all()
    bare = LoadedPlate(primitive.design.lattice, stiff, DENSITY * THICK_M, ())
    assert np.abs(bare.frequencies(places[0], 2, 8) / plate.frequencies(places[0], 2, 8) - 1.0).max() > 0.1


@pytest.mark.slow
def test_resonators_stop_waves_about_their_frequency() -> None:
    """Rows of them attenuate flexural waves where the expansion has none at this wavenumber along them."""
    own = [{"at_mm": [0.0, 0.0], "mass_g": 500.0 * PLATE_KG, "stiffness_N_per_m": STIFF_N_M}]
    across = np.linspace(0.0, np.pi / PITCH_M, 41)
    edges = np.array([expanded(np.array([1e-6, ky]), 0.5 * PLATE_KG, STIFF_N_M, 3, 6) for ky in across])
    low, high = edges[:, 0].max(), edges[:, 1].min()
    assert low < TONE_HZ < high
    window = (1e-3 * (low + 0.1 * (high - low)), 1e-3 * (high - 0.1 * (high - low)))
    found = ask(case(own), Attenuation(band_kHz=window, points=3, kx_per_m=0.0), Run(LOG))
    assert all(point.db_per_row and point.db_per_row > 0.5 for point in found.points)
    below = ask(case(own), Attenuation(band_kHz=(0.5e-3 * low, 0.9e-3 * low), points=2, kx_per_m=0.0), Run(LOG))
    assert [point.db_per_row for point in below.points] == [0.0, 0.0]
