"""A wave that travels in a small zone: the pair, its power, the six-channel table and the firmware's core playing it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from firmware.emulate.plant import BeamSimulation, Structure
from firmware.mode_table import from_bytes, to_bytes
from pipeline.board import six_channels
from pipeline.case.model import Case, case_from_dict
from pipeline.errors import InputError
from pipeline.logs import TerminalLog
from pipeline.models import travelling
from pipeline.models.answer_parts import PlayedPattern, ShearRecord
from pipeline.models.travelling import Travelling
from pipeline.questions.question import Run, ask
from pipeline.questions.travel import PlayedTravel, Travel, TravelResult
from solvers.driven.error_bars import Louder, mixings
from solvers.driven.several_patches import power_flow, strains_of
from solvers.errors import SolverError
from solvers.touch import effects
from solvers.touch.effects import FoldedLoads, crest_motion, folded_loads

QUIET = TerminalLog(quiet=True)
X_MM = (-46.0, -28.0, -10.0, 10.0, 28.0, 46.0, -55.0, -37.0, -19.0, 19.0, 37.0, 55.0)
STRIP: dict[str, Any] = {
    "name": "strip",
    "material": "aluminium",
    "plate": {"thickness_mm": 1.0},
    "zone": {"length_mm": 120.0, "width_mm": 8.0, "nodal_lines": 6},
    "array": {"rows": 0},
    "solve": {"accuracy": 0.1, "band_kHz": [3.0, 9.0]},
    "patches": {
        "size_mm": [8.0, 4.0, 0.3],
        "centres_mm": [[x, 0.0] for x in X_MM],
        "sensors": [6, 7, 8, 9, 10, 11],
    },
}


def case_of(**more: Any) -> Case:
    return case_from_dict(STRIP, overrides=[(key.replace("__", "."), value) for key, value in more.items()])


@pytest.fixture(scope="module")
def core() -> None:
    """The firmware's core compiled for this machine, or a skip with its reason."""
    pytest.importorskip("cffi", reason="cffi is not installed: pip install cffi")
    from firmware.host import NoCompiler, load

    try:
        load()
    except NoCompiler as missing:
        pytest.skip(str(missing))


@pytest.fixture(scope="module")
def solved(coarsest_cells: None) -> tuple[TravelResult, Travelling]:
    values, wave = travelling.solve_travelling(case_of(), QUIET, None, 0.0, [])
    return TravelResult(**values, others=0.0), wave


@pytest.mark.slow
def test_the_wave_travels_and_carries_what_its_losses_take(solved: tuple[TravelResult, Travelling]) -> None:
    """Power flows the way the phase turns, many times what patches in phase let through; all that comes in is lost."""
    record, _ = solved
    assert {mode.nodal_lines for mode in record.modes} <= {5, 6, 7} and record.wavenumber_per_m > 0.0
    assert record.modes[0].frequency_hz != record.modes[1].frequency_hz
    assert sum(record.patches_W) == pytest.approx(record.lost_W, rel=1e-9)
    flow = np.array(record.flow_W)
    assert flow.max() > 10.0 * np.abs(record.standing_flow_W).max() and flow.min() > -0.05 * flow.max()
    field = np.array(record.field_m) @ np.array([1.0, 1j])
    inside = (np.array(record.x_m) >= record.window_m[0] - 1e-9) & (np.array(record.x_m) <= record.window_m[1] + 1e-9)
    size = np.abs(field[inside])
    assert record.twr == pytest.approx(2.0 * size.min() / (size.max() + size.min()), rel=1e-6)
    assert record.twr <= record.best_twr + 1e-9


@pytest.mark.slow
def test_the_field_is_the_forced_plate_s_own(solved: tuple[TravelResult, Travelling]) -> None:
    """What the modal table says along the centre line against rms of the whole face, which the forced plate sums itself."""
    record, wave = solved
    plate = wave.forced.driven_by(wave.all_volts(wave.drives["pair+"]))
    curve = plate.curve(np.array([record.frequency_hz]))
    assert curve.zone_rms_m_per_v[0] * record.drive_V_at_1um == pytest.approx(1e-6, rel=1e-9)
    x = np.array(record.x_m)
    points, values = plate.shape(record.frequency_hz)
    line = np.abs(points[:, 1]) < 1e-3
    nearest = [int(np.argmin(np.hypot(*(points[line] - np.array([place, 0.0])).T))) for place in x]
    theirs = values[line][nearest] * record.drive_V_at_1um
    ours = np.array(record.field_m) @ np.array([1.0, 1j])
    assert np.abs(ours - theirs).max() < 0.1 * np.abs(ours).max()  # the nearest points are up to half a millimetre away


