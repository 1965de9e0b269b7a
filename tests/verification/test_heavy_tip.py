"""Pillars with a heavy tip: its limits, beam theory, tetrahedra of the CAD solid, and the whole solid plate."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.case.model import case_from_dict
from pipeline.logs import TerminalLog
from pipeline.models.modes import ModeRow, solve_modes
from pipeline.planning.model_choice import Request
from solvers.analytic.predesign import pillar_frequencies_hz
from tests.helpers.whole_solid import check_within_both_bars

RAW: dict[str, Any] = {
    "name": "heavy",
    "material": "glass",
    "plate": {"thickness_mm": 0.7},
    "zone": {"length_mm": 8.0, "width_mm": 5.0, "nodal_lines": 2},
    "pillar": {
        "shape": "square",
        "side_mm": 0.8,
        "section": [{"height_mm": 2.0}, {"side_mm": 1.6, "height_mm": 0.8, "material": "steel"}],
    },
    "array": {"pitch_mm": 2.5, "rows": 1, "extension_mm": 1.5},
    "solve": {"accuracy": 0.01},
}
BARE = RAW | {"pillar": {"shape": "square", "side_mm": 0.8, "height_mm": 2.0}}


def lone(*settings: str) -> tuple[ModeRow, ...]:
    query = Request("pillar", near_hz=0.0, count=5)
    return solve_modes(case_from_dict(RAW, None, settings), query, TerminalLog(True)).rows


def hz(rows: tuple[ModeRow, ...]) -> np.ndarray:
    return np.array([row.frequency_hz for row in rows])


@pytest.fixture(scope="module")
def heavy() -> tuple[ModeRow, ...]:
    return lone()


@pytest.mark.slow
def test_a_chain_of_beams_bends_as_the_solid(heavy: tuple[ModeRow, ...]) -> None:
    """Beam theory of a stem 2.5 times as high as wide: the predesign states 3 % of shear, and one hundredth is left."""
    pillar = case_from_dict(RAW).design.pillar
    assert pillar and pillar_frequencies_hz(pillar, "timoshenko")[0] == pytest.approx(heavy[0].frequency_hz, rel=0.01)
    assert heavy[0].frequency_hz == pytest.approx(heavy[1].frequency_hz, rel=1e-9), "it bends alike along x and y"


@pytest.mark.slow
def test_tetrahedra_of_the_bonded_cad_solid_agree(heavy: tuple[ModeRow, ...]) -> None:
    for one, other in zip(heavy[:3], lone("solve.mesh=tet"), strict=False):
        assert one.error is not None and other.error is not None
        assert other.frequency_hz == pytest.approx(one.frequency_hz, rel=one.error + other.error)


@pytest.mark.parametrize("settings", [("pillar.section.1.height_mm=0",), ()])
def test_a_section_without_height_and_none_are_one_case(settings: tuple[str, ...]) -> None:
    without = case_from_dict(BARE)
    case = case_from_dict(RAW, None, settings)
    assert (case.design == without.design) == bool(settings)
    assert (case.to_dict() == without.to_dict()) == bool(settings)


@pytest.mark.slow
def test_a_section_like_the_one_below_is_a_taller_pillar() -> None:
    """Within both bars: the mesh has one line more, nothing else differs."""
    ours = lone("pillar.section.1.side_mm=0.8", "pillar.section.1.material=glass")
    taller = case_from_dict(BARE, None, ["pillar.height_mm=2.8"])
    theirs = solve_modes(taller, Request("pillar", near_hz=0.0, count=5), TerminalLog(True)).rows
    for one, other in zip(ours, theirs, strict=True):
        assert one.error is not None and other.error is not None and max(one.error, other.error) < 0.01
        assert one.frequency_hz == pytest.approx(other.frequency_hz, rel=one.error + other.error)


@pytest.mark.slow
def test_cells_with_heavy_tips_have_the_modes_of_the_whole_solid_within_both_bars() -> None:
    check_within_both_bars(RAW, (5e3, 60e3))
