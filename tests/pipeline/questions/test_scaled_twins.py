"""Scaled twins: with all lengths scaled, frequencies scale alike; motion per volt, levels and powers stay.

Of u'' ~ E u_xx/rho a length s divides frequencies by s; d_31 V/h moves lengths of s by as much per volt. Each figure agrees
within the bars that both plates state.
"""

from __future__ import annotations

import tomllib
from functools import cache
from typing import Any

import pytest

from pipeline.case.model import case_from_dict
from pipeline.logs import TerminalLog
from pipeline.questions.hybrid import Hybrid
from pipeline.questions.question import ask
from pipeline.questions.travel import Travel
from tests.helpers.asked import crosstalk_of, touch_of
from tests.helpers.scenes import STEEL_PILLARS, three_patches

QUIET = TerminalLog(quiet=True)
POWER = {"stiffness_N_per_m": 1, "damping_Ns_per_m": 2, "mass_g": 3}  # of the scale, with E and rho kept
FINGER = {"radius_mm": 2.0, "at_mm": [-3.0, 1.0], "impedance": {"damping_Ns_per_m": 40.0, "mass_g": 0.05}}
TWO_ZONES = {
    **STEEL_PILLARS,
    "zone": [STEEL_PILLARS["zone"], {"shared_rows": 1}],
    "patches": {"size_mm": [3.0, 2.0, 0.3], "face": "touch", "centres_mm": [[-5.0, -6.0], [5.0, 6.0]]},
    "solve": {"accuracy": 0.1, "band_kHz": [20.0, 50.0]},
}
FOUR = {
    **STEEL_PILLARS,
    "array": {**STEEL_PILLARS["array"], "extension_mm": 8.0},
    "patches": {"size_mm": [3.0, 2.0, 0.3], "face": "touch", "centres_mm": [[-5.0, 0.0], [5.0, 0.0], [0.0, 11.0]]},
    "solve": {"accuracy": 0.1, "band_kHz": [105.0, 125.0]},
}
PATCHED = {**tomllib.loads(three_patches((75.0, 95.0), 0.1)), "damping": {"quality": 100.0}}

STRIP = {
    "name": "strip",
    "material": "aluminium",
    "plate": {"thickness_mm": 1.0},
    "zone": {"length_mm": 120.0, "width_mm": 8.0, "nodal_lines": 6},
    "array": {"rows": 0},
    "solve": {"accuracy": 0.1, "band_kHz": [3.0, 9.0]},
    "patches": {
        "size_mm": [8.0, 4.0, 0.3],
        "centres_mm": [[x, 0.0] for x in (-46.0, -28.0, -10.0, 10.0, 28.0, 46.0, -37.0, 37.0)],
        "sensors": [6, 7],
    },
}


def scaled(value: Any, s: float, key: str = "") -> Any:
    """The case with its lengths s times as large."""
    if isinstance(value, dict):
        return {name: scaled(each, s, name) for name, each in value.items()}
    if isinstance(value, list):
        return [scaled(each, s, key) for each in value]
    factor = s if key.endswith("_mm") else 1.0 / s if key.endswith("_kHz") else s ** POWER.get(key, 0)
    return value if factor == 1.0 or isinstance(value, str) else value * factor


@cache
def solved(command: str, s: float) -> Any:
    """The record of a command on the plate s times as large; both twins are compared with that of 1."""
    if command == "touch":
        return touch_of(case_from_dict(scaled({**PATCHED, "touch": FINGER}, s)), QUIET, mapped=False)
    if command == "travel":
        return ask(case_from_dict(scaled(STRIP, s)), Travel(), QUIET)
    if command == "hybrid":
        return ask(case_from_dict(scaled(FOUR, s)), Hybrid(points=3), QUIET)
    return crosstalk_of(case_from_dict(scaled(TWO_ZONES, s)), QUIET, points=3)


def figures(record: Any, command: str) -> dict[str, tuple[float, float | None, int]]:
    """Figures by name, with absolute bars and the power of the scale by which frequencies fall."""
    out: dict[str, tuple[float, float | None, int]] = {}

    def add(name: str, value: float | None, error: float | None, power: int = 0, relative: bool = False) -> None:
        if value is not None:
            out[name] = value, (error * abs(value) if relative and error is not None else error), power

    if command == "touch":
        mode = record.mode
        add("free", mode.free_hz, mode.free_error, 1, True)
        add("loaded", mode.frequency_hz, mode.frequency_error, 1, True)
        add("shift", mode.shift_hz, mode.shift_error_hz, 1)
        add("quality", mode.quality_factor, mode.quality_error)
        add("share", mode.share, mode.share_error)
        for state in record.states:
            add(f"{state.state} hz", state.frequency_hz, state.frequency_error, 1, True)
            for name, error in touch_names():
                add(f"{state.state} {name}", getattr(state, name), getattr(state, error))
    elif command == "travel":
        add("hz", record.frequency_hz, record.frequency_error, 1, True)
        add("wavenumber", record.wavenumber_per_m, record.wavenumber_error_per_m, 1)
        for name in ("twr", "best_twr"):
            add(name, getattr(record, name), getattr(record, f"{name}_error"))
        add("db", record.confinement_db, record.confinement_error_db)
        add("volts", record.drive_V_at_1um, record.drive_error_V_at_1um)
        add("lost", record.lost_W, record.lost_error_W)
    elif command == "hybrid":
        add("hz", record.target_hz, record.target_error, 1, True)
        place = record.target_place
        for method in record.methods:
            add(f"{method.method} db", method.confinement_db[place], method.confinement_error_db[place])
            add(f"{method.method} volts", method.volts_per_um[place], method.volts_error_per_um[place])
            add(f"{method.method} off", method.off_db[place], method.off_error_db[place])
    else:
        for number, zone in enumerate(record.zones):
            add(f"{number} hz", zone.peak_hz, zone.peak_error, 1, True)
            add(f"{number} passive", zone.passive_db, zone.passive_error_db)
            for other, (level, error) in enumerate(zip(zone.level_db, zone.level_error_db, strict=True)):
                add(f"{number} at {other}", level, error)
    return out


def touch_names() -> list[tuple[str, str]]:
    from pipeline.models.touch import STATE

    return list(STATE.items())


@pytest.mark.slow
@pytest.mark.parametrize("s", [0.037, 17.0])
@pytest.mark.parametrize("command", ["touch", "travel", "crosstalk", "hybrid"])
def test_a_scaled_twin_agrees_within_both_bars(command: str, s: float) -> None:
    own, twin = figures(solved(command, 1.0), command), figures(solved(command, s), command)
    assert own.keys() == twin.keys() and len(own) > 5
    for name, (value, error, power) in own.items():
        other, further = twin[name][0] * s**power, twin[name][1]
        assert error is not None and further is not None, name
        assert abs(other - value) <= error + further * s**power + 1e-9 * abs(value), name
