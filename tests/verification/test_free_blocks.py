"""Free blocks and slabs of any thickness against a Legendre-Ritz solution: no mode missing, every one inside its bar."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geometry.materials import MATERIALS
from pipeline.case.model import Case, case_from_dict
from pipeline.models.modes import PartModes, solve_modes
from pipeline.planning import mesh_rules
from pipeline.planning.model_choice import Request
from studies.independent import free_block_hz
from tests.helpers.laws import FIBRES, orthotropic
from tests.helpers.recording_log import RecordingLog

SLAB_MM = (40.0, 20.0)
CONVERGED = 5e-5  # of the Ritz frequencies: what two degrees more bring at most
MATERIAL_NAMES = ("aluminium", "glass", "pmma")


def case_of(size_mm: tuple[float, float, float], material: str, accuracy: float, model: str = "auto") -> Case:
    length, width, thickness = size_mm
    return case_from_dict(
        {
            "name": "block",
            "material": material,
            "plate": {"thickness_mm": thickness},
            "zone": {"length_mm": length, "width_mm": width, "nodal_lines": 3 if thickness < 0.8 * width else 1},
            "solve": {"accuracy": accuracy, "model": model},
        }
    )


def solved(case: Case, high_hz: float) -> PartModes:
    return solve_modes(case, Request("plate", (0.02 * high_hz, high_hz), search=False), RecordingLog())


def highest_hz(case: Case, count: int, degrees: tuple[int, int, int]) -> tuple[float, dict[str, np.ndarray]]:
    """A frequency in a gap above about `count` modes, and the Ritz frequencies below it by class."""
    design = case.design
    size_m = (design.length_m, design.width_m, design.thickness_m)
    exact = free_block_hz(design.material, size_m, np.inf, degrees)
    every = np.sort(np.concatenate(list(exact.values())))
    at = count + int(np.argmax(np.diff(every[count : count + 5])))
    high = float(every[at : at + 2].mean())
    return high, {name: tones[tones < high] for name, tones in exact.items()}


def check(result: PartModes, exact: dict[str, np.ndarray]) -> None:
    for name, tones in exact.items():
        rows = [row for row in result.rows if row.symmetry == name]
        assert len(rows) == len(tones), name
        for row, tone in zip(rows, tones, strict=True):
            assert row.error is not None
            assert abs(row.frequency_hz / tone - 1.0) <= row.error + CONVERGED, (
                name,
                tone,
                row.frequency_hz,
                row.error,
            )


def degrees_of(thickness_mm: float) -> tuple[int, int, int]:
    """Enough along each edge of a slab: the thinner, the shorter the boundary layers along its free edges."""
    return (20, 16, 5) if thickness_mm <= 2.0 else (16, 14, 8) if thickness_mm <= 6.0 else (14, 12, 10)


def test_the_lame_mode_of_a_cube_is_exact() -> None:
    """f = c_t / (sqrt 2 a): isochoric, in the plane of two faces, free on all of them; three of them by symmetry."""
    material = MATERIALS["steel"]
    exact = np.sqrt(material.as_isotropic.shear_pa / material.density_kg_m3) / (np.sqrt(2.0) * 10e-3)
    tones = np.concatenate(list(free_block_hz(material, (10e-3,) * 3, 1.2 * exact).values()))
    assert np.sum(np.abs(tones / exact - 1.0) < 1e-9) == 3


def test_ritz_frequencies_fall_with_the_degree_and_have_converged() -> None:
    low, high = (free_block_hz(MATERIALS["aluminium"], (12e-3, 11e-3, 10e-3), 330e3, (n, n, n)) for n in (9, 11))
    for name, tones in high.items():
        fall = low[name] / tones - 1.0
        assert (fall >= -1e-9).all() and (fall < CONVERGED).all()


def test_turning_a_block_over_changes_no_frequency() -> None:
    sizes = (8e-3, 5e-3, 3e-3), (3e-3, 8e-3, 5e-3)
    one, other = (free_block_hz(MATERIALS["glass"], size, 6e5, (7, 7, 7)) for size in sizes)
    together = [np.sort(np.concatenate(list(each.values()))) for each in (one, other)]
    np.testing.assert_allclose(*together, rtol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("thickness_mm", [2.0, pytest.param(10.0, marks=pytest.mark.slow)])
def test_slabs_are_inside_their_bars(thickness_mm: float) -> None:
    size = (*SLAB_MM, thickness_mm)
    case = case_of(size, "aluminium", 0.01)
    high, exact = highest_hz(case, 6, degrees_of(thickness_mm))
    check(solved(case, high), exact)


@pytest.mark.slow
@pytest.mark.parametrize("material", MATERIAL_NAMES)
@pytest.mark.parametrize("thickness_mm", [1.0, 2.0, 4.0, 6.0, 10.0, 14.0, 20.0])
def test_slabs_of_every_thickness_are_inside_their_bars(thickness_mm: float, material: str) -> None:
    size = (*SLAB_MM, thickness_mm)
    case = case_of(size, material, 0.003)
    high, exact = highest_hz(case, 20, degrees_of(thickness_mm))
    check(solved(case, high), exact)


@pytest.mark.slow
def test_a_block_misses_no_mode() -> None:
    case = case_of((12.0, 11.0, 10.0), "aluminium", 0.003)
    high, exact = highest_hz(case, 34, (12, 12, 12))
    check(solved(case, high), exact)


@pytest.mark.slow
@pytest.mark.parametrize("thickness_mm", [4.0, 14.0])
def test_slabs_meshed_whole_are_inside_their_bars(thickness_mm: float) -> None:
    """Of thin ones edges and their layers make most of the error, and one element across hides half of it."""
    case = case_of((*SLAB_MM, thickness_mm), "aluminium", 0.01, "solid")
    high, exact = highest_hz(case, 8, degrees_of(thickness_mm))
    check(solved(case, high), exact)


@pytest.mark.slow
@pytest.mark.parametrize(
    "size_mm", [(12.0, 11.0, 10.0), *((*SLAB_MM, thickness) for thickness in (1.0, 6.0, 14.0, 20.0))]
)
def test_bodies_meshed_whole_are_inside_their_bars_and_the_accuracy(size_mm: tuple[float, float, float]) -> None:
    case = case_of(size_mm, "glass", 0.003, "solid")
    high, exact = highest_hz(case, 34, (12, 12, 12) if size_mm[0] < 40.0 else degrees_of(size_mm[2]))
    result = solved(case, high)
    check(result, exact)
    assert max(row.error or 1.0 for row in result.rows) < case.solve.accuracy


def test_thin_plates_keep_degree_three_and_nothing_further() -> None:
    """Up to a quarter of the first thickness-shear resonance."""
    for thickness_mm in (0.5, 1.0, 2.0, 4.0):
        case = case_of((40.0, 20.0, thickness_mm), "aluminium", 0.003)
        high = 0.24 * mesh_rules.shear_cutoff_hz(case.design)
        thin = mesh_rules.plate_reduction(case.design, 0.003, high)
        assert (thin.interface.through, thin.further, thin.hexahedra.through) == (3, 0, 1)
        assert thin.top_hz == mesh_rules.cutoff_to_hz(case.design, 0.003, high)
        thick = mesh_rules.plate_reduction(case.design, 0.003, 10.0 * high)
        assert thick.interface.through > 3 and thick.further == 2


@pytest.mark.parametrize("model", ["superelement", pytest.param("solid", marks=pytest.mark.slow)])
def test_a_slab_of_fibres_along_x_has_the_modes_of_its_orthotropic_law(model: str) -> None:
    case = case_of((*SLAB_MM, 4.0), "pmma", 0.01, model)
    case = replace(case, design=replace(case.design, material=orthotropic(**FIBRES, density_kg_m3=1900.0)))
    high_hz, exact = highest_hz(case, 12, degrees_of(4.0))
    check(solved(case, high_hz), exact)
