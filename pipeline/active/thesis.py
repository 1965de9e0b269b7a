"""Comparison of the `active` models with the thesis: its statements and their ranges are data, checked by one function."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator
from functools import cache
from math import nan
from string import Formatter
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.paths import REFERENCE
from pipeline.quantity import CM, KHZ, MM, MS, UM, US, figure, interval, signed
from solvers.shaping.modal_table import conditioning, sensor_matrix
from solvers.shaping.travelling_wave import forward_energy_share, net_flux_share
from solvers.shaping.voltages import REGIONS, drive_voltages, region_target
from solvers.thesis.loop_design import FIRMWARE_RESPONSE_S
from solvers.thesis.shaping_study import TARGETS

if TYPE_CHECKING:
    from solvers.thesis.active_beam import ActiveBeamStudy, Case
    from solvers.thesis.circuit import MasonStudy
    from solvers.thesis.loop_design import DqStudy
    from solvers.thesis.scattering import PillarFilter, PointForce
    from solvers.thesis.shaped_beam import ShapedBeam, Signal
    from solvers.thesis.shaping_study import ShapingStudy


FILE = REFERENCE / "thesis-models.toml"
NEAR = 0.15  # relative tolerance: a figure read from the text has one or two digits

Figures = dict[str, Any]
Range = tuple[float, float]


class FiguresInWords(Formatter):
    """Format computed figures with the digits that people read for the specs '' and '+', and given values with 'g'."""

    def format_field(self, value: Any, format_spec: str) -> str:
        """Format a floating-point number as a figure without an error bar, for '+' with its sign; leave anything else."""
        if not isinstance(value, float) or format_spec not in ("", "+"):
            return str(super().format_field(value, format_spec))
        return signed(figure(value)) if format_spec else figure(value)


IN_WORDS = FiguresInWords()


@cache
def statements() -> dict[str, dict[str, Any]]:
    """Statements of the thesis on each model, by key."""
    with FILE.open("rb") as file:
        return tomllib.load(file)


def beside(model: str, computed: Iterable[tuple[str, Figures]]) -> list[dict[str, str]]:
    """Compare the computed figures with every statement on a model: quantity, value of the thesis, ours, agreement."""
    entries = []
    for key, figures in computed:
        statement = statements()[model][key]
        every = _distances(statement["verdicts"], figures) | figures
        ours = {name: IN_WORDS.format(statement[name], **every) for name in ("quantity", "thesis", "ours")}
        entries.append(ours | {"agreement": agreement(statement, every)})
    return entries


def agreement(statement: dict[str, Any], figures: Figures) -> str:
    """Return the first verdict whose figures lie in their ranges, with every line of `also` that applies."""
    first = next(verdict for verdict in statement["verdicts"] if _holds(verdict, figures))
    lines = [first, *(line for line in statement.get("also", ()) if _holds(line, figures))]
    return IN_WORDS.format("".join(line["text"] for line in lines), **figures)


def _holds(verdict: dict[str, Any], figures: Figures) -> bool:
    ranges: dict[str, Range] = dict(verdict.get("within", {}))
    for name, stated in verdict.get("near", {}).items():
        low, high = stated if isinstance(stated, list) else (stated, stated)
        ranges[name] = (low * (1.0 - NEAR), high * (1.0 + NEAR))
    return all(low <= figures.get(name, nan) < high for name, (low, high) in ranges.items())


def _distances(verdicts: list[dict[str, Any]], figures: Figures) -> Figures:
    """Difference of every compared figure from its value: in its own unit, in per cent, and as a ratio."""
    values = {
        name: value for one in verdicts for name, value in one.get("near", {}).items() if isinstance(value, float)
    }
    apart = {f"{name}_apart": figures[name] - value for name, value in values.items()}
    off = {f"{name}_off": 100.0 * (figures[name] / value - 1.0) for name, value in values.items()}
    return apart | off | {f"{name}_times": figures[name] / value for name, value in values.items()}


UNDRIVEN = 0.05  # of the largest joint velocity: a mode below it counts as not excited
STOPS_DB = 1.0  # per row: from here upwards the computed cell's flexural wave counts as stopped
CONFINED = 2.0  # rms inside over rms outside above which a shape of the active beam counts as confined


def mason(study: MasonStudy) -> Iterator[tuple[str, Figures]]:
    """Figures of the confined mode, of the bare beam without it, and of the filtered beam with it.

    The study must contain the modes around its target, as the default window of mason_study does.
    """
    target, f, clamped = study.data.target_hz, study.frequencies_hz, study.modes_hz["clamped"]
    level = np.abs(study.clamped)
    answering = [m for m in clamped if level[np.argmin(np.abs(f - m))].max() > UNDRIVEN * level.max()]
    number = int(np.argmin(np.abs(clamped - target))) + 1
    yield "confined", {"number": number, "answering": ", ".join(figure(m / KHZ) for m in answering)}
    both = (study.modes_hz[name] for name in ("bare", "filtered"))
    nearest, added = (float(modes[np.argmin(np.abs(modes - target))]) for modes in both)
    yield "bare", {"target_khz": target / KHZ, "nearest_khz": nearest / KHZ, "off": abs(nearest / target - 1.0)}
    levels = {f"{name}_db": level for name, level in study.confinement_db.items()}
    gained = {"gained_db": levels["filtered_db"] - levels["bare_db"]}
    yield "filtered", {"added_khz": added / KHZ, "off": abs(added / target - 1.0)} | levels | gained


def pillar(row: PillarFilter, point: PointForce, cell: dict[str, Any] | None) -> Iterator[tuple[str, Figures]]:
    """Figures of 3.2, of condition (3.21), of the pillar and its clamped resonance, of rows and of the computed cell."""
    damper, spring, printed = (point.of(name) for name in ("printed damper", "spring", "printed force"))
    yield "force", {"spring": spring.transmitted, "printed": printed.transmitted}
    yield "damper", {name: getattr(damper, name) for name in ("transmitted", "reflected", "absorbed")}
    tones = {"stopped_khz": row.stopped_hz / KHZ, "clamped_khz": row.clamped_hz / KHZ}
    ratios = {"ratio": row.stopped_hz / row.clamped_hz, "oscillator": row.oscillator_stopped_hz / row.clamped_hz}
    yield "stop", tones | ratios
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
    """Figures of equal and opposed forces, both gains, the higher frequency, forces and delay; first and last of the data."""
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
    yield "force", where | {"steady_n": point.largest_force_n, "switch_on_n": point.switch_on_force_n}
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
        f"inside / outside {figure(case.after.inside_max / case.after.outside_max)}"
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
    """Figures of the closed loop's response, and of that with the firmware's time constant."""
    fast, trace = study.step("firmware's constant"), study.query.trace
    reached = {"reached_ms": trace.reached_s() / MS, "firmware_ms": fast.trace.reached_s() / MS}
    planned = {"planned_ms": study.planned_s / MS, "constant_ms": FIRMWARE_RESPONSE_S / MS}
    asked = {"asked_ms": study.data.within_s / MS, "largest_share": study.largest_share}
    yield "response", {"overshoot": 100.0 * trace.overshoot()} | reached | planned | asked


TWR, STEP_M, WAVELENGTHS_M = 0.58, 3e-3, (0.074, 0.059)  # the text's travelling-wave ratio, measuring step, wavelengths


def shaping(study: ShapingStudy) -> Iterator[tuple[str, Figures]]:
    """Figures of confinement, coupling, travelling wave, energy, modes, measuring step, forces, and further results."""
    real, long_points, _, simulated = study.beams
    displacement: list[tuple[ShapedBeam, Signal]] = [(simulated, "displacement"), (long_points, "displacement")]
    for model, signal in [*displacement, *((real, signal) for signal in real.signals)]:
        yield from (("confined", _confined(study, model, signal, region)) for region in REGIONS)
    both = [(model, signal) for model in (real, long_points) for signal in model.signals]
    yield from (_coupling(model, f, signal) for f in study.data.frequencies_hz for model, signal in both)
    yield from (("wave", _wave(study, model, signal)) for model, signal in both)
    yield from (("free", _free(study, model)) for model in (real, long_points))
    yield "choices", _choices(study)
    yield "energy", {"forward": 100.0 * forward_energy_share(TWR), "net": 100.0 * net_flux_share(TWR)}
    yield "modes", {"four_hz": real.table.frequencies_hz[3], "six_hz": real.table.frequencies_hz[5]}
    least, most = (360.0 * STEP_M / length for length in WAVELENGTHS_M)
    yield "step", {"least_deg": least, "most_deg": most}
    yield "forces", _forces(study, simulated)
    yield "own_strain", _own_strain(study, real)
    yield "follows", _follows(study, real)
    for model in study.beams[:2]:
        pair, levels = study.pairs[model.name], study.resonators[model.name]
        modes = {"first": pair.modes[0] + 1, "second": pair.modes[1] + 1, "hz": pair.frequency_hz}
        yield "pair", {"beam": model.name, "twr": pair.twr} | modes
        listed = ", ".join(f"{key.removesuffix('_db')} {figure(value)} dB" for key, value in levels.items())
        yield "resonators", {"beam": model.name, "levels": listed}


def _confined(study: ShapingStudy, model: ShapedBeam, signal: Signal, region: str) -> Figures:
    contrast = {name: study.confinement(model.name, signal, study.last_hz, region, name) for name in TARGETS}
    best = max(contrast.values(), key=lambda one: one.peak_ratio)
    return {
        "region": region,
        "beam": model.name,
        "signal": signal,
        "khz": study.last_hz / KHZ,
        "ratios": ", ".join(f"{figure(one.peak_ratio)} {name}" for name, one in contrast.items()),
        "ratio": best.peak_ratio,
        "best_db": best.best_contrast_db,
    }


def _coupling(model: ShapedBeam, frequency_hz: float, signal: Signal) -> tuple[str, Figures]:
    """Coupling at a frequency, and for the two frequencies of the text also at the nearest mode."""
    coupling = conditioning(model.matrix(frequency_hz, signal))
    words = (
        f"coupling {figure(coupling.coupling)}, independence {figure(coupling.independence)}, "
        f"condition number {figure(coupling.condition)}"
    )
    figures = {"khz": frequency_hz / KHZ, "beam": model.name, "signal": signal, "coupling": words}
    printed = f"coupling at {frequency_hz:g} Hz"
    if printed not in statements()["shaping"]:
        return "coupling", figures
    peak = float(model.table.frequencies_hz[model.table.nearest(frequency_hz)])
    on_mode = conditioning(model.matrix(peak, signal)).independence
    return printed, figures | {"independence": coupling.independence, "peak_hz": peak, "on_mode": on_mode}


def _wave(study: ShapingStudy, model: ShapedBeam, signal: Signal) -> Figures:
    wave = study.wave(model.name, signal, study.last_hz)
    best = {"twr": wave.peak["twr"], "wavelength_cm": wave.peak["wavelength_m"] / CM}
    fitted = {"fit": float(wave.fitted_twr[wave.twr.argmax()]), "free_cm": wave.free_wavelength_m / CM}
    return {"beam": model.name, "signal": signal} | best | fitted


def _free(study: ShapingStudy, model: ShapedBeam) -> Figures:
    free = study.wave(model.name, "displacement", study.last_hz).free
    share = 100.0 * free["near_field_share"]
    return {"beam": model.name, "twr": free["twr"], "fit": free["fitted_twr"], "near_fields": share}


def _choices(study: ShapingStudy) -> Figures:
    twr = [one["peak_twr"] for one in study.choices]
    free = [one["displacement"]["independence"] for one in study.choices]
    return {"least": min(twr), "most": max(twr), "least_independence": min(free), "most_independence": max(free)}


def _forces(study: ShapingStudy, model: ShapedBeam) -> Figures:
    levels = (study.confinement(model.name, "displacement", study.last_hz, region, "in phase") for region in REGIONS)
    ratios = {level.region: level.beyond_to_inside for level in levels}
    return {
        "beam": model.name,
        "ratios": ", ".join(f"{figure(ratio)} {region}" for region, ratio in ratios.items()),
        "harder": ", ".join(region for region, ratio in ratios.items() if ratio > 1.0) or "no region",
    }


def _own_strain(study: ShapingStudy, model: ShapedBeam) -> Figures:
    last, table = study.last_hz, model.table
    residual = np.zeros((1, 1)) if table.sensor_residual is None else table.sensor_residual
    share = 100.0 * np.abs(np.diag(residual)) / np.abs(np.diag(sensor_matrix(table, last)))
    return {"least": share.min(), "most": share.max(), "khz": last / KHZ, "modes": table.frequencies_hz.size}


def _follows(study: ShapingStudy, model: ShapedBeam) -> Figures:
    matrix, laser = (model.matrix(study.last_hz, signal) for signal in model.signals)
    missed = []
    for region in REGIONS:
        target = region_target(region, len(matrix))
        moved = laser @ drive_voltages(matrix, target).voltages
        missed.append(100.0 * float(np.linalg.norm(moved - target) / np.linalg.norm(target)))
    return {"least": min(missed), "most": max(missed)}
