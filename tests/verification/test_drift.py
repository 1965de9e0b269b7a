"""Drift with temperature: against the plate solved whole at another temperature, and against where the energy sits."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest

from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models.modes import solve_modes
from pipeline.planning.model_choice import of_case
from pipeline.planning.simplifications import alike_drift
from pipeline.questions.drift import Drift, DriftResult
from pipeline.questions.question import Run, ask
from tests.helpers.exploring import SMALL

LOG = TerminalLog(True)
SIZES = {
    "plate.thickness_mm": 2.0, "zone.length_mm": 28.0, "zone.width_mm": 20.0, "array.pitch_mm": 4.0,
    "array.extension_mm": 5.0, "pillar.side_mm": 2.0, "pillar.height_mm": 6.3,
}  # fmt: skip
PLATE = {"young_GPa": 70.0, "poisson": 0.34, "density_kg_m3": 2700.0, "dE_dT_per_K": -4e-4, "expansion_per_K": 2e-5}
PILLAR = {"young_GPa": 60.0, "poisson": 0.34, "density_kg_m3": 2700.0, "dE_dT_per_K": -3e-3, "expansion_per_K": 1e-5}


def case(plate: dict[str, Any], pillar: dict[str, Any], *more: Any) -> Case:
    raw = tomllib.loads(SMALL.read_text("utf-8"))
    raw |= {"material": plate, "pillar": raw["pillar"] | {"material": pillar}}
    return case_from_dict(
        raw, None, ["solve.accuracy=0.1", "zone.length_mm=28", "zone.nodal_lines=2", "array.rows=1", *more]
    )


def drift_of(own: Case, **options: Any) -> DriftResult:
    return ask(own, Drift(**options), Run(LOG))


@pytest.mark.slow
def test_a_plate_of_one_material_scales_as_it_is_solved_warm(coarsest_here: None) -> None:
    found = drift_of(case(PLATE, PLATE), around_K=40.0, points=3)
    warm = case(PLATE, PLATE, "solve.temperature_C=60")
    row = solve_modes(warm, of_case(warm), LOG).target_row
    assert row and found.points[-1].frequency_hz == pytest.approx(row.frequency_hz, rel=1e-8)
    assert found.drift_hz_per_K is not None and found.drift_db_per_K == 0.0
    slope = found.points[1].frequency_hz / 2.0 * (-4e-4 + 2e-5)  # of the root of the stiffness, at 20 C
    assert found.drift_hz_per_K == pytest.approx(slope, rel=1e-4)


def test_moduli_over_frequency_do_not_scale() -> None:
    rows = {"young_GPa_at": [[1e3, 60.0, 0.0], [1e5, 70.0, 0.0]]}
    varied = {key: value for key, value in PLATE.items() if key != "young_GPa"} | rows
    assert alike_drift(case(PLATE, PLATE).design) and alike_drift(case(varied, varied).design) is None


@pytest.mark.slow
def test_two_materials_drift_by_where_the_energy_sits(coarsest_here: None) -> None:
    """The sum over materials of coefficient times strain energy is 1/Q of loss factors as large: f'/f is half of it."""
    found = drift_of(case(PLATE, PILLAR), around_K=5.0, points=3)
    lossy = [table | {"loss_factor": -table["dE_dT_per_K"] - table["expansion_per_K"]} for table in (PLATE, PILLAR)]
    own = case(*lossy, "damping.quality=materials")
    row = solve_modes(own, of_case(own), LOG).target_row
    assert row and row.quality_factor and found.drift_hz_per_K is not None
    assert found.drift_hz_per_K == pytest.approx(-row.frequency_hz / (2.0 * row.quality_factor), rel=0.01)
    # the pillars lose their tuning by 0.13 % a kelvin
    assert found.drift_db_per_K is not None and abs(found.drift_db_per_K) > 1e-3


def by_hand(table: dict[str, Any], kelvin: float) -> tuple[dict[str, Any], float]:
    """A material of another temperature that knows no temperature, and the factor of its lengths."""
    longer = 1.0 + table["expansion_per_K"] * kelvin
    softer = 1.0 + table["dE_dT_per_K"] * kelvin
    own = {"young_GPa": table["young_GPa"] * softer, "density_kg_m3": table["density_kg_m3"] / longer**3}
    return {"poisson": table["poisson"], **own}, longer


@pytest.mark.slow
def test_pillars_that_expand_otherwise_than_their_plate_drift_within_the_bar() -> None:
    """A warm plate keeps the pillars' sizes relative to its own; sizes, densities and moduli written by hand do not."""
    pillar = PILLAR | {"expansion_per_K": 2e-4}
    found = drift_of(case(PLATE, pillar), around_K=20.0, points=3)
    tones = []
    for kelvin in (-20.0, 20.0):
        (sheet, longer), (post, taller) = by_hand(PLATE, kelvin), by_hand(pillar, kelvin)
        scaled = {key: size * (taller if key.startswith("pillar.") else longer) for key, size in SIZES.items()}
        warm = case(sheet, post).but(scaled)
        row = solve_modes(warm, of_case(warm), LOG).target_row
        assert row
        tones.append(row.frequency_hz)
    assert found.drift_hz_per_K is not None and found.drift_error_hz_per_K is not None
    print(f"drift {found.drift_hz_per_K} +- {found.drift_error_hz_per_K}, by hand {(tones[1] - tones[0]) / 40.0} Hz/K")
    missed = abs(found.drift_hz_per_K - (tones[1] - tones[0]) / 40.0)
    assert 0.05 * found.drift_error_hz_per_K < missed < found.drift_error_hz_per_K


@pytest.mark.slow
def test_a_finer_plate_drifts_within_the_bars() -> None:
    coarse, fine = (drift_of(case(PLATE, PILLAR, f"solve.accuracy={goal}"), points=3) for goal in (0.1, 0.003))
    for name in ("hz", "db"):
        one, two = (getattr(each, f"drift_{name}_per_K") for each in (coarse, fine))
        bars = [getattr(each, f"drift_error_{name}_per_K") for each in (coarse, fine)]
        assert None not in (one, two, *bars) and abs(one - two) <= sum(bars)


@pytest.mark.slow
def test_what_is_not_known_is_said(coarsest_here: None) -> None:
    bare = {key: PLATE[key] for key in ("young_GPa", "poisson", "density_kg_m3")}
    with pytest.raises(InputError, match="drift needs dE_dT_per_K or expansion_per_K of one of them"):
        drift_of(case(bare, bare))
    with pytest.raises(
        InputError, match=r"around_K = 1000: solve.temperature_C = -980: must be a number, from -273.15"
    ):
        drift_of(case(PLATE, PLATE), around_K=1000.0)
    run = Run(LOG)
    ask(case(bare, PLATE), Drift(points=3), run)
    assert any("dE_dT_per_K and expansion_per_K not known: taken as 0" in text for text in run.warnings)