@pytest.mark.slow
def test_power_within_the_error_bars_follows_from_the_strains_of_the_plate_as_solved(
    solved: tuple[TravelResult, Travelling],
) -> None:
    """Two modes mixed by a large angle: the flow by strains integrated again, and by those of the plate as solved, turned."""
    record, wave = solved
    plate = wave.forced.driven_by(wave.all_volts(wave.drives["pair+"]))
    known = strains_of(plate)
    errors = [np.full(len(basis.eigenvalue), 0.02) for basis in plate.modes]
    (varied, _) = next(mixings(plate, errors, record.modes[0].frequency_hz, 1.0))
    other = varied.of(plate)
    anew, turned, not_turned = (
        power_flow(other, record.frequency_hz, strains).flow_w
        for strains in (None, dataclasses.replace(known, turned=varied.of_columns), known)
    )
    assert turned == pytest.approx(anew, abs=1e-9 * np.abs(anew).max())
    assert np.abs(not_turned - anew).max() > 1e-4 * np.abs(anew).max()


def test_backwards_is_the_mirror_image(solved: tuple[TravelResult, Travelling]) -> None:
    _, wave = solved
    forward, back = (wave.field(wave.drives[name])[wave.window[wave.line]] for name in ("pair+", "pair-"))
    slopes = [np.polyfit(np.arange(len(each)), np.unwrap(np.angle(each)), 1)[0] for each in (forward, back)]
    assert slopes[0] < 0.0 < slopes[1] and slopes[1] == pytest.approx(-slopes[0], rel=0.05)


def test_the_table_holds_t_and_what_each_pattern_shows(solved: tuple[TravelResult, Travelling], tmp_path: Path) -> None:
    record, wave = solved
    outcome = six_channels.board_outcome(wave, QUIET, tmp_path, played=False)
    assert outcome["tables"] == ["travelling_wave.bin", "travelling_wave.h"]
    table = from_bytes((tmp_path / "travelling_wave.bin").read_bytes())
    (shape,) = table.shapes
    assert shape.frequency_hz == pytest.approx(record.frequency_hz, rel=1e-6)
    matrix = np.array(shape.matrix)
    assert matrix == pytest.approx(_sampled(six_channels.structure(wave), record.frequency_hz), rel=1e-3)
    for pattern, volts in zip(shape.patterns, wave.drives.values(), strict=True):
        readings, target = matrix @ volts, np.array(pattern.targets)
        assert target * readings[np.argmax(np.abs(readings))] == pytest.approx(readings, rel=1e-5)


def test_the_table_s_metres_are_those_of_the_plate_as_solved(solved: tuple[TravelResult, Travelling]) -> None:
    """Rms along the centre line of the forced plate's own face per volt of the largest sensor: mean of the patterns."""
    record, wave = solved
    ratios = []
    for volts in wave.drives.values():
        points, motion = wave.forced.driven_by(wave.all_volts(volts)).shape(record.frequency_hz)
        inside = (np.abs(points[:, 1]) < 1e-3) & (np.abs(points[:, 0]) < record.window_m[1])
        ratios.append(np.sqrt(np.mean(np.abs(motion[inside]) ** 2)) / np.abs(wave.matrix @ volts).max())
    (shape,) = six_channels.table_of(wave).shapes
    assert shape.metres_per_volt == pytest.approx(np.prod(ratios) ** 0.25, rel=0.03)  # points as the mesh has them


