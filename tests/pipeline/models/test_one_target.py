"""Every command means the same mode of a plate, whatever band it was asked for."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from geometry.elements import FloatArray
from pipeline.case.model import Case, load_case
from pipeline.models import parts
from pipeline.models.forced import driven, forced_plate
from pipeline.models.modes import PartModes, solve_modes
from pipeline.planning import mesh_rules
from pipeline.planning.model_choice import Request, of_case
from pipeline.search.fidelity import PLATE, evaluate
from solvers.accuracy.reduction import MARGIN
from solvers.measures.target_mode import LEAD, weights
from solvers.piezo.forced import GroupModes
from solvers.plates.assembled import PlateModel
from tests.helpers.recording_log import RecordingLog

pytestmark = pytest.mark.usefixtures("coarsest_cells")
SMALL = Path(__file__).resolve().parents[3] / "examples" / "small.toml"
# length, width, thickness of the zone, nodal lines, pillar, pitch, margin, mm: most of the shape below the thin-plate window,
# within it, and shared
PLATES = (
    (20.3, 8.9, 1.56, 2, 3.22, 5.0, 2.6),
    (19.9, 12.1, 1.97, 2, 5.68, 4.9, 3.7),
    (25.2, 9.9, 1.78, 2, 4.38, 5.7, 4.3),
    (18.0, 10.4, 1.13, 3, 6.15, 4.4, 2.8),
)
ALL = [0, *(pytest.param(number, marks=pytest.mark.slow) for number in range(1, len(PLATES)))]
PATCHES = "patches={size_mm=[4.0,2.0,0.2],face='back',centres_mm=[[0.0,0.0]]}"
SPECK = "patches={size_mm=[0.5,0.5,0.05],face='back',centres_mm=[[0.0,0.0]]}"  # moves no frequency by more than 1e-4


def case(number: int, *more: str) -> Case:
    length, width, thickness, lines, height, pitch, margin = PLATES[number]
    sets = (
        f"zone.length_mm={length}", f"zone.width_mm={width}", f"zone.nodal_lines={lines}", f"plate.thickness_mm={thickness}",
        f"pillar.height_mm={height}", "pillar.side_mm=1.8", f"array.pitch_mm={pitch}", f"array.extension_mm={margin}",
        "solve.accuracy=0.05",
    )  # fmt: skip
    return load_case(str(SMALL), [*sets, *more])


@lru_cache
def plate_modes(number: int, low: float | None = None, high: float | None = None) -> PartModes:
    """Modes in a band given in parts of the zone's thin-plate frequency; without one, as a study asks."""
    own = case(number)
    zone_hz = mesh_rules.target_window_hz(own.design)[0] / mesh_rules.WINDOW[0]
    band = (
        Request("plate", (low * zone_hz, high * zone_hz), symmetry=own.target_symmetry)
        if low and high
        else of_case(own)
    )
    return solve_modes(own, band, RecordingLog())


@pytest.mark.slow
@pytest.mark.parametrize("number", ALL)
def test_the_target_is_the_same_from_every_band(number: int) -> None:
    ours = plate_modes(number).target
    assert ours and ours.row
    for band in ((0.6, 0.9), (0.9, 1.6), (1.2, 1.25)):
        theirs = plate_modes(number, *band).target
        assert theirs and theirs.row and theirs.status == ours.status
        assert theirs.row.frequency_hz == pytest.approx(ours.row.frequency_hz, rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("number", ALL)
def test_no_mode_of_the_plate_overturns_what_is_said(number: int) -> None:
    """Against every mode up to twice the zone's frequency, the target is the strongest of the shape, and single by LEAD."""
    ours, every = plate_modes(number).target, plate_modes(number, 0.05, 2.0).rows
    assert ours and ours.row
    carried = weights(every)
    low = mesh_rules.search_window_hz(case(number).design)[0]
    shaped = [i for i, row in enumerate(every) if row.frequency_hz >= low and (row.mac or 0.0) >= 0.5]
    best = max(shaped, key=lambda i: carried[i])
    assert every[best].frequency_hz == pytest.approx(ours.row.frequency_hz, rel=2e-3)
    if ours.status == "single":
        assert carried[best] >= LEAD * np.delete(carried, best).max()


@pytest.mark.slow
def test_a_driven_plate_has_one_target_in_every_band() -> None:
    """One model, two bands: they differ by how the bond's extrapolation mixes the modes solved, of second order."""
    own = case(0, PATCHES)
    low, high = mesh_rules.target_window_hz(own.design)
    model = parts.build(own, "plate", high, RecordingLog(), [])
    assert isinstance(model, PlateModel)
    within, beyond = (
        driven(own, model, band, RecordingLog()) for band in ((0.95 * low, 1.1 * low), (0.8 * high, high))
    )
    assert within.target_place() is not None and beyond.target_place() is None
    lowered = [_lowered(basis).max() for basis in within.modes if basis.bond]
    assert max(lowered) > 1e-4
    assert beyond.target_hz() == pytest.approx(within.target_hz(), rel=1e-5)
    assert within.verdict.status == beyond.verdict.status and np.array_equal(within.signs, beyond.signs)


def _lowered(basis: GroupModes) -> FloatArray:
    """How much the extrapolation of the bond moves each mode of the mesh as it is, relative."""
    modes = basis.columns[:, : len(basis.eigenvalue)]
    as_meshed = np.einsum("ij,ij->j", modes, basis.group.pencil.stiffness @ modes)
    return np.abs(as_meshed / basis.eigenvalue - 1.0)


@pytest.mark.slow
def test_modes_and_responses_mean_one_target_within_their_bars() -> None:
    own, ours = case(0, SPECK), plate_modes(0)
    low, high = mesh_rules.target_window_hz(own.design)
    assert ours.target and ours.target.row and ours.errors
    by_truncation = MARGIN * ours.errors[ours.target.row.symmetry].total[ours.target.row.column]  # one mesh serves both
    assert by_truncation > 0.0
    for band in ((0.95 * low, 1.1 * low), (0.8 * high, high)):
        plate = forced_plate(own, RecordingLog(), band)
        assert plate.verdict.status == ours.target.status
        assert plate.target_hz() == pytest.approx(ours.target.row.frequency_hz, rel=2.0 * by_truncation + 1e-4)


@pytest.mark.slow
def test_the_search_for_designs_means_the_mode_that_modes_means(tmp_path: Path) -> None:
    """However far from it the column's mode lies."""
    found = evaluate(case(0), PLATE, mesh_rules.target_window_hz(case(0).design)[1])
    ours = plate_modes(0).target
    assert ours and ours.row and found.frequency_hz == pytest.approx(ours.row.frequency_hz, rel=1e-3)
