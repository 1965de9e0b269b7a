"""Plates of any law and of several layers, with pillars: reduced, meshed whole and by tetrahedra, and free blocks by Ritz."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from geometry.materials import MATERIALS
from pipeline.case.model import Case, case_from_dict
from pipeline.models.modes import solve_modes
from pipeline.planning.model_choice import Request, model_choice_of
from studies.independent import free_block_hz
from tests.helpers.recording_log import RecordingLog

SILICON = {"density_kg_m3": 2330.0, "cubic_GPa": {"C11": 165.7, "C12": 63.9, "C44": 79.6}}
QUARTZ_GPA = [
    [86.8, 7.0, 11.9, -18.0, 0.0, 0.0], [7.0, 86.8, 11.9, 18.0, 0.0, 0.0], [11.9, 11.9, 105.8, 0.0, 0.0, 0.0],
    [-18.0, 18.0, 0.0, 58.2, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 58.2, -18.0], [0.0, 0.0, 0.0, 0.0, -18.0, 39.9],
]  # fmt: skip
CRYSTALS: dict[str, dict[str, Any]] = {
    "silicon": SILICON,
    "silicon <110>": {**SILICON, "axes_deg": [45.0, 0.0, 0.0]},
    "silicon turned": {**SILICON, "axes_deg": [10.0, 20.0, 30.0]},
    "quartz": {"density_kg_m3": 2649.0, "C_GPa": QUARTZ_GPA},
    "fibres": {
        "density_kg_m3": 1900.0,
        "orthotropic": {
            "E1_GPa": 40.0, "E2_GPa": 8.0, "E3_GPa": 8.0, "nu12": 0.27, "nu13": 0.27, "nu23": 0.4,
            "G12_GPa": 4.0, "G13_GPa": 4.0, "G23_GPa": 2.5,
        },
    },
}  # fmt: skip
SIZE_MM = (12.0, 11.0, 10.0)


def frequencies(case: Case, band_hz: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    rows = solve_modes(case, Request("plate", band_hz, search=False), RecordingLog()).rows
    order = np.argsort([row.frequency_hz for row in rows])
    tones, bars = np.array([row.frequency_hz for row in rows]), np.array([row.error for row in rows], dtype=float)
    return tones[order], bars[order]


def block(material: dict[str, Any], accuracy: float) -> Case:
    length, width, thickness = SIZE_MM
    zone = {"length_mm": length, "width_mm": width, "nodal_lines": 1}
    solve = {"accuracy": accuracy, "model": "solid"}
    return case_from_dict({"material": material, "plate": {"thickness_mm": thickness}, "zone": zone, "solve": solve})


def check_block(name: str, accuracy: float, degree: int, count: int) -> float:
    """The largest error of the lowest modes of a free block against Ritz, all inside their bars."""
    case = block(CRYSTALS[name], accuracy)
    size = (*(1e-3 * each for each in SIZE_MM),)
    ritz = free_block_hz(case.design.material, size, np.inf, (degree,) * 3)
    exact = np.sort(np.concatenate(list(ritz.values())))[: count + 1]
    tones, bars = frequencies(case, (0.5 * exact[0], (exact[-2] + exact[-1]) / 2.0))
    off = np.abs(tones / exact[:-1] - 1.0)
    assert (off <= bars + 1e-6).all(), (off, bars)
    return float(off.max())


@pytest.mark.parametrize("name", ["quartz"])
def test_a_free_block_has_the_modes_of_its_law(name: str) -> None:
    assert check_block(name, 0.003, 8, 8) <= 0.003


@pytest.mark.slow
@pytest.mark.parametrize("name", CRYSTALS)
def test_free_blocks_of_five_crystals_are_right_to_their_accuracy(name: str) -> None:
    assert check_block(name, 1e-4, 11, 12) <= 1e-4


@pytest.mark.slow
def test_a_thin_slab_of_panels_without_mirrors_has_the_modes_of_its_law() -> None:
    """Bare panels of a law without mirrors are not halved."""
    size, law = (24.0, 14.0, 2.0), {**SILICON, "axes_deg": [20.0, 15.0, 0.0]}
    zone = {"length_mm": size[0], "width_mm": size[1], "nodal_lines": 2}
    plate = {"thickness_mm": size[2]}
    case = case_from_dict({"material": law, "plate": plate, "zone": zone, "solve": {"accuracy": 0.01}})
    exact = free_block_hz(case.design.material, (*(1e-3 * each for each in size),), np.inf, (12, 10, 4))["whole"][:7]
    tones, bars = frequencies(case, (0.5 * exact[0], (exact[-2] + exact[-1]) / 2.0))
    assert (np.abs(tones / exact[:-1] - 1.0) <= bars + 1e-5).all()


@pytest.mark.slow
@pytest.mark.parametrize("part", ["zone", "pillar"])
def test_a_part_without_mirrors_is_held_like_its_quarter(part: str) -> None:
    """Aluminium, and aluminium with a coupling of xx and xy that takes its mirrors and next to nothing else."""
    law = np.array(MATERIALS["aluminium"].stiffness_pa) / 1e9
    law[0, 5] = law[5, 0] = 1e-5 * law[0, 0]
    given = {
        "plate": {"thickness_mm": 2.0}, "zone": {"length_mm": 24.0, "width_mm": 16.0, "nodal_lines": 2},
        "pillar": {"side_mm": 2.0, "height_mm": 4.0}, "array": {"pitch_mm": 4.0, "rows": 1}, "solve": {"accuracy": 0.05},
    }  # fmt: skip
    found = []
    for material in ("aluminium", {"density_kg_m3": 2700.0, "C_GPa": law.tolist()}):
        case = case_from_dict({**given, "material": material})
        assert model_choice_of(case, part, 1e5).quarter == (material == "aluminium")
        rows = solve_modes(case, Request(part, near_hz=0.0, count=6, search=False), RecordingLog()).rows
        found.append(np.array(sorted((row.frequency_hz, row.error or np.nan) for row in rows)[:6]).T)
    (one, bars), (other, more) = found
    assert (np.abs(one / other - 1.0) <= bars + more + 1e-5).all()


PLATE = {
    "zone": {"length_mm": 24.0, "width_mm": 10.0, "nodal_lines": 2},
    "pillar": {"side_mm": 2.0, "height_mm": 3.0},
    "array": {"pitch_mm": 4.0, "rows": 1, "extension_mm": 2.0},
}
LAYERED = {
    "material": "steel",
    "plate": {"layer": [
        {"material": "glass", "thickness_mm": 0.7},
        {"material": "optically-clear-adhesive", "thickness_mm": 0.2},
        {"material": "glass", "thickness_mm": 1.1},
    ]},
}  # fmt: skip
TURNED = {"material": {**SILICON, "axes_deg": [20.0, 15.0, 0.0]}, "plate": {"thickness_mm": 2.0}}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("own", "band_hz", "other"),
    [
        (LAYERED, (3e3, 14e3), {"accuracy": 0.02, "mesh": "tet"}),
        (LAYERED, (3e3, 10e3), {"accuracy": 0.02, "model": "solid"}),
        (TURNED, (3e3, 60e3), {"accuracy": 0.02, "mesh": "tet"}),
        (TURNED, (3e3, 50e3), {"accuracy": 0.02, "model": "solid"}),
    ],
)
def test_plates_with_pillars_agree_within_both_bars(
    own: dict[str, Any], band_hz: tuple[float, float], other: dict[str, Any]
) -> None:
    reduced = frequencies(case_from_dict({**PLATE, **own, "solve": {"accuracy": 0.01}}), band_hz)
    second = frequencies(case_from_dict({**PLATE, **own, "solve": other}), band_hz)
    assert len(reduced[0]) == len(second[0]) >= 3
    assert (np.abs(reduced[0] / second[0] - 1.0) <= reduced[1] + second[1]).all()


@pytest.mark.slow
def test_turning_material_and_plate_together_changes_nothing() -> None:
    """A quarter turn of plate and axes: the bars of a block are the same, to rounding."""
    law = {"orthotropic": CRYSTALS["fibres"]["orthotropic"], "density_kg_m3": 1900.0}
    tones = []
    for size, axes in (((8.0, 6.0), None), ((6.0, 8.0), [90.0, 0.0, 0.0])):
        material = law if axes is None else {**law, "axes_deg": axes}
        zone = {"length_mm": size[0], "width_mm": size[1], "nodal_lines": 1}
        case = case_from_dict(
            {"material": material, "plate": {"thickness_mm": 4.0}, "zone": zone,
             "solve": {"accuracy": 0.02, "model": "solid"}}
        )  # fmt: skip
        tones.append(frequencies(case, (1e4, 1.6e5))[0])
    np.testing.assert_allclose(tones[0], tones[1], rtol=1e-9)