def _sampled(plate: Structure, frequency_hz: float) -> np.ndarray:
    """T in the time domain: each drive alone a sampled tone until its start has decayed, then demodulated."""
    quiet = dataclasses.replace(plate, noise=0.0)
    settled, taken = int(20.0 * plate.slowest_s * plate.sample_rate_hz), 4000
    tone = np.exp(2j * np.pi * frequency_hz / plate.sample_rate_hz * np.arange(settled + taken))
    columns = []
    for drive in np.eye(6):
        simulation, heard = BeamSimulation(quiet), []
        for level in tone.real:
            heard.append(simulation.sense())
            simulation.drive(level * drive)
        base = np.column_stack([tone.real, -tone.imag])[settled:]
        fitted = np.linalg.lstsq(base, np.array(heard)[settled:], rcond=None)[0]
        columns.append(fitted[0] + 1j * fitted[1])
    return np.array(columns).T


def test_the_firmware_s_core_plays_the_wave(solved: tuple[TravelResult, Travelling], core: None) -> None:
    """The core of this machine, which the firmware's own tests compare with the image bit for bit; noise of 1e-3."""
    from tests.helpers.hosted_boards import HostedSix

    _, wave = solved
    board = HostedSix(to_bytes(six_channels.table_of(wave)), six_channels.structure(wave))
    board.run(5e-3)
    drives = []
    for pattern in range(2):
        function = board.lib.an_six_change if pattern else board.lib.an_six_start
        assert function(board.app, pattern, *(() if pattern else (0.0,))) == 1
        board.run(0.3)
        assert board.state == 2, hex(board.faults)
        drives.append(board.drives)
    forward, back = six_channels.patterns_of(
        dataclasses.replace(wave, drives=dict(list(wave.drives.items())[:2])), np.array(drives)
    )
    for each in (forward, back):
        assert each.twr == pytest.approx(each.twr_target, abs=0.05) and each.error < 0.05


def test_pictures_come_from_the_record_alone(solved: tuple[TravelResult, Travelling], tmp_path: Path) -> None:
    record, _ = solved
    assert TravelResult.from_document(record.to_dict()) == record
    assert "mW flow along the zone" in record.pictures()[0].alt
    record.as_figure().savefig(tmp_path / "travel.svg")
    assert (tmp_path / "travel.svg").stat().st_size > 1000


def fingered(
    record: TravelResult, wave: Travelling, drive: str = "pair+", varied: Any = (), **touch: Any
) -> ShearRecord:
    given = {"impedance": {}, "radius_mm": 2.5, "force_N": 1.0, "gap_um": [2.5, 4.0], **touch}
    case = case_from_dict({**STRIP, "touch": {key: value for key, value in given.items() if value is not None}})
    volts = wave.forced.signs.astype(complex) if drive == "standing" else wave.all_volts(wave.drives[drive])
    driven = travelling.Driven(record.drive_V_at_1um * volts, record.frequency_hz)
    shear_record = travelling.solve_shear(case, wave.forced, driven, record.wavenumber_per_m, QUIET, varied)
    assert shear_record is not None
    return shear_record


@pytest.fixture(scope="module")
def free(solved: tuple[TravelResult, Travelling]) -> Iterator[ShearRecord]:
    """The finger of nothing; what points of the free plate answer to forces knows of no finger, and is told once."""
    known: dict[bytes, list[FoldedLoads]] = {}

    def once(touched: Any, points_m: np.ndarray, frequency_hz: float) -> list[FoldedLoads]:
        key = points_m.tobytes() + np.float64(frequency_hz).tobytes()
        if key not in known:
            known[key] = folded_loads(touched, points_m, frequency_hz)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(effects, "folded_loads", once)
        yield fingered(*solved)


