"""Bars of response, cross-talk, hybrid, travelling wave and a finger's map, on a coarse mesh against solves on finer ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.case.model import case_from_dict
from pipeline.logs import TerminalLog
from pipeline.models import travelling
from pipeline.planning import mesh_rules
from pipeline.questions.crosstalk import CrosstalkResult
from pipeline.questions.hybrid import Hybrid, HybridResult
from pipeline.questions.question import ask
from pipeline.questions.response import Response
from pipeline.questions.travel import Travel
from solvers.piezo import patch as piezo_patch
from solvers.touch import effects
from tests.helpers.asked import crosstalk_of, touch_of
from tests.helpers.coarse_cells import COARSE, COARSEST_PATCH
from tests.helpers.scenes import STEEL_PILLARS

QUIET = TerminalLog(quiet=True)
PATCHES = {"size_mm": [3.0, 2.0, 0.3], "face": "touch"}
ZONES = {
    **STEEL_PILLARS,
    "zone": [STEEL_PILLARS["zone"], {"shared_rows": 1}],
    "patches": {**PATCHES, "centres_mm": [[-5.0, -6.0], [5.0, 6.0], [0.0, 6.0]], "sensors": [2]},
    "solve": {"accuracy": 0.003, "band_kHz": [20.0, 50.0]},
}
FOUR = {
    **STEEL_PILLARS,
    "zone": {**STEEL_PILLARS["zone"], "nodal_lines": 2},
    "array": {**STEEL_PILLARS["array"], "extension_mm": 8.0},
    "patches": {**PATCHES, "centres_mm": [[-5.0, 0.0], [5.0, 0.0], [0.0, -11.0], [0.0, 11.0]]},
    "solve": {"accuracy": 0.003, "band_kHz": [78.0, 102.0]},
}


def both(raw: dict[str, Any], command: Any, patch: pytest.MonkeyPatch, **options: Any) -> tuple[Any, Any]:
    """The records of the case's own mesh and of a coarse one, patches and plate."""
    case, options = case_from_dict(raw), options or {"points": 61}
    fine = command(case, QUIET, **options)
    patch.setattr(mesh_rules, "cell_mesh", lambda design, level: COARSE)
    patch.setattr(piezo_patch, "MESH", COARSEST_PATCH)
    return command(case, QUIET, **options), fine


FINGERED = {
    **STEEL_PILLARS,
    "zone": {**STEEL_PILLARS["zone"], "nodal_lines": 2},
    "patches": {**PATCHES, "centres_mm": [[-5.0, 0.0], [5.0, 0.0], [0.0, 1.0]], "sensors": [2]},
    "damping": {"quality": 100.0},
    "touch": {"at_mm": [3.0, 1.0], "radius_mm": 1.5, "impedance": "tissue", "force_N": 0.5, "gap_um": [2.0, 10.0]},
    "solve": {"accuracy": 0.003, "band_kHz": [60.0, 90.0]},
}


WAVE = {
    **STEEL_PILLARS,
    "zone": {"length_mm": 30.0, "width_mm": 10.0, "nodal_lines": 3},
    "patches": {**PATCHES, "centres_mm": [[x, 0.0] for x in (-10.5, -3.5, 3.5, 10.5)] + [[0.0, 3.0]], "sensors": [4]},
    "damping": {"quality": 100.0},
    "touch": {"radius_mm": 2.0, "impedance": "tissue", "force_N": 0.5, "gap_um": [2.5, 4.0]},
    "solve": {"accuracy": 0.03, "band_kHz": [68.0, 97.0]},
}


def inside(coarse: Any, error: Any, fine: Any) -> np.ndarray:
    off, bar = np.abs(np.array(coarse) - np.array(fine)), np.array(error, dtype=float)
    return np.asarray(off <= bar + 1e-9 * np.abs(np.array(fine)))


@pytest.mark.slow
def test_every_zone_s_curve_lies_within_its_bar_of_a_finer_one(monkeypatch: pytest.MonkeyPatch) -> None:
    records: tuple[CrosstalkResult, CrosstalkResult] = both(ZONES, crosstalk_of, monkeypatch)
    for coarse, fine in zip(*(record.zones for record in records), strict=True):
        assert inside(coarse.over_rms_m_per_V, coarse.over_rms_error_m_per_V, fine.over_rms_m_per_V).mean() >= 0.95
        assert abs(coarse.peak_hz / fine.peak_hz - 1.0) <= (coarse.peak_error or 0.0)
        assert inside(coarse.rms_m_per_V, coarse.rms_error_m_per_V, fine.rms_m_per_V).all()
        assert inside(coarse.level_db, coarse.level_error_db, fine.level_db).all()
        assert inside([coarse.passive_db], [coarse.passive_error_db], [fine.passive_db]).all()


