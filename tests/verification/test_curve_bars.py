"""Bars of the curves of response, cross-talk and hybrid on a coarse mesh against whole solves on finer ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.analysis import response
from pipeline.case.model import case_from_dict
from pipeline.driven import crosstalk, hybrid
from pipeline.logs import TerminalLog
from pipeline.planning import mesh_rules
from pipeline.records.record import CrosstalkRecord, HybridRecord
from solvers.piezo import patch as piezo_patch
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


def both(raw: dict[str, Any], command: Any, patch: pytest.MonkeyPatch) -> tuple[Any, Any]:
    """The records of the case's own mesh and of a coarse one, patches and plate."""
    case = case_from_dict(raw)
    fine = command.solve(case, QUIET, points=61)
    patch.setattr(mesh_rules, "cell_mesh", lambda design, level: COARSE)
    patch.setattr(piezo_patch, "MESH", COARSEST_PATCH)
    return command.solve(case, QUIET, points=61), fine


def inside(coarse: Any, error: Any, fine: Any) -> np.ndarray:
    off, bar = np.abs(np.array(coarse) - np.array(fine)), np.array(error, dtype=float)
    return np.asarray(off <= bar + 1e-9 * np.abs(np.array(fine)))


@pytest.mark.slow
def test_every_zone_s_curve_lies_within_its_bar_of_a_finer_one(monkeypatch: pytest.MonkeyPatch) -> None:
    records: tuple[CrosstalkRecord, CrosstalkRecord] = both(ZONES, crosstalk, monkeypatch)
    for coarse, fine in zip(*(record.zones for record in records), strict=True):
        assert inside(coarse.over_rms_m_per_V, coarse.over_rms_error_m_per_V, fine.over_rms_m_per_V).mean() >= 0.95
        assert abs(coarse.peak_hz / fine.peak_hz - 1.0) <= (coarse.peak_error or 0.0)
        assert inside(coarse.rms_m_per_V, coarse.rms_error_m_per_V, fine.rms_m_per_V).all()
        assert inside(coarse.level_db, coarse.level_error_db, fine.level_db).all()
        assert inside([coarse.passive_db], [coarse.passive_error_db], [fine.passive_db]).all()


@pytest.mark.slow
def test_every_level_of_four_methods_lies_within_its_bar_of_a_finer_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """At the same tones; at the wanted mode's peak, which is elsewhere on the finer mesh, alike."""
    records: tuple[HybridRecord, HybridRecord] = both(FOUR, hybrid, monkeypatch)
    names = ("confinement", "off", "rows_off")
    for coarse, fine in zip(*(record.methods for record in records), strict=True):
        for name in names:
            values = getattr(coarse, f"{name}_db")
            if values is not None:
                held = inside(values, getattr(coarse, f"{name}_error_db"), getattr(fine, f"{name}_db"))
                assert held.mean() >= 0.95, (coarse.method, name)
                assert records[0].wanted_place is not None and held[records[0].wanted_place]
        assert inside(coarse.volts_per_um, coarse.volts_error_per_um, fine.volts_per_um).mean() >= 0.95


@pytest.mark.slow
def test_both_curves_of_a_response_lie_within_their_bars_of_finer_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """At tones of the finer one: each has more about its own peak."""
    coarse, fine = (each.record for each in both(FOUR, response, monkeypatch))
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
