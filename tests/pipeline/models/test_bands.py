"""The bands of a case: what the JSON holds, which route leaves out what, and a reduction that is judged and raised."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from geometry.hex.scenes import HexSettings
from pipeline.case.model import Case, load_case
from pipeline.errors import InputError
from pipeline.models import attenuation, bands, unit_cell
from pipeline.models.bands import SolvedBands
from pipeline.models.unit_cell import WholeCell
from pipeline.planning import mesh_rules
from pipeline.planning.model_choice import cell_model_choice
from pipeline.plots import style
from pipeline.questions.attenuation import Attenuation
from pipeline.questions.bands import Bands, BandsResult
from pipeline.questions.question import Run
from pipeline.questions.study import answer
from pipeline.report import gallery
from solvers.superelement.interface import Interface, ReductionSettings
from solvers.waves.gaps import BrillouinZoneGap, Gap
from tests.helpers import coarse_cells, synthetic
from tests.helpers.asked import bands_of, solve_bands
from tests.helpers.recording_log import RecordingLog

CASE = Path(__file__).resolve().parents[3] / "studies" / "three-rows.toml"


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every cell on the coarsest mesh: what is looked at here does not depend on it."""
    coarse_cells.put_in(monkeypatch, coarse_cells.COARSEST)


def case(*settings: str) -> Case:
    return load_case(CASE, ["solve.accuracy=0.02", *settings])


def solved(*settings: str) -> tuple[SolvedBands, RecordingLog]:
    log = RecordingLog()
    return solve_bands(case(*settings), log), log


@pytest.mark.slow
def test_points_tell_polarisation_parity_branch_and_group_velocity(monkeypatch: pytest.MonkeyPatch) -> None:
    coarse_cells.put_in(monkeypatch)  # a mesh that tells its own error
    result, log = solved("bands.points=6", "bands.count=8")
    document = json.loads(json.dumps(BandsResult.of_solved(result).to_dict(), allow_nan=False))
    assert [p["label"] for p in document["points"] if p["label"]] == ["G", "X", "M", "G"] and len(
        document["points"]
    ) == 19
    for point in document["points"]:
        lengths = {key: len(value) for key, value in point.items() if isinstance(value, list)}
        assert set(lengths.values()) == {8} and set(lengths) >= {
            "polarisation",
            "branch",
            "group_velocity_m_s",
            "parity",
        }
        assert set(point["polarisation"]) <= {"flexural", "shear", "longitudinal", "pillar"}
        assert set(point["plate_polarisation"]) <= {"flexural", "shear", "longitudinal"}
        assert point["frequencies_hz"] == sorted(point["frequencies_hz"])
    assert document["points"][0]["group_velocity_m_s"][:3] == [None] * 3
    assert document["points"][0]["plate_polarisation"][:3] == ["flexural", "shear", "longitudinal"]
    assert all(mark in ("yS", "yA") for mark in document["points"][3]["parity"])
    assert document["zone_gaps"] is None and "wavevectors off the path" in log.omitted
    assert document["reduction_error"] < 0.02 and "REDUCTION" not in log.warnings
    bars = np.array([point["error"] for point in document["points"]])
    assert result.by_mesh.max() == pytest.approx(document["expected_error"]) and np.ptp(result.by_mesh) > 0.0
    assert np.allclose(bars, result.by_mesh + result.truncated) and bars.min() >= 0.0
    assert np.max(result.truncated) == document["reduction_error"] > 3.0 * np.median(result.truncated)
    best, computed = (
        np.array([point[key] for point in document["points"]]) for key in ("frequencies_hz", "computed_hz")
    )
    moving = best > 1.0
    assert (computed[moving] > best[moving]).all()  # a mesh is too stiff, and what it is too stiff by is taken away
    assert (computed[moving] < best[moving] * 1.04).all() and (computed[~moving] == best[~moving]).all()
    assert {"start", "end", "lower_band", "upper_hz"} <= set(document["directional_gaps"][0])
    edges = {"lower_hz", "upper_hz", "lower_error", "upper_error"}
    assert {"polarisation", *edges} == set(document["polarisation_gaps"][0])
    assert len(json.dumps(document)) < 19 * 8 * 200


@pytest.mark.slow
def test_the_group_velocity_of_a_point_is_the_slope_of_its_band() -> None:
    result, _ = solved("bands.points=40", "bands.count=4", "bands.path=GX")
    assert result.detail
    k, hz = result.path.wavevectors[:, 0], result.frequencies_hz[:, 0]
    slope = 2.0 * np.pi * np.gradient(hz, k)[2:-2]
    assert np.abs(result.detail.velocity[2:-2, 0, 0] - slope).max() < 0.05 * np.abs(slope).max()
    assert np.abs(result.detail.velocity[1:-1, :, 1]).max() < 1e-3 * np.abs(slope).max()  # along the line by symmetry