@pytest.mark.slow
def test_every_level_of_four_methods_lies_within_its_bar_of_a_finer_one() -> None:
    """At the same tones; at the target mode's peak, which is elsewhere on the finer mesh, alike.

    Meshes are those that the program takes for either accuracy: on one coarser than it takes, bars of levels that hardly change
    with the frequency are up to three times too small.
    """
    records: list[HybridResult] = [
        ask(case_from_dict({**FOUR, "solve": {**FOUR["solve"], "accuracy": accuracy}}), Hybrid(points=61), QUIET)
        for accuracy in (0.1, 0.003)
    ]
    place, shares = records[0].target_place, []
    assert place is not None
    for coarse, fine in zip(*(record.methods for record in records), strict=True):
        for name in ("confinement", "off", "rows_off"):
            if (values := getattr(coarse, f"{name}_db")) is None:
                continue
            off = np.abs(np.array(values) - np.array(getattr(fine, f"{name}_db")))
            shares.append(off / np.array(getattr(coarse, f"{name}_error_db"), dtype=float))
            assert off[place] > 0.0 and shares[-1][place] <= 1.0 and 1.0 / np.median(shares[-1]) < 10.0
        assert inside(coarse.volts_per_um, coarse.volts_error_per_um, fine.volts_per_um).mean() >= 0.95
    assert (np.array(shares) <= 1.0).mean() >= 0.95 and (np.array(shares) <= 2.0).mean() >= 0.99


@pytest.mark.slow
def test_both_curves_of_a_response_lie_within_their_bars_of_finer_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """At tones of the finer one: each has more about its own peak."""
    coarse, fine = both(FOUR, lambda case, log, **given: ask(case, Response(**given), log), monkeypatch)
    tones = sorted(set(coarse.frequency_hz) & set(fine.frequency_hz))
    assert len(tones) >= 61
    for part in ("zone", "passive"):
        value, bar, true = (
            [figures[record.frequency_hz.index(tone)] for tone in tones]
            for record, figures in (
                (coarse, getattr(coarse, f"{part}_rms_m_per_V")),
                (coarse, getattr(coarse, f"{part}_rms_error_m_per_V")),
                (fine, getattr(fine, f"{part}_rms_m_per_V")),
            )
        )
        assert inside(value, bar, true).mean() >= 0.95
        assert np.median(np.array(bar) / np.array(value)) < 0.5


@pytest.mark.slow
def test_a_finger_s_map_lies_within_its_bars_of_a_finer_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each at its own plate's peak, over the same places; of friction where it can be told on both."""
    coarse, fine = (each.map for each in both(FINGERED, touch_of, monkeypatch, mapped=True))
    assert coarse and fine and coarse.x_m == fine.x_m and coarse.y_m == fine.y_m and len(coarse.x_m) > 5
    for figure, error in (("free_m", "free_error_m"), ("touched_m", "touched_error_m"), ("needed_V", "needed_error_V")):
        values = [np.array(getattr(each, figure)) for each in (coarse, fine)]
        assert inside(values[0], getattr(coarse, error), values[1]).mean() >= 0.95, figure
        assert (values[0] != values[1]).all()
        assert np.median(np.array(getattr(coarse, error)) / values[0]) < 0.5
    known = [np.array(getattr(coarse, name), dtype=float) for name in ("friction", "friction_error")]
    told = np.isfinite(known).all(axis=0)
    assert (
        told.any() and inside(known[0][told], known[1][told], np.array(fine.friction, dtype=float)[told]).mean() >= 0.95
    )


@pytest.mark.slow
def test_a_travelling_wave_and_its_shear_lie_within_their_bars_of_a_finer_plate_s(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Both plates hold the pair as their own modes take it."""
    monkeypatch.setattr(effects, "SPAN", (2, 2))  # few points, on both
    coarse, fine = both(WAVE, lambda case, log, **given: ask(case, Travel(**given), log), monkeypatch, others=0.0)
    for name, error in (*travelling.FIGURES.items(), *travelling.LISTS.items()):
        if name != "field_m" and getattr(coarse, name) is not None:
            assert inside(getattr(coarse, name), getattr(coarse, error), getattr(fine, name)).all(), name
    sizes = [np.hypot(*np.array(each.field_m).T) for each in (coarse, fine)]
    assert inside(sizes[0], coarse.field_error_m, sizes[1]).mean() >= 0.95
    assert abs(coarse.frequency_hz / fine.frequency_hz - 1.0) <= coarse.frequency_error
    one, other = coarse.shear, fine.shear
    assert one and other and one.x_m == other.x_m
    place = np.unravel_index(np.argmax(np.abs(one.crest_m_s)), np.shape(one.crest_m_s))
    assert inside(np.array(one.crest_m_s)[place], one.fastest_error_m_s, np.array(other.crest_m_s)[place])
    place = np.unravel_index(np.nanargmax(np.abs(np.array(one.shear_high, dtype=float))), np.shape(one.crest_m_s))
    assert inside(np.array(one.shear_high)[place], one.shear_high_error, np.array(other.shear_high)[place])
    assert one.fastest_error_m_s and 0.0 < one.fastest_error_m_s < 0.5 * abs(one.fastest_m_s)