@pytest.mark.slow
def test_crests_run_as_the_outer_skin_of_the_plate_moves(
    solved: tuple[TravelResult, Travelling], free: ShearRecord
) -> None:
    """u_x and u_z of the skin that pictures draw, summed over the classes; (h/2) dw/dx alone misses what patches shift."""
    record, wave = solved
    tone, forced = record.frequency_hz, wave.forced.driven_by(wave.all_volts(wave.drives["pair+"]))
    eigenvalue = forced.plate.scale.eigenvalue(tone)
    skins = [
        (
            plate.skin(part[:, None].real).unfolded(plate.symmetry),
            plate.skin(part[:, None].imag).unfolded(plate.symmetry),
        )
        for basis in forced.modes
        for moved in [basis.columns @ basis.amplitudes(eigenvalue, forced.volts(eigenvalue))]
        for plate, part in zip(basis.group.plates, basis.group.split(moved), strict=True)
    ]
    points = skins[0][0].points
    motion = np.sum([real.displacement[0] + 1j * imaginary.displacement[0] for real, imaginary in skins], axis=0)
    face = (np.abs(points[:, 2]) < 1e-9) & (np.abs(points[:, 0]) < record.window_m[1]) & (np.abs(points[:, 1]) < 1e-9)
    exact = crest_motion(*record.drive_V_at_1um * motion[face][:, [0, 2]].T, tone).crest_m_s
    ours = RegularGridInterpolator((free.x_m, free.y_m), np.array(free.crest_m_s))(points[face, :2])
    assert face.sum() > 10 and np.abs(exact).max() > 1e-3
    assert ours == pytest.approx(exact, abs=0.03 * np.abs(exact).max())  # means over the contact: (k R)^2/8


@pytest.mark.slow
def test_the_drag_is_against_the_wave_and_none_of_a_standing_one(
    solved: tuple[TravelResult, Travelling], free: ShearRecord
) -> None:
    record, wave = solved
    inside = np.abs(np.array(free.x_m)) < record.window_m[1]
    forth, back, standing = (
        np.array(each.crest_m_s)[inside]
        for each in (free, fingered(record, wave, "pair-"), fingered(record, wave, "standing"))
    )
    assert np.median(forth) < 0.0 < np.median(back) and np.median(back) == pytest.approx(-np.median(forth), rel=0.1)
    assert np.abs(np.median(standing)) < 0.1 * np.abs(np.median(forth))