@pytest.mark.slow
def test_a_coarse_path_finds_the_edges_of_a_fine_one() -> None:
    coarse_path, _ = solved("bands.points=3", "bands.count=8", "bands.path=GXMYG", "array.pitch_x_mm=3")
    fine, _ = solved("bands.points=12", "bands.count=8", "bands.path=GXMYG", "array.pitch_x_mm=3")
    assert len(coarse_path.gaps) == len(fine.gaps) > 0
    for one, two in zip(coarse_path.gaps, fine.gaps, strict=True):
        assert (one.lower_hz, one.upper_hz) == pytest.approx((two.lower_hz, two.upper_hz), rel=1e-6)
    assert coarse_path.frequencies_hz.shape == (13, 8)
    assert coarse_path.frequencies_hz[::3] == pytest.approx(fine.frequencies_hz[::12], rel=1e-9, abs=1e-3)


@pytest.mark.slow
def test_the_full_cell_gives_frequencies_only_and_says_so() -> None:
    result, log = solved("solve.model=solid", "bands.points=1", "bands.count=7", "bands.grid=1")
    document = BandsResult.of_solved(result).to_dict()
    known = {name for name, value in document["points"][0].items() if value is not None}
    assert known == {"label", "kx_per_m", "ky_per_m", "frequencies_hz", "computed_hz", "error"}
    assert (
        document["reduction_error"] is None
        and "polarisation, branches, group velocity and quality factors" in log.omitted
    )
    reduced, _ = solved("bands.points=1", "bands.count=7")
    assert document["zone_gaps"][0]["lower_hz"] == pytest.approx(reduced.gaps[0].lower_hz, rel=0.01)


@pytest.mark.slow
def test_the_full_cell_keeps_what_its_mesh_said_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the lowest bands: those that change places with bands not asked for may be others."""
    settings = HexSettings(2, 4e-3, 1, 0.15)
    monkeypatch.setattr(mesh_rules, "cell_settings", lambda design, accuracy: settings)
    monkeypatch.setattr(mesh_rules, "finer_cell_level", lambda level: None)
    result, _ = solved("solve.model=solid", "bands.points=1", "bands.count=6", "bands.path=GM")
    design, at_m = case().design, result.path.wavevectors[1]
    whole = WholeCell.of(design, settings).own.frequencies(at_m, 6)
    assert np.sort(result.computed_hz[1])[:3] == pytest.approx(whole[:3], rel=1e-9)
    assert (result.frequencies_hz[1, :3] < (1.0 - 1e-4) * whole[:3]).all()


@pytest.mark.slow
def test_a_grid_checks_the_gaps_over_the_zone() -> None:
    result, log = solved("bands.points=4", "bands.count=8", "bands.grid=6")
    assert result.zone_gaps and "ZONE" not in log.warnings
    for along, whole in zip(result.gaps, result.zone_gaps, strict=True):
        assert (along.lower_hz, along.upper_hz) == pytest.approx((whole.lower_hz, whole.upper_hz), rel=1e-6)
    assert any("holds in the whole Brillouin zone" in fact for fact in log.facts)
    assert "wavevectors off the path" not in log.omitted


def test_an_edge_off_the_path_and_a_gap_that_closes_are_alarms() -> None:
    log, along = RecordingLog(), [Gap(6, 7, 160e3, 170e3)]
    bands._log_zone(along, [BrillouinZoneGap(6, 7, 161e3, 170e3, (300.0, 200.0), (0.0, 0.0))], log)
    assert "lower edge at 161.0000 kHz, k = (300, 200) rad/m, off the path" in log.warnings["ZONE"]
    assert "upper" not in log.warnings["ZONE"] and not log.facts
    bands._log_zone(along, [], log)
    assert "waves off the path close it" in log.warnings["ZONE"]


@pytest.mark.parametrize("value", ["-1", "1.5", "201", "true"])
def test_a_grid_that_is_no_count_of_intervals_is_refused(value: str) -> None:
    with pytest.raises(InputError, match=r"bands\.grid.*whole number from 0"):
        case(f"bands.grid={value}")


def poor(accuracy: float) -> ReductionSettings:
    """Degrees and modes that are too few on purpose."""
    return ReductionSettings(Interface(2, 3), 3e5, coarse_cells.COARSEST)


@pytest.mark.slow
def test_a_coarse_cell_holds_every_degree_that_is_tried() -> None:
    """Stiff pillars that fill a soft plate ask for degree 6 through its thickness, and the next one tells what is left."""
    design = case("plate.thickness_mm=3", "array.pitch_mm=3.5").design
    pilot, settings = unit_cell._coarse_pilot(design, 8), ReductionSettings(Interface(4, 3), 3e5, coarse_cells.COARSEST)
    for through in (3, unit_cell.MAX_THROUGH, unit_cell.MAX_THROUGH + 1):
        thicker = replace(settings, interface=Interface(4, through))
        assert pilot.is_thick and pilot.lattice(thicker).cell.interface == Interface(4, through)


@pytest.mark.slow
def test_a_reduction_too_poor_for_the_accuracy_is_raised_and_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_rules, "lattice_reduction", lambda design, accuracy, *most_hz: poor(accuracy))
    result, log = solved("bands.points=1", "bands.count=8")
    assert result.detail and result.detail.reduction_error < 0.02 and "REDUCTION" not in log.warnings
    assert any(
        "degree" in fact and "instead of 2" in fact and "fixed-interface modes up to" in fact for fact in log.facts
    )
    whole, _ = solved("solve.model=solid", "bands.points=1", "bands.count=8")
    moving = whole.frequencies_hz > 10.0
    assert (result.frequencies_hz[moving] / whole.frequencies_hz[moving] - 1.0).max() < 0.02


@pytest.mark.slow
def test_a_reduction_that_cannot_be_raised_enough_is_an_alarm(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh_rules, "lattice_reduction", lambda design, accuracy, *most_hz: poor(accuracy))
    monkeypatch.setattr(unit_cell, "MAX_DOF", 10)
    result, log = solved("bands.points=1", "bands.count=8")
    assert result.detail and result.detail.reduction_error > 0.02
    assert "lower bands.count (8), raise solve.accuracy, or set solve.model = 'solid'" in log.warnings["REDUCTION"]


SOFT = "pillar.material={young_GPa=0.7,density_kg_m3=1000.0,poisson=0.4}"


@pytest.mark.slow
def test_slow_pillars_keep_the_modes_that_the_bands_asked_for_need() -> None:
    """The plate's shear waves would keep those up to 1.2 MHz, hundreds of them; a decay at higher frequencies keeps more."""
    result, log = solved(SOFT, "bands.points=1", "bands.count=8")
    assert result.detail and result.dof < 260 and "MANY_FUNCTIONS" not in log.warnings
    whole, _ = solved(SOFT, "solve.model=solid", "bands.points=1", "bands.count=8")
    moving = whole.frequencies_hz > 10.0
    rise = (result.computed_hz[moving] / whole.frequencies_hz[moving] - 1.0).max()
    assert rise <= result.detail.reduction_error < 0.02
    tops = [cell_model_choice(case(SOFT), high).reduction.top_hz for high in (0.0, 1e5)]  # type: ignore[union-attr]
    twice = ["array.stagger=true", "bands.count=20"]  # as many bands a pillar: its cell has two
    wide = [cell_model_choice(case(SOFT, "array.pitch_mm=6", *more)) for more in (["bands.count=10"], twice)]
    assert wide[1].reduction.top_hz > 1.2 * wide[0].reduction.top_hz  # type: ignore[union-attr]  # nothing would tell what it lacks
    assert tops[1] == 9e5 > tops[0] and cell_model_choice(case()).reduction.top_hz > tops[1]  # type: ignore[union-attr]


