"""Staggered rows, and rows of unequal pitches, in the explorer: against plates and bands that are assembled otherwise."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from pipeline.case.model import load_case
from pipeline.explore import answer
from pipeline.explore.answer import Explorer, compute
from pipeline.logs import WarningLog
from pipeline.models.live_column import (
    FACE,
    INNER,
    LiveCell,
    LivePlate,
    LiveReductions,
    boundary_error,
    end_layer,
)
from pipeline.models.parametric import sizes_of
from pipeline.planning import mesh_rules
from pipeline.questions.question import ask
from pipeline.questions.tolerance import AlikeTolerance
from solvers.fem.eigen import modes_in_band
from solvers.measures.confinement import measure, target_symmetry
from solvers.parametric.affine import DesignBox
from solvers.parametric.bare import bare_cell
from solvers.plates.assembled import PlateModel
from solvers.superelement.lattice import Periodic
from solvers.waves.complex_bands import Row
from studies.live import BesidePlate
from tests.helpers.exploring import OFFLINE, SMALL, small_explorer
from tests.helpers.recording_log import RecordingLog
from tests.pipeline.explore.test_explore import coarse_error

STAGGERED = ("array.stagger=true", "array.pitch_x_mm=6", "array.pitch_y_mm=4", "array.rows=2")
WIDE = replace(OFFLINE, box=DesignBox((1.8e-3, 6e-3, 1.8e-3, 5.5e-3), (2.2e-3, 7e-3, 2.2e-3, 7e-3)))
SYMMETRY = target_symmetry(4)  # of examples/small.toml
CHANGES: tuple[dict[str, float], ...] = (
    {},
    {"rows": 1.0, "pitch": 5.6},
    {"rows": 3.0, "extension": 8.0, "height": 6.6},
)


@pytest.fixture(scope="module")
def explorer(tmp_path_factory: pytest.TempPathFactory) -> Explorer:
    return small_explorer(tmp_path_factory.mktemp("cells"), *STAGGERED, offline=WIDE)


@pytest.mark.slow
def test_one_slider_carries_both_pitches(explorer: Explorer) -> None:
    own = explorer.scene.own() | {"pitch": 6.6}
    design = explorer.scene.at(own).design
    assert design.stagger and (design.pitch_x_m, design.pitch_y_m) == pytest.approx((6.6e-3, 4.4e-3))
    assert tomllib.loads(explorer.scene.toml(own))["array"]["pitch_y_mm"] == pytest.approx(4.4)
    assert explorer.scene.document()["corners"]["Y"] == pytest.approx([0.0, 1.5])


@pytest.mark.slow
def test_a_pillar_wider_than_half_a_pitch_holds_is_refused(explorer: Explorer) -> None:
    (text,) = explorer.model.cell.box.faults((2e-3, 6.5e-3, 2.4e-3, 5.6e-3))[1:]
    assert "does not fit pitch = 5.6 mm" in text and "a panel 0.5 pitches wide" in text


@pytest.mark.slow
def test_bands_and_decay_are_those_of_the_lattice(explorer: Explorer) -> None:
    """The decay at a frequency that a real wavenumber across the rows has is none; bands at every labelled wavevector."""
    given = explorer.scene.own() | {"height": 6.6, "pitch": 6.2}
    case, answer = explorer.scene.at(given), explorer.answer(given)
    sizes = sizes_of(case.design)
    cell = explorer.model.cell.at(sizes, INNER)
    bare = bare_cell(cell.size_m, case.design.stack.material, cell.interface)
    row, found = Periodic([cell, bare], 1), answer["bands"]
    at = [number for number, label in enumerate(found["labels"]) if label]
    assert [found["labels"][number] for number in at] == ["G", "X", "S", "X1", "Y", "G"]
    places = case.design.lattice.high_symmetry
    for number in at:
        target = row.frequencies(places[found["labels"][number]], 10)
        ours = np.array(explorer.model.bases.fractions[number]) * np.pi / sizes[3]
        assert ours == pytest.approx(places[found["labels"][number]], abs=1e-6)
        moving = target > 1e-3 * target[-1]
        assert np.array(found["frequency_hz"][number])[moving] == pytest.approx(target[moving], rel=0.01)
    live = explorer._live.row(sizes, case.design.stack.material)
    assert live.cells[0].interface == FACE and live.shift == 1
    kx = case.target_kx_per_m
    (flexural_hz,) = live.frequencies(np.array([kx, 0.4 * np.pi / case.design.pitch_y_m]), 4)[2:3]
    assert np.abs(Row(live, kx).waves(float(flexural_hz)).db_per_row).min() < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("change", [{}, {"rows": 3.0, "extension": 8.0, "height": 6.6}])
def test_the_live_plate_is_the_plate_assembled_of_the_same_cells(explorer: Explorer, change: dict[str, float]) -> None:
    """What waves of one column leave out of two free ends lies within the bar."""
    case = explorer.scene.at(explorer.scene.own() | change)
    design, window = case.design, mesh_rules.target_window_hz(case.design)
    plate, live = explorer.plate(case), LiveCell(explorer.model.cell)
    whole, error = PlateModel(design, LiveReductions(live, design, {}, window[1])), boundary_error(design)
    near = plate["frequency_hz"] * np.array([1.0 - error, 1.0 + error])
    modes = modes_in_band(whole.pencil(SYMMETRY), *near)
    found = measure(whole.touch(SYMMETRY, modes.vectors), design, SYMMETRY)
    at = int(np.argmax(found.strength))
    assert found.mac[at] == pytest.approx(plate["mac"], abs=0.05) and found.strength[at] > 0.1
    assert plate["frequency_hz"] == pytest.approx(modes.frequency_hz[at], rel=end_layer(design) / 2.0 + 0.01)
    assert plate["confinement_db"] == pytest.approx(found.confinement_db[at], abs=2.5)


@pytest.mark.slow
@pytest.mark.parametrize(("rows", "extension"), [(1.0, 5.0), (2.0, 1.2)])
def test_a_live_plate_is_measured_over_its_whole_touch_face(explorer: Explorer, rows: float, extension: float) -> None:
    """Half the zone and half the passive face, whether ends of the plate cut columns of cells or reach beyond them."""
    for pitch in (5.6, 6.5):
        case = explorer.scene.at(explorer.scene.own() | {"rows": rows, "extension": extension, "pitch": pitch})
        design, live = case.design, LiveCell(explorer.model.cell)
        zone, passive, beyond = LivePlate(case, live, {}, mesh_rules.target_window_hz(design)).plate.faces.areas
        assert zone == pytest.approx(design.length_m * design.width_m / 2.0)
        assert passive == pytest.approx(design.length_m * (design.half_span_m - design.width_m / 2.0))
        assert beyond == pytest.approx(design.length_m * extension * 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("change", [{"rows": 0.0}, {"extension": 0.0}, {"extension": 0.5, "rows": 3.0}])
def test_the_ends_of_the_sliders_answer(explorer: Explorer, change: dict[str, float]) -> None:
    case = explorer.scene.at(explorer.scene.own() | change)
    plate = explorer.plate(case)
    assert plate["frequency_hz"] > 0.0
    assert explorer.estimate(case)["frequency_hz"] == pytest.approx(plate["frequency_hz"], rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("change", CHANGES)
def test_the_live_plate_lies_within_its_bars(explorer: Explorer, change: dict[str, float]) -> None:
    """Against the assembled plate, which has meshes and degrees of its own, and a bar."""
    given = explorer.scene.own() | change
    case = explorer.scene.at(given)
    live = explorer.plate(case, coarse_error(explorer, case))
    assert BesidePlate.of(live, compute(explorer.scene, given, WarningLog())).within


@pytest.mark.slow
def test_plates_of_a_batch_are_designs_of_the_page(explorer: Explorer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(answer, "cell_model", lambda case, log: explorer.model)
    settings = (*STAGGERED, "tolerance.height_mm=0.04", "tolerance.samples=2")
    record = ask(load_case(SMALL, list(settings)), AlikeTolerance(), RecordingLog())
    nominal = explorer.answer(explorer.scene.own())["plate"]
    assert (record.nominal.peak_hz, record.frequency_error) == (nominal["frequency_hz"], nominal["frequency_error"])
    assert len({one.peak_hz for one in record.samples}) == 2
