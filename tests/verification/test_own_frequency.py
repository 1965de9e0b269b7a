"""Moduli that depend on the frequency: frequencies against solutions with the moduli that belong to them."""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np
import pytest

from geometry.materials import Material
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models.modes import Request, solve_modes
from pipeline.questions.predesign import Predesign
from pipeline.questions.question import Run, ask
from tests.helpers.asked import bands_of
from tests.helpers.exploring import SMALL
from tests.helpers.recording_log import RecordingLog

LOG = TerminalLog(True)
ROWS = [[1e3, 2.0, 0.02], [1e4, 2.6, 0.05], [1e5, 4.0, 0.08]]
RESIN = {"young_GPa_at": ROWS, "poisson": 0.38, "density_kg_m3": 1180.0}
METAL = {"young_GPa": 70.0, "poisson": 0.34, "density_kg_m3": 2700.0}


def young(tone: float) -> float:
    """Of the rows, in GPa: log E is linear in log f."""
    tones, moduli, _ = np.array(ROWS).T
    return float(np.exp(np.interp(np.log(tone), np.log(tones), np.log(moduli))))


def case(plate: dict[str, Any], pillar: dict[str, Any], *more: Any) -> Case:
    raw = tomllib.loads(SMALL.read_text("utf-8"))
    raw |= {"material": plate, "pillar": raw["pillar"] | {"material": pillar}}
    return case_from_dict(raw, None, ["solve.accuracy=0.1", "bands.points=1", "bands.count=5", *more])


def fixed(tone: float) -> dict[str, float]:
    return {"young_GPa": young(tone), "poisson": 0.38, "density_kg_m3": 1180.0}


def test_a_modulus_between_two_rows_is_a_power_of_the_frequency() -> None:
    own = Material.of_table("resin", RESIN).at_hz(np.sqrt(1e3 * 1e4))
    assert own.as_isotropic.young_pa == pytest.approx(1e9 * np.sqrt(2.0 * 2.6)) and own.lost == pytest.approx(0.035)
    assert own.at_hz(1.0).as_isotropic.young_pa == pytest.approx(2e9)
    assert own.at(60.0).at_hz(1e5).as_isotropic.young_pa == pytest.approx(own.at_hz(1e5).as_isotropic.young_pa)


def test_each_mode_of_one_material_has_the_modulus_of_its_own_frequency() -> None:
    found = solve_modes(case(RESIN, RESIN), Request("pillar", near_hz=0.0, count=4), LOG)
    assert len(found.rows) >= 4
    for number, row in enumerate(found.rows):
        alone = case(fixed(row.frequency_hz), fixed(row.frequency_hz))
        again = solve_modes(alone, Request("pillar", near_hz=0.0, count=4), LOG).rows[number]
        assert row.frequency_hz == pytest.approx(again.frequency_hz, rel=1e-7)
        assert "moduli" not in row.error_parts or row.error_parts["moduli"] < 1e-12


def test_the_target_mode_of_two_materials_has_the_moduli_of_its_own_frequency_and_others_lie_within_their_bars() -> (
    None
):
    found = solve_modes(case(METAL, RESIN), Request("plate", band_hz=(20e3, 36e3)), LOG)
    row = found.target_row or found.rows[len(found.rows) // 2]
    for own in {row, found.rows[0], found.rows[-1]}:
        again = solve_modes(case(METAL, fixed(own.frequency_hz)), Request("plate", band_hz=(19e3, 37e3)), LOG)
        nearest = min((each.frequency_hz for each in again.rows), key=lambda hz: abs(hz / own.frequency_hz - 1.0))
        assert own.frequency_hz == pytest.approx(nearest, rel=1e-6 if own is row else own.error_parts["moduli"] + 1e-9)


@pytest.mark.parametrize("plate", [RESIN, METAL], ids=["alike", "two"])
def test_each_wave_has_the_moduli_of_its_own_frequency(plate: dict[str, Any]) -> None:
    bands = bands_of(case(plate, RESIN), LOG)
    for place, band in ((1, 0), (1, 3), (2, 4)):
        tone = bands.points[place].frequencies_hz[band]
        again = bands_of(case(fixed(tone) if plate is RESIN else METAL, fixed(tone)), LOG)
        open_by = 1e-7 if plate is RESIN else bands.points[place].error[band]
        assert open_by is not None and abs(again.points[place].frequencies_hz[band] / tone - 1.0) <= open_by


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"young_GPa_at": ROWS[::-1]}, "must be rows in order of rising frequency"),
        ({"loss_factor": 0.1}, "must be left out: the rows of young_GPa_at have their own"),
        ({"young_GPa": 9.0}, "must lie within young_GPa_at, 2 to 4, or be left out"),
        ({"young_GPa_at": ROWS[:1]}, "young_GPa_at"),
        ({"cubic_GPa": {"C11": 3.0, "C12": 1.0, "C44": 1.0}}, "cannot be combined with young_GPa"),
    ],
)
def test_rows_that_no_material_can_have_are_named(change: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        case(METAL, RESIN | change)


def test_frequencies_beyond_the_rows_are_named() -> None:
    short = RESIN | {"young_GPa_at": ROWS[:2]}
    log = RecordingLog()
    found = solve_modes(case(short, short), Request("pillar", near_hz=0.0, count=4), log)
    assert found.rows[-1].frequency_hz > 1e4
    assert any("young_GPa_at holds from" in text for text in log.warnings.values())


def test_other_questions_say_at_which_frequency_they_take_the_moduli() -> None:
    run = Run(LOG)
    ask(case(METAL, RESIN), Predesign(), run)
    assert any("MODULI: given: its moduli are those at 10000 Hz" in text for text in run.warnings)
    run = Run(LOG)
    ask(case(METAL, RESIN, "solve.moduli_kHz=30"), Predesign(), run)
    assert not any("MODULI" in text for text in run.warnings)