@cache
def made() -> BandsResult:
    log = RecordingLog()
    return bands_of(replace(case("bands.points=4", "bands.count=8")), log)


@pytest.mark.slow
def test_the_picture_marks_every_wave_by_its_polarisation(tmp_path: Path) -> None:
    stored = synthetic.case("cell", bands=made(), design=synthetic.design(1, 4e-3, 5e-3))
    with style.style():
        report_figure = gallery.dispersion(stored, {})
    assert report_figure
    axes = report_figure.figure.axes[0]
    marks = [line for line in axes.lines if line.get_marker() in ("o", "s", "^")]
    assert sum(len(np.atleast_1d(line.get_xdata())) for line in marks) == 13 * 8  # every band at every point, once
    names = {str(line.get_label()).split(",")[0] for line in marks}
    assert names == {"flexural", "shear", "longitudinal"}
    assert len({(line.get_color(), line.get_marker(), line.get_markerfacecolor()) for line in marks}) == len(marks)
    assert "waves are marked as flexural, shear, longitudinal" in report_figure.alt


@pytest.mark.slow
def test_what_only_documents_tell_is_not_computed_for_a_study(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither gaps of one direction or polarisation, nor the attenuation's own cell beside that of the bands."""

    def refused(*_: object) -> None:
        raise AssertionError("computed for nobody")

    scene, log = case("bands.points=2", "bands.count=6"), RecordingLog()
    monkeypatch.setattr(bands, "polarisation_gaps", refused)
    monkeypatch.setattr(bands, "directional_gaps", refused)
    monkeypatch.setattr(attenuation, "lattice_model", refused)
    run = Run(log, detailed=False)
    for question in (Bands(), Attenuation.in_study()):
        answer(question, scene, run)
    record = run.found["bands"].to_dict()
    assert record["points"][0]["plate_polarisation"]
    assert record["polarisation_gaps"] is None and record["directional_gaps"] is None
    assert run.found["attenuation"].model == record["model"]
