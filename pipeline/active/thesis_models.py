"""The figures of circuit, pillar, active beam and loop that the thesis' statements are compared with, by their keys."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.active.thesis import Figures
from pipeline.quantity import figure, interval
from pipeline.units import KHZ, MM, MS, UM, US
from solvers.thesis.loop_design import FIRMWARE_RESPONSE_S

if TYPE_CHECKING:
    from solvers.thesis.active_study import ActiveBeamStudy, Case
    from solvers.thesis.circuit import MasonStudy
    from solvers.thesis.loop_design import DqStudy
    from solvers.thesis.pillar_row import PillarFilter
    from solvers.thesis.scattering import PointForce

UNDRIVEN = 0.05  # of the loudest joint velocity: a mode below it does not answer
STOPS_DB = 1.0  # a row: from here on the computed cell's flexural wave counts as stopped
CONFINED = 2.0  # rms inside over rms outside from which a shape of the active beam counts as confined


def mason(study: MasonStudy) -> Iterator[tuple[str, Figures]]:
    """The mode that is confined, the bare beam without it, the filtered beam with it.

    The study has to hold the modes about its target: the default window of mason_study does, a band to show need not.
    """
    target, f, clamped = study.data.target_hz, study.frequencies_hz, study.clamped_modes_hz
    level = np.abs(study.clamped)
    answering = [m for m in clamped if level[np.argmin(np.abs(f - m))].max() > UNDRIVEN * level.max()]
    number = int(np.argmin(np.abs(clamped - target))) + 1
    yield "confined", {"number": number, "answering": ", ".join(figure(m / KHZ) for m in answering)}
    both = (study.bare_modes_hz, study.filtered_modes_hz)
    nearest, added = (float(modes[np.argmin(np.abs(modes - target))]) for modes in both)
    yield "bare", {"target_khz": target / KHZ, "nearest_khz": nearest / KHZ, "off": abs(nearest / target - 1.0)}
    bare_db, filtered_db = study.confinement_bare_db, study.confinement_filtered_db
    yield (
        "filtered",
        {
            "added_khz": added / KHZ,
            "off": abs(added / target - 1.0),
            "bare_db": bare_db,
            "filtered_db": filtered_db,
            "gained_db": filtered_db - bare_db,
        },
    )


def pillar(row: PillarFilter, point: PointForce, cell: dict[str, Any] | None) -> Iterator[tuple[str, Figures]]:
    """Figure 3.2, the condition (3.21), the pillar against its clamped resonance, rows, and the computed cell."""
    damper, spring, printed = (point.of(name) for name in ("printed damper", "spring", "printed force"))
    yield "force", {"spring": spring.transmitted, "printed": printed.transmitted}
    yield "damper", {name: getattr(damper, name) for name in ("transmitted", "reflected", "absorbed")}
    yield (
        "stop",
        {
            "stopped_khz": row.stopped_hz / KHZ,
            "clamped_khz": row.clamped_hz / KHZ,
            "ratio": row.stopped_hz / row.clamped_hz,
            "oscillator": row.oscillator_stopped_hz / row.clamped_hz,
        },
    )
    yield "rows", {"bands": "; ".join(map(_band, row.bands_hz))}
    yield "endless", {"band": _band(row.stop_hz)}
    if cell:
        yield "cell", _cell(row.stop_hz, cell)


def _band(band: tuple[float, float] | None) -> str:
    return interval(*band, to="-") if band else "none in the window"


def _cell(strip_hz: tuple[float, float] | None, cell: dict[str, Any]) -> Figures:
    levels = zip(cell["frequencies_hz"], cell["db_per_row"], strict=True)
    stopped = [f for f, decay in levels if decay is None or decay > STOPS_DB]
    band = (min(stopped), max(stopped)) if stopped else None
    if band is None or strip_hz is None:
        return {"band": _band(band)}
    lower, upper = (100.0 * (ours / strip - 1.0) for ours, strip in zip(band, strip_hz, strict=True))
    return {"band": _band(band), "lower": lower, "upper": upper}


def beam(study: ActiveBeamStudy) -> Iterator[tuple[str, Figures]]:
    """Equal forces, opposed forces, the two gains, the higher frequency, forces and delay; first and last of the data."""
    tone, gain = study.data.frequencies_hz[0], study.data.gains_n_m[-1]
    point, pair, couple, opposed = (study.case(name, tone, gain) for name in ("point", "pair", "couple", "opposed"))
    where = {"where": _where(point)}
    yield "equal", where | {"ratio": point.after.ratio, "pair_ratio": pair.after.ratio, "amplitudes": _amplitudes(pair)}
    ratios = study.place_sweep[f"couple at {tone:g} Hz"]
    best = {"best_mm": float(study.sweep_places_m[ratios.argmax()]) / MM, "best": float(ratios.max())}
    yield "couples", where | _inside(couple) | best
    loops = {one.layout: one for one in study.stability}
    grows = max(loops["opposed"].growth_per_s) > 0.0
    yield "opposed", where | _inside(opposed) | {"grows": grows, "unstable_n_m": loops["opposed"].unstable_from_n_m}
    yield "gain", _gains(study)
    yield "higher", _higher(study)
    yield "force", where | {"steady_n": point.force_n, "switch_on_n": point.switch_on_n}
    limits, delays = loops["point"].gain_limits_n_m, study.data.delays_s
    listed = [f"{_limit(limit)} with {delay / US:g} us" for limit, delay in zip(limits, delays, strict=False)]
    reach = max(limits[: len(delays)], default=0.0) / min(study.data.gains_n_m)
    yield "delay", {"limits": f"{', '.join(listed)}, {_limit(limits[-1])}", "reach": reach}


def _where(case: Case) -> str:
    return f"{case.frequency_hz / KHZ:g} kHz, K' = {case.gain_n_m:g} N/m"


def _inside(case: Case) -> Figures:
    gain = case.after.inside_max / case.before.inside_max
    return {"gain": gain, "ratio": case.after.ratio, "amplitudes": _amplitudes(case)}


def _amplitudes(case: Case) -> str:
    return (
        f"largest inside {figure(case.before.inside_max / UM)} -> {figure(case.after.inside_max / UM)} um, "
        f"inside / beyond {figure(case.after.inside_max / case.after.outside_max)}"
    )


def _gains(study: ActiveBeamStudy) -> Figures:
    gains = sorted(set(study.data.gains_n_m))
    cases = [study.case("point", study.data.frequencies_hz[0], gain) for gain in dict.fromkeys((gains[0], gains[-1]))]
    lines = [
        f"K' = {one.gain_n_m:g}: {figure(one.strength)} x 4EIb3, rms ratio {figure(one.after.ratio)}" for one in cases
    ]
    return {
        "cases": ", ".join(lines),
        "count": len(cases),
        "confining": sum(one.after.ratio >= CONFINED for one in cases),
    }


def _higher(study: ActiveBeamStudy) -> Figures:
    tones = sorted(set(study.data.frequencies_hz))
    cases = {name: study.case(name, tones[-1], study.data.gains_n_m[-1]) for name in ("point", "pair")}
    failing = [name for name, case in cases.items() if case.after.ratio < CONFINED]
    return {
        "where": _where(cases["point"]),
        "ratios": ", ".join(f"{name} {figure(case.after.ratio)}" for name, case in cases.items()),
        "count": len(tones),
        "failing": len(failing),
        "names": " and ".join(failing),
    }


def _limit(gain: float) -> str:
    return f"K' < {figure(gain)} N/m" if gain > 0.0 else "no gain"


def dq(study: DqStudy) -> Iterator[tuple[str, Figures]]:
    """The closed loop's response, and with the firmware's own time constant."""
    fast, trace = study.step("firmware's constant"), study.query.trace
    yield (
        "response",
        {
            "reached_ms": trace.reached_s() / MS,
            "overshoot": 100.0 * trace.overshoot(),
            "planned_ms": study.planned_s / MS,
            "firmware_ms": fast.trace.reached_s() / MS,
            "constant_ms": FIRMWARE_RESPONSE_S / MS,
            "asked_ms": study.data.within_s / MS,
            "largest_share": study.largest_share,
        },
    )
