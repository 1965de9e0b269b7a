"""Bands of bare plates of any layers and laws against collocation: ten waves in three directions, inside their bars."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.case.model import Case, case_from_dict
from tests.helpers.asked import bands_of
from tests.helpers.layered_plate import folded_waves_hz
from tests.helpers.recording_log import RecordingLog

PITCH_MM = {"three layers": 10.0}  # the others 8: ten waves at 0.003 err by 0.03 to 0.08 %, as the pitch has it
FIBRES = {
    "density_kg_m3": 1900.0,
    "orthotropic": {
        "E1_GPa": 40.0, "E2_GPa": 8.0, "E3_GPa": 8.0, "nu12": 0.27, "nu13": 0.27, "nu23": 0.4,
        "G12_GPa": 4.0, "G13_GPa": 4.0, "G23_GPa": 2.5,
    },
}  # fmt: skip
PLATES: dict[str, dict[str, Any]] = {
    "orthotropic": {"material": FIBRES, "plate": {"thickness_mm": 2.0}},
    "turned silicon": {
        "material": {"density_kg_m3": 2330.0, "cubic_GPa": {"C11": 165.7, "C12": 63.9, "C44": 79.6},
                     "axes_deg": [20.0, 0.0, 0.0]},
        "plate": {"thickness_mm": 2.0},
    },
    "three layers": {
        "material": "steel",
        "plate": {"layer": [
            {"material": "glass", "thickness_mm": 0.7},
            {"material": "epoxy", "thickness_mm": 0.3},
            {"material": "aluminium", "thickness_mm": 1.0},
        ]},
    },
}  # fmt: skip


def case_of(name: str, accuracy: float) -> Case:
    plate = PLATES[name]
    more = {"array": {"pitch_mm": PITCH_MM.get(name, 8.0)}, "bands": {"path": "GXM", "points": 2, "count": 10}}
    return case_from_dict({**plate, **more, "solve": {"accuracy": accuracy}})


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["orthotropic", *(pytest.param(name, marks=pytest.mark.slow) for name in PLATES if name != "orthotropic")]
)
def test_bands_of_a_bare_plate_are_its_waves(name: str) -> None:
    case = case_of(name, 0.003)
    found = bands_of(case, RecordingLog())
    stack, pitch, directions = case.design.stack, case.design.pitch_x_m, set()
    for point in found.points:
        wave = np.array([point.kx_per_m, point.ky_per_m])
        if not wave.any():
            continue
        exact = folded_waves_hz(stack, pitch, wave, 10)
        off, bars = np.abs(np.array(point.frequencies_hz) / exact - 1.0), np.array(point.error)
        assert (off <= bars).all(), (name, point.label, off / bars)
        assert off.max() <= 5e-4, (name, point.label, off)
        directions.add(round(float(np.degrees(np.arctan2(wave[1], wave[0])))))
    assert directions == {0, 27, 45}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["aluminium", "three layers"])
def test_bands_of_a_bare_cell_meshed_whole_are_its_waves_degenerate_ones_with_the_larger_bar(name: str) -> None:
    """At X every wave has a partner that a coarser mesh may exchange with it."""
    plate = PLATES.get(name, {"material": "aluminium", "plate": {"thickness_mm": 2.0}})
    more = {"array": {"pitch_mm": 4.0}, "bands": {"path": "GX", "points": 1, "count": 4}}
    case = case_from_dict({**plate, **more, "solve": {"accuracy": 0.02, "model": "solid"}})
    corner = bands_of(case, RecordingLog()).points[-1]
    exact = folded_waves_hz(case.design.stack, 4e-3, np.array([corner.kx_per_m, corner.ky_per_m]), 4)
    off, bars = np.abs(np.array(corner.frequencies_hz) / exact - 1.0), np.array(corner.error)
    assert (off <= bars).all() and bars.max() < 0.02
