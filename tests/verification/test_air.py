"""Air before a plate: what its modes lose by it, and the level of its sound."""

from __future__ import annotations

from math import log10, pi
from typing import Any

import numpy as np
import pytest

from geometry.materials import MATERIALS
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models.forced import forced_plate
from pipeline.models.modes import Request, solve_modes
from solvers.piezo.forced import SOUND_AT_M, ForcedPlate, sound_db

LOG = TerminalLog(True)
RAW: dict[str, Any] = {
    "name": "air",
    "material": "glass",
    "plate": {"thickness_mm": 2.0},
    "zone": {"length_mm": 40.0, "width_mm": 20.0, "nodal_lines": 4},
    "array": {"rows": 0, "extension_mm": 5.0},
    "patches": {"size_mm": [6.0, 4.0, 0.3], "centres_mm": [[-8.0, 0.0]]},
    "solve": {"accuracy": 0.02},
}


def case(**more: Any) -> Case:
    return case_from_dict(RAW | more)


@pytest.mark.slow
def test_losses_of_materials_and_air_add_up() -> None:
    air, lossy = {"air": {"faces": "both"}}, {"damping": {"quality": "materials"}}
    request = Request("plate", band_hz=(20e3, 40e3), symmetry="SS")
    both, sound, own = (solve_modes(case(**each), request, LOG).rows for each in (air | lossy, air, lossy))
    assert len(both) == len(sound) == len(own) > 1
    for one, two, three in zip(both, sound, own, strict=True):
        assert one.quality_factor and two.air_quality_factor and three.quality_factor and one.quality_error
        assert two.quality_factor is None and three.air_quality_factor is None
        total = 1.0 / two.air_quality_factor + 1.0 / three.quality_factor
        assert 1.0 / one.quality_factor == pytest.approx(total, rel=1e-9)
        assert one.air_quality_factor == pytest.approx(two.air_quality_factor, rel=1e-9)


@pytest.mark.slow
def test_a_wide_plate_above_coincidence_loses_as_its_wave() -> None:
    """2 rho c / (w m sqrt(1 - (k_b/k)^2)) of both faces; of one mode within the spread that its edges bring."""
    wide = RAW | {"zone": {"length_mm": 120.0, "width_mm": 80.0, "nodal_lines": 12}, "air": {}}
    rows = solve_modes(case_from_dict(wide), Request("plate", band_hz=(37e3, 42e3)), LOG).rows
    glass = MATERIALS["glass"].as_isotropic
    bending = glass.young_pa * 2e-3**3 / 12.0 / (1.0 - glass.poisson**2)
    mass = MATERIALS["glass"].density_kg_m3 * 2e-3
    expected = []
    for row in rows:
        omega = 2.0 * pi * row.frequency_hz
        ratio = (omega**2 * mass / bending) ** 0.25 / (omega / 343.2)
        expected.append(2.0 * 1.204 * 343.2 / (omega * mass * np.sqrt(1.0 - ratio**2)))
    found = np.array([1.0 / row.air_quality_factor for row in rows if row.air_quality_factor])
    assert len(found) == len(rows) > 4
    assert found.mean() == pytest.approx(np.mean(expected), rel=0.15)


@pytest.fixture(scope="module")
def driven() -> ForcedPlate:
    return forced_plate(case(air={"faces": "touch"}, damping={"quality": "materials"}), LOG, (20e3, 40e3))


@pytest.mark.slow
def test_the_level_is_that_of_a_monopole_where_the_plate_is_short(driven: ForcedPlate) -> None:
    """At low frequencies rho w^2 V / (2 pi r), V the volume that the face displaces; twice the volts are 6 dB."""
    tone, air = 300.0, driven.air
    points, values = driven.shape(tone)
    assert air and len(points) == len(values)
    volume = 0j
    eigenvalue = driven.plate.scale.eigenvalue(tone)
    for basis in driven.modes:
        moved = basis.columns @ basis.amplitudes(eigenvalue, driven.volts(eigenvalue))
        for symmetry, field in zip(basis.group.symmetries, basis.group.touch(moved.real[:, None]), strict=True):
            volume += field.weights @ field.values[:, 0] if "A" not in symmetry else 0.0
    pressure = air.density_kg_m3 * (2.0 * pi * tone) ** 2 * abs(volume) / (2.0 * pi * SOUND_AT_M)
    exact = 20.0 * log10(pressure / np.sqrt(2.0) / 20e-6)
    once, twice = (sound_db(driven, tone, volts) for volts in (1.0, 2.0))
    assert once is not None and twice is not None
    assert once == pytest.approx(exact, abs=0.05)
    assert twice - once == pytest.approx(20.0 * log10(2.0), abs=1e-9)


@pytest.mark.slow
def test_without_air_there_is_no_sound() -> None:
    assert sound_db(forced_plate(case(), LOG, (20e3, 40e3)), 30e3, 1.0) is None


def test_every_fault_has_its_line() -> None:
    for table, line in (
        ({"faces": "back"}, "air.faces"),
        ({"density_kg_m3": 1000.0}, "air.density_kg_m3"),
        ({"sound_m_s": 0.0}, "air.sound_m_s"),
    ):
        with pytest.raises(InputError, match=line):
            case(air=table)