@pytest.mark.slow
def test_soft_and_hard_fingers_bound_the_net_shear(
    solved: tuple[TravelResult, Travelling], free: ShearRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No finger is dragged by nothing; one that nothing moves meets no crest; the low end is never above the high one."""
    record, wave = solved
    assert free.shear_low is not None and free.shear_high is not None
    assert all(each in (None, 0.0) for row in (*free.shear_low, *free.shear_high) for each in row)
    soft = fingered(record, wave, impedance={"stiffness_N_per_m": 1e3, "damping_Ns_per_m": 0.01})
    low, high = (np.array(each, dtype=float) for each in (soft.shear_low, soft.shear_high))
    known = np.isfinite(low) & np.isfinite(high)
    assert known.any() and (np.abs(low) <= np.abs(high) + 1e-12)[known].all() and np.nanmax(np.abs(high)) <= 1.0
    assert (np.sign(high[known]) == np.sign(np.array(soft.crest_m_s)[known])).all()
    # whatever the points of its contact are, a rigid finger holds them
    monkeypatch.setattr(effects, "SPAN", (2, 2))
    rigid = fingered(record, wave, impedance={"stiffness_N_per_m": 1e9})
    assert np.median(rigid.touched_m) < 1e-2 * np.median(free.touched_m)
    wave, felt = dataclasses.replace(record, shear=soft).pictures()
    assert felt.name == "shear" and "mm/s along x" in felt.alt


@pytest.mark.slow
@pytest.mark.usefixtures("free")
def test_the_largest_shear_has_a_bar_of_other_plates_and_drives(
    solved: tuple[TravelResult, Travelling], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Drives louder by a tenth raise the crest by as much; the same drive again by what the contact misses, and no more."""
    record, wave = solved
    monkeypatch.setattr(travelling, "missing_at_ends", lambda places: 1e-9)
    volts = record.drive_V_at_1um * wave.all_volts(wave.drives["pair+"])
    at = {"impedance": {"stiffness_N_per_m": 1e3, "damping_Ns_per_m": 0.01}}
    same, loud = (
        fingered(record, wave, varied=[(travelling.Driven(factor * volts, record.frequency_hz, Louder(1.0)),)], **at)
        for factor in (1.0, 1.1)
    )
    low, high = (getattr(same, f"shear_{end}_error") for end in ("low", "high"))
    assert same.fastest_error_m_s is not None and low is not None and high is not None
    assert 0.0 < same.fastest_error_m_s < 0.02 * abs(same.fastest_m_s) and 0.0 < low < 0.02 and 0.0 < high < 0.02
    more = (loud.fastest_error_m_s or 0.0) - same.fastest_error_m_s
    assert more == pytest.approx(0.1 * abs(same.fastest_m_s), rel=1e-6)
    assert (loud.shear_high_error or 0.0) > high


@pytest.mark.slow
@pytest.mark.usefixtures("free")
def test_shear_that_cannot_be_told_says_why(solved: tuple[TravelResult, Travelling]) -> None:
    record, wave = solved
    bare = fingered(record, wave, force_N=None, gap_um=None)
    assert bare.shear_low is None and bare.unknown == ["net shear: touch.gap_um and touch.force_N are not given"]
    wide = fingered(dataclasses.replace(record, wavenumber_per_m=1.1e3), wave)
    assert wide.shear_high is None and "5 mm wide, more than the half-wavelength of 2.86 mm" in wide.unknown[0]
    afloat = fingered(record, wave, gap_um=[0.8, 3.0])
    assert any("net shear: at some places" in reason for reason in afloat.unknown)


def test_what_cannot_be_is_one_line(solved: tuple[TravelResult, Travelling]) -> None:
    for change, said in (
        ({"zone__nodal_lines": 1}, "rigid shapes cannot form a travelling wave"),
        ({"patches__circuit": "open"}, "must be 'short'"),
        ({"patches__sensors": []}, "12 drive and 0 are sensors"),
    ):
        with pytest.raises(InputError, match=said) as refused:
            ask(case_of(**change), Travel(), QUIET)
        assert len(refused.value.lines) == 1
    _, wave = solved
    with pytest.raises(SolverError, match="does not contain the target mode and a neighbour"):
        travelling.best_pair(wave.forced, dataclasses.replace(case_of().design, nodal_lines=20), 0.0)
    sensors = np.pad(wave.table.sensors, ((0, 0), (0, 1)))
    seven = dataclasses.replace(wave, table=dataclasses.replace(wave.table, sensors=sensors, sensor_residual=None))
    with pytest.raises(InputError, match="6 actuators and 7 sensors, must be at most 6"):
        six_channels.board_outcome(seven, QUIET, None, played=True)
    assert six_channels.board_outcome(seven, QUIET, None, played=False) == {}


def test_a_flow_that_no_inner_section_shows_is_said(solved: tuple[TravelResult, Travelling]) -> None:
    """Where patches straddle all sections but the plate's ends, 0 there by balance is no flow."""
    record, _ = solved
    assert record.inner_sections == len(record.flow_x_m) - 2 > 0
    none = dataclasses.replace(record, inner_sections=0)
    assert any("patches straddle every section between the plate's ends" in line for line in none.lines())
    assert not any("mW flow through" in line for line in none.lines())
    assert any("mW flow through" in line for line in record.lines())
    assert "flow is unknown" in none.pictures()[0].alt


def test_the_board_is_a_question_of_its_own(
    solved: tuple[TravelResult, Travelling], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its plan has a step more; what it played stands in the answer, and the table goes where files go."""
    record, wave = solved
    steps = [[step.name for step in kind().plan(case_of()).steps] for kind in (Travel, PlayedTravel)]
    assert steps[1][:1] == steps[0] and "emulated board" in steps[1][1]
    values = {name: getattr(record, name) for name in record.declared if name not in ("others", "board", "tables")}
    monkeypatch.setattr(travelling, "solve_travelling", lambda *given: (values, wave))
    pattern = PlayedPattern(name="pair+", twr=0.9, twr_target=0.91, error=0.01)
    monkeypatch.setattr(six_channels, "_played", lambda *given: [pattern])
    plain, on_board = (ask(case_of(), kind(), Run(QUIET, folder=tmp_path)) for kind in (Travel, PlayedTravel))
    assert plain.board is None and on_board.board == [pattern] and "emulated board, pair+" in [*on_board.lines()][-1]
    assert {path.name for path in tmp_path.iterdir()} == {*plain.tables} == {"travelling_wave.bin", "travelling_wave.h"}
