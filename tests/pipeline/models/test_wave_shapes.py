"""Shapes of Bloch waves as a page shows them, against the waves of the lattice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipeline.case.model import load_case
from pipeline.models.bands import SolvedBands
from tests.helpers import coarse_cells
from tests.helpers.asked import solve_bands
from tests.helpers.recording_log import RecordingLog

CASE = Path(__file__).resolve().parents[3] / "studies" / "three-rows.toml"


@pytest.fixture(scope="module")
def result() -> SolvedBands:
    with pytest.MonkeyPatch.context() as patch:
        coarse_cells.put_in(patch, coarse_cells.COARSEST)
        case = load_case(CASE, ["solve.accuracy=0.05", "bands.points=2", "bands.count=6"])
        return solve_bands(case, RecordingLog(), shapes=True)


@pytest.mark.slow
def test_every_label_has_its_lowest_bands(result: SolvedBands) -> None:
    shapes = result.shapes
    assert shapes["bands_labels"].tolist() == ["G", "X", "M"]
    assert shapes["bands_u"].shape == (3, 6, 2, len(shapes["bands_points"]), 3)
    assert shapes["bands_quads"].max() == len(shapes["bands_points"]) - 1
    size = np.hypot(*np.moveaxis(shapes["bands_u"].astype(float), 2, 0))
    np.testing.assert_allclose(size.max(axis=(2, 3)), 1.0, atol=2e-3)


def test_the_waves_at_rest_are_translations(result: SolvedBands) -> None:
    """At k = 0 the three lowest waves move the whole cell as one."""
    u = result.shapes["bands_u"].astype(float)
    translations, moving = u[0, :3, 0], u[0, 3, 0]
    assert np.ptp(translations, axis=1).max() < 5e-3 and np.ptp(moving, axis=0).max() > 0.5


def test_opposite_sides_move_alike_or_against_each_other(result: SolvedBands) -> None:
    """u(r + a) = u(r) exp(i k.a): the same at G, opposite along x at X, opposite along both at M."""
    shapes = result.shapes
    points, u = shapes["bands_points"].astype(float), shapes["bands_u"].astype(float)
    middle = [0.5 * (points[:, axis].min() + points[:, axis].max()) for axis in (0, 1)]
    corner = {}
    for sx, sy in ((-1, -1), (1, -1), (-1, 1)):
        away = np.linalg.norm(points - [middle[0] + sx * 2e-3, middle[1] + sy * 2e-3, 0.0], axis=1)
        corner[sx, sy] = int(away.argmin())
        assert away.min() < 1e-8
    for row, (along_x, along_y) in enumerate(((1, 1), (-1, 1), (-1, -1))):
        for wave in u[row]:
            left, right, back = (wave[:, corner[key]] for key in ((-1, -1), (1, -1), (-1, 1)))
            np.testing.assert_allclose(right, along_x * left, atol=4e-3)
            np.testing.assert_allclose(back, along_y * left, atol=4e-3)


@pytest.mark.slow
def test_shapes_are_made_only_when_asked_for() -> None:
    with pytest.MonkeyPatch.context() as patch:
        coarse_cells.put_in(patch, coarse_cells.COARSEST)
        case = load_case(CASE, ["solve.accuracy=0.05", "bands.points=1", "bands.count=4"])
        assert solve_bands(case, RecordingLog()).shapes == {}
