"""The shaping study: its document, its comparison with the thesis, and its figures found again by another road."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipeline.active.thesis import beside, shaping
from pipeline.records.part import plain
from solvers.errors import SolverError
from solvers.shaping.modal_table import conditioning, field_matrix, sensor_matrix
from solvers.shaping.voltages import REGIONS, contrast, region_points
from solvers.thesis.shaped_beam import PatchedBeam, beam_table, point_beam_table
from solvers.thesis.shaping_study import ShapingData, shaping_study
from solvers.thesis.shaping_study import document as document_of


@pytest.fixture(scope="module")
def study():
    return shaping_study(replace(ShapingData(), errors=replace(ShapingData().errors, trials=30)))


@pytest.fixture(scope="module")
def document(study):
    return plain(document_of(study)) | {"comparison": beside("shaping", shaping(study))}


def entry_of(document, words: str) -> dict[str, str]:
    return next(one for one in document["comparison"] if all(word in one["quantity"] for word in words.split("|")))


@pytest.mark.slow
def test_document_states_what_was_chosen_and_every_quantity_of_the_text(document):
    assert len(document["assumptions"]) >= 5
    long = document["beams"][0]
    assert long["material"] == "steel" and long["quality_factor"] == 50.0 and len(long["centres_m"]) == 6
    quantities = " ".join(entry["quantity"] for entry in document["comparison"])
    for target in (
        "confined left",
        "confined middle",
        "confined right",
        "coupling at 2.2 kHz",
        "coupling at 2.4 kHz",
        "best TWR",
    ):
        assert target in quantities
    assert all(entry["ours"] and entry["agreement"] for entry in document["comparison"])
    assert {one["signal"] for one in document["conditioning"]} == {"calibrated", "displacement"}


@pytest.mark.slow
def test_mode_shapes_have_the_antinodes_the_text_misplaces(study, document):
    for beam in document["beams"]:
        assert beam["antinodes"] == list(range(1, 9))
    bare = document["beams"][0]["bare_modes_hz"]
    assert (bare[3], bare[5]) == (pytest.approx(2111, abs=1), pytest.approx(4404, abs=1))
    assert entry_of(document, "six antinodes")["agreement"].startswith("differs")


@pytest.mark.slow
def test_confinement_on_the_simulated_beam_found_again(study):
    """The 100 mm beam with point forces: invert, sum the modes, compare maxima, all written out."""
    frequency, beam = 2400.0, study.data.short
    x = np.linspace(0.0, 0.1, 301)
    table = point_beam_table(beam, 20, points_m=x)
    for region, chosen in zip(REGIONS, ([0, 1], [2, 3], [4, 5]), strict=True):
        target = np.zeros(6)
        target[chosen] = 1.0
        wave = np.abs(field_matrix(table, frequency) @ np.linalg.solve(sensor_matrix(table, frequency), target))
        inside = (x >= 0.1 / 3 * REGIONS.index(region) - 1e-12) & (x <= 0.1 / 3 * (REGIONS.index(region) + 1) + 1e-12)
        result = study.confinement("100 mm, points", "displacement", frequency, region, "in phase")
        assert result.peak_ratio == pytest.approx(wave[inside].max() / wave[~inside].max(), rel=1e-9)
        assert result.best_peak_ratio > 0.0 and result.best_contrast_db >= result.contrast_db


@pytest.mark.slow
def test_no_voltages_beat_the_best_contrast(study):
    model = study.beams[0]
    field, random = model.field(2400.0), np.random.default_rng(2)
    for region in REGIONS:
        inside = region_points(region, model.places_m, model.line_m)
        best = study.confinement(model.name, "displacement", 2400.0, region, "in phase").best_contrast_db
        for _ in range(200):
            volts = random.normal(size=6) + 1j * random.normal(size=6)
            assert contrast(field @ volts, inside).contrast_db <= best


def test_calibrated_sensors_read_the_displacement_of_their_own_standing_wave(study):
    model = study.beams[0]
    frequency = float(model.table.frequencies_hz[model.calibrated_on])
    actuator = int(np.argmax(np.abs(model.table.actuators[model.calibrated_on])))
    read, moved = (model.matrix(frequency, signal)[:, actuator] for signal in ("calibrated", "displacement"))
    assert read == pytest.approx(moved)
    with pytest.raises(SolverError, match="its sensors are not calibrated"):
        study.beams[1].matrix(frequency, "calibrated")


def test_coupling_entry_is_that_of_the_matrix(document):
    table = beam_table(PatchedBeam(), 20, np.array(PatchedBeam().centres_m))
    result = conditioning(field_matrix(table, 2400.0))
    ours = entry_of(document, "coupling at 2.4 kHz|patches|displacement")["ours"]
    assert f"coupling {result.coupling:.3f}" in ours and f"condition number {result.condition:.1f}" in ours


def test_limits_are_kept_and_cost_accuracy(study):
    for one in study.confinements:
        assert (one.limited_error < 1e-6) == (one.volts_per_um <= study.data.limit_v)


def test_travelling_waves_with_everything_free_are_the_best(study):
    for wave in study.travelling:
        assert wave.free["twr"] >= wave.twr.max()
        low, high = wave.window_m
        length = next(one.beam.length_m for one in study.beams if one.name == wave.beam)
        assert 0.0 < low < high and low + high == pytest.approx(length)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frequencies_hz": ()}, "at least one, each a finite number above 0"),
        ({"frequencies_hz": (0.0,)}, "at least one, each a finite number above 0"),
        ({"band_hz": (500.0, 100.0)}, "must ascend"),
        ({"modes": 3}, "modes = 3: must be 8 or more"),
        ({"beam": replace(PatchedBeam(), centres_m=())}, "list of actuators is empty"),
        ({"limit_v": 0.0}, "voltage limit = 0 V"),
    ],
)
def test_data_that_cannot_be_is_refused(change, message):
    with pytest.raises(SolverError, match=message):
        shaping_study(replace(ShapingData(), **change))
