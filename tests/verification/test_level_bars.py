"""Levels of finer models lie within the bars of coarser ones: decay per row, confinement, transmission, modes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from geometry.elements import FloatArray
from pipeline.case.model import Case, load_case
from pipeline.models import attenuation
from pipeline.models.broadband import broadband
from pipeline.models.modes import Request, solve_modes
from pipeline.paths import ROOT
from pipeline.planning import mesh_rules
from pipeline.questions.broadband import BroadbandResult
from pipeline.questions.question import ask
from pipeline.questions.response import Response
from solvers.superelement.interface import Interface, ReductionSettings
from tests.helpers.asked import attenuation_of
from tests.helpers.recording_log import RecordingLog

pytestmark = pytest.mark.slow
LOG = RecordingLog()


def case(accuracy: float = 0.03) -> Case:
    return load_case(ROOT / "examples/small.toml", [f"solve.accuracy={accuracy}"])


def figures(points: Any, name: str) -> FloatArray:
    return np.array([getattr(point, name) for point in points], dtype=float)


@pytest.fixture
def finer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plates and columns with two degrees more along the sides, elements of one order more, half as many modes again."""
    chosen = mesh_rules.plate_reduction

    def better(*about: Any) -> ReductionSettings:
        reduction = chosen(*about)
        mesh = replace(reduction.hexahedra, order=reduction.hexahedra.order + 1)
        face = Interface(reduction.interface.along + 2, reduction.interface.through)
        return replace(reduction, interface=face, hexahedra=mesh, top_hz=1.5 * reduction.top_hz)

    monkeypatch.setattr(mesh_rules, "plate_reduction", better)


@pytest.fixture(scope="module")
def column() -> Any:
    return BroadbandResult(**broadband(case(), LOG, (25e3, 45e3), 21))


def test_the_decay_of_a_finer_cell_lies_within_the_bars() -> None:
    """Of a cell that is asked for a tenth of the error, at the edges of a pass band, too."""
    coarse, fine = (attenuation_of(case(a), LOG, (30e3, 46e3), points=17) for a in (0.05, 0.005))
    moved = np.abs(figures(coarse.points, "db_per_row") - figures(fine.points, "db_per_row"))
    bars = figures(coarse.points, "db_error"), figures(fine.points, "db_error")
    assert (moved <= bars[0] + bars[1] + attenuation.ROUNDING_DB).all()
    assert moved.max() > 0.0 and bars[0].max() > 3.0 * bars[1].max() > 0.0
    at, error = coarse.at(35e3), coarse.error_at(35e3)
    assert at is not None and error is not None and abs(at - (fine.at(35e3) or 0.0)) < error


@pytest.mark.parametrize(("level", "bar"), [("confinement_db", "confinement_error_db"), ("taken_db", "taken_error_db")])
@pytest.mark.usefixtures("finer")
def test_a_finer_column_lies_within_the_bars(column: Any, level: str, bar: str) -> None:
    other = BroadbandResult(**broadband(case(), LOG, (25e3, 45e3), 21))
    moved = np.abs(figures(column.points, level) - figures(other.points, level))
    bars = figures(column.points, bar), figures(other.points, bar)
    assert (moved <= bars[0] + bars[1]).all() and moved.max() > 0.0
    assert np.median(bars[0]) < 1.0 and np.median(bars[1]) < np.median(bars[0])
    assert abs(column.target_hz / other.target_hz - 1.0) <= column.target_error + other.target_error


def test_levels_of_all_modes_of_a_finer_plate_lie_within_the_bars(
    request: pytest.FixtureRequest,
) -> None:
    """Every listed mode, matched by its class and its place in it."""
    query = Request("plate", (30e3, 48e3), symmetry="SS")
    own = solve_modes(case(), query, LOG)
    request.getfixturevalue("finer")
    other = solve_modes(case(), query, LOG)
    assert len(own.rows) == len(other.rows) > 5
    for one, two in zip(own.rows, other.rows, strict=True):
        assert one.error and two.error and one.confinement_error_db and two.confinement_error_db
        assert abs(one.frequency_hz / two.frequency_hz - 1.0) <= one.error + two.error
        assert one.confinement_db is not None and two.confinement_db is not None
        assert abs(one.confinement_db - two.confinement_db) <= one.confinement_error_db + two.confinement_error_db
        for name in ("zone_share", "mac", "strength"):
            bars = getattr(one, f"{name}_error"), getattr(two, f"{name}_error")
            assert abs(getattr(one, name) - getattr(two, name)) <= sum(bars), name
    levels, errors = (
        [getattr(each.target_part(), name) for each in (own, other)] for name in ("extension_db", "extension_error_db")
    )
    assert 0.0 < abs(levels[0] - levels[1]) <= sum(errors) and max(errors) < 1.0
    pairs = [
        (each.target_part().pillar_energy_share, each.target_part().pillar_energy_share_error) for each in (own, other)
    ]
    assert 0.0 < abs(pairs[0][0] - pairs[1][0]) <= pairs[0][1] + pairs[1][1] and pairs[0][1] < 0.1


def test_a_response_meets_the_accuracy_where_bare_panels_move_in_their_plane() -> None:
    """Their first fixed-interface mode in the plane lies little above nine times the band: half of such motion is its own."""
    changes = ["zone.length_mm=57.75", "zone.nodal_lines=4", "array.pitch_mm=6", "array.rows=1", "patches.sensors=[3]"]
    log, own = RecordingLog(), load_case(ROOT / "studies/three-rows.toml", changes)
    result = ask(own, Response(points=11), log)
    assert "ACCURACY" not in log.warnings and 0.0 < (result.expected_error or 1.0) <= own.solve.accuracy
