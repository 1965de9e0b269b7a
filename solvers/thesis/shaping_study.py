"""Shaping by actuators and sensors on the thesis' clamped beams: the steps on one beam, and all of them as a document."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from math import log, pi
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.analytic.beams import frequency_hz, roots
from solvers.errors import SolverError
from solvers.shaping.modal_table import Scan, common_phase, conditioning, operating_frequencies, scan, sensor_matrix
from solvers.shaping.travelling_wave import (
    ModePair,
    best_travelling_drive,
    forward_energy_share,
    inner_window,
    net_flux_share,
    travelling_pair,
    travelling_wave_ratio,
    two_wave_fit,
    wave_target,
)
from solvers.shaping.voltages import (
    REGIONS,
    Errors,
    LowPass,
    attach_oscillators,
    best_contrast,
    confinement,
    contrast,
    drive_voltages,
    filter_for,
    monte_carlo,
    quantiles,
    region_points,
    region_target,
)
from solvers.thesis.shaped_beam import (
    LINE,
    PatchedBeam,
    ShapedBeam,
    Signal,
    charge_table,
    evenly,
    part_of,
    patched,
    pointed,
    section,
)

TARGETS = {"in phase": False, "alternating": True}
NEAR_FIELD = 0.1  # remaining part of the ends' near field, e^{-kx}, where the travelling wave is evaluated
MICROMETRE = 1e-6

ASSUMPTIONS = (
    "patches: Pz26, each actuator in the middle of an equal share of the beam, its sensor strips on either side as one",
    "quality factor 50 for every mode; perfect clamps; layered Euler-Bernoulli beam, extension without inertia",
    "sensors open; voltages positive when they stretch a patch; 20 modes and the static residual of the others",
    "point beams: the same bare beams with point forces and deflection sensors, without residual, as the text simulates them",
    "a region is a third of the sensors and the points nearest to them; a travelling wave is judged where the ends' near "
    "field has fallen to a tenth",
    "oscillators beside the zone: four, tuned to the frequency of use, 0.5 g each",
)

BESIDE = (0.30, 0.34, 0.66, 0.70)  # of the length: oscillators beside each end of the middle third
SCANNED = 221  # frequencies of the conditioning scan


@dataclass(frozen=True)
class Confinement:
    """A target of one region at its two sensors and zero at the others: ratios of the whole field, and the voltages.

    volts_per_um: largest voltage for 1 um asked; beyond_to_inside: largest voltage of the actuators outside the region over
    those inside; limited_*: the same 1 um with the voltage limit kept. best_*: the largest contrast of any voltages.
    """

    beam: str
    signal: Signal
    frequency_hz: float
    region: str
    target: str
    peak_ratio: float
    contrast_db: float
    volts_per_um: float
    beyond_to_inside: float
    limited_error: float
    limited_peak_ratio: float
    best_peak_ratio: float
    best_contrast_db: float


@dataclass(frozen=True)
class Travelling:
    """TWR (n,) over wavelengths (n,) for equal amplitudes at the sensors, SWR, and TWR by the two-wave fit, over window_m.

    peak: at the wavelength of the largest TWR. free: amplitude and phase of all actuators free.
    """

    beam: str
    signal: Signal
    frequency_hz: float
    window_m: tuple[float, float]
    free_wavelength_m: float
    wavelengths_m: FloatArray
    twr: FloatArray
    swr: FloatArray
    fitted_twr: FloatArray
    peak: dict[str, float]
    free: dict[str, Any]


@dataclass(frozen=True)
class ShapingData:
    """Data of the study. The thesis gives the beams, the patches' sizes, 2.2 and 2.4 kHz and 5.9 to 7.4 cm.

    calibrate_near_hz: the standing wave for the sensors; wavelengths_m: first, last, number; limit_v: a half-bridge's
    amplitude; errors: standard deviations; oscillator_kg: mass of each resonator next to the middle third.
    """

    beam: PatchedBeam = field(default_factory=PatchedBeam)
    short: PatchedBeam = field(default_factory=lambda: PatchedBeam(length_m=0.100, centres_m=evenly(0.100, 6)))
    modes: int = 20
    frequencies_hz: tuple[float, ...] = (2200.0, 2400.0)
    band_hz: tuple[float, float] = (100.0, 4500.0)
    calibrate_near_hz: float = 2200.0
    wavelengths_m: tuple[float, float, int] = (0.050, 0.090, 41)
    limit_v: float = 50.0
    errors: Errors = field(default_factory=lambda: Errors(0.01, 0.05, pi / 36.0, 0.02, trials=200))
    pwm_hz: float = 40e3
    oscillator_kg: float = 5e-4


@dataclass(frozen=True)
class ShapingStudy:
    """Results by beam and signal (`calibrated` or `displacement`); scans, trials, pairs and resonators by their names."""

    data: ShapingData
    beams: tuple[ShapedBeam, ...]
    scans: dict[tuple[str, Signal], Scan]
    confinements: tuple[Confinement, ...]
    travelling: tuple[Travelling, ...]
    trials: dict[tuple[str, Signal], dict[str, FloatArray]]
    pairs: dict[str, ModePair]
    resonators: dict[str, dict[str, float]]
    choices: tuple[dict[str, Any], ...]
    filter: LowPass
    filter_error: float

    @property
    def last_hz(self) -> float:
        """The last of the frequencies, Hz."""
        return self.data.frequencies_hz[-1]

    def confinement(self, beam: str, signal: str, frequency: float, region: str, target: str) -> Confinement:
        """One confinement by its names."""
        key = (beam, signal, frequency, region, target)
        return next(
            one for one in self.confinements if (one.beam, one.signal, one.frequency_hz, one.region, one.target) == key
        )

    def wave(self, beam: str, signal: str, frequency: float) -> Travelling:
        """One travelling-wave sweep by its names."""
        return next(
            one for one in self.travelling if (one.beam, one.signal, one.frequency_hz) == (beam, signal, frequency)
        )


def _confine(model: ShapedBeam, signal: Signal, frequency_hz: float, limit_v: float) -> list[Confinement]:
    """Left, middle and right, both target patterns, at one frequency."""
    field, matrix, count = model.field(frequency_hz), model.matrix(frequency_hz, signal), len(model.places_m)
    levels = []
    for region in REGIONS:
        inside = region_points(region, model.places_m, model.line_m)
        best = contrast(field @ best_contrast(field, inside), inside)
        for name, alternate in TARGETS.items():
            target = region_target(region, count, alternate)
            drive = drive_voltages(matrix, target)
            limited = drive_voltages(matrix, MICROMETRE * target, limit_v=limit_v)
            size, chosen = np.abs(drive.voltages), target != 0.0
            got, kept = contrast(field @ drive.voltages, inside), contrast(field @ limited.voltages, inside)
            levels.append(
                Confinement(
                    model.name, signal, frequency_hz, region, name, got.peak_ratio, got.contrast_db,
                    float(size.max()) * MICROMETRE, float(size[~chosen].max() / size[chosen].max()), limited.error,
                    kept.peak_ratio, best.peak_ratio, best.contrast_db,
                )
            )  # fmt: skip
    return levels


def _polar(values: ComplexArray | complex) -> dict[str, Any]:
    """Size and phase of complex numbers."""
    return {"abs": np.abs(values), "phase_rad": np.angle(values)}


def _sweep(
    model: ShapedBeam, signal: Signal, frequency_hz: float, wavelengths_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """TWR by amplitudes and by the two-wave fit, (n,) each, for waves of n lengths requested at the sensors."""
    k = 2.0 * pi / model.free_wavelength_m(frequency_hz)
    inside = inner_window(model.line_m, *travel_window(model, frequency_hz))
    x, field, matrix = model.line_m[inside], model.field(frequency_hz)[inside], model.matrix(frequency_hz, signal)
    waves = [
        field @ drive_voltages(matrix, wave_target(model.places_m, float(length))).voltages for length in wavelengths_m
    ]
    fits = [two_wave_fit(x, wave, k).twr for wave in waves]
    return np.array([travelling_wave_ratio(wave) for wave in waves]), np.array(fits)


def _travel(model: ShapedBeam, signal: Signal, frequency_hz: float, wavelengths_m: FloatArray) -> Travelling:
    """Travelling waves at one frequency, evaluated where the ends' near field has fallen to a tenth."""
    k = 2.0 * pi / model.free_wavelength_m(frequency_hz)
    window = travel_window(model, frequency_hz)
    inside = inner_window(model.line_m, *window)
    x, field = model.line_m[inside], model.field(frequency_hz)[inside]
    twr, fitted = _sweep(model, signal, frequency_hz, wavelengths_m)
    voltages, best = best_travelling_drive(field, x, k)
    fit, at = two_wave_fit(x, field @ voltages, k), int(np.argmax(twr))
    ratio = float(twr[at])
    shares = {"forward_energy_share": forward_energy_share(ratio), "net_flux_over_forward": net_flux_share(ratio)}
    peak = {"wavelength_m": float(wavelengths_m[at]), "twr": ratio} | shares
    free = {"twr": best, "fitted_twr": fit.twr, "near_field_share": fit.residual}
    driven = {"voltages_relative": _polar(voltages / np.abs(voltages).max())}
    lengths = 2.0 * pi / k, wavelengths_m
    return Travelling(model.name, signal, frequency_hz, window, *lengths, twr, 1.0 - twr, fitted, peak, free | driven)


def _error_trials(
    model: ShapedBeam, signal: Signal, frequency_hz: float, wavelength_m: float, errors: Errors
) -> dict[str, FloatArray]:
    """Effect of measurement errors on the left region and a wave of one length, by trial (n,): the region's peak ratio,
    the wave's TWR, the pattern's error.
    """
    matrix, field = model.matrix(frequency_hz, signal), model.field(frequency_hz)
    inside = region_points("left", model.places_m, model.line_m)
    left, missed = monte_carlo(matrix, region_target("left", len(matrix)), errors)
    wave, _ = monte_carlo(matrix, wave_target(model.places_m, wavelength_m), replace(errors, seed=errors.seed + 1))
    window = inner_window(model.line_m, *travel_window(model, frequency_hz))
    ratios = np.array([contrast(field @ v, inside).peak_ratio for v in left])
    twr = np.array([travelling_wave_ratio(field[window] @ v) for v in wave])
    return {"peak_ratio": ratios, "twr": twr, "pattern_error": missed}


def travel_window(model: ShapedBeam, frequency_hz: float) -> tuple[float, float]:
    """Return the window in which the ends' near fields have fallen to a tenth; it holds at least the middle fifth.

    Parameters
    ----------
    model : ShapedBeam
        The beam.
    frequency_hz : float
        Frequency in Hz.

    Returns
    -------
    low_m, high_m : float
        Ends of the window from the beam's left end.
    """
    margin = min(-log(NEAR_FIELD) / (2.0 * pi) * model.free_wavelength_m(frequency_hz), 0.4 * model.beam.length_m)
    return margin, model.beam.length_m - margin


def _best_pair(model: ShapedBeam, zone_m: tuple[float, float], others: float, highest_hz: float) -> ModePair:
    """Neighbouring modes whose quarter-period sum travels best inside a zone when contrast, both below a frequency."""
    table = part_of(model.table, slice(LINE))
    inside = inner_window(table.points_m, *zone_m)
    last = int(np.searchsorted(table.frequencies_hz, highest_hz))
    pairs = [travelling_pair(table, (n, n + 1), inside, others=others) for n in range(max(last - 1, 1))]
    return max(pairs, key=lambda pair: pair.twr)


def _resonators_and_patches(
    model: ShapedBeam, zone_m: tuple[float, float], places: tuple[float, ...], mass_kg: float, frequency_hz: float
) -> dict[str, float]:
    """dB of the zone, driven from inside: free, held by oscillators at shares of the length, by patches, by both."""
    bare = part_of(model.table, slice(LINE))
    inside = inner_window(bare.points_m, *zone_m)
    places_m = model.beam.length_m * np.array(places)
    nearest = np.argmin(np.abs(bare.points_m[:, 0] - places_m[:, None]), axis=1)
    passive = attach_oscillators(bare, nearest, mass_kg, frequency_hz, model.beam.quality_factor)
    driver = int(np.argmin(np.abs(model.places_m - sum(zone_m) / 2.0)))
    alone, hung = (confinement(table, frequency_hz, inside, driver) for table in (bare, passive))
    levels = (alone.alone_db, hung.alone_db, alone.shaped_db, hung.shaped_db)
    return dict(zip(("neither_db", "passive_db", "active_db", "both_db"), levels, strict=True))


def shaping_study(data: ShapingData | None = None) -> ShapingStudy:
    """Compute sections 3.3 to 3.7 of the thesis and two steps beyond them.

    Parameters
    ----------
    data : ShapingData, optional
        Beams, frequencies and errors; by default the study's own.

    Returns
    -------
    ShapingStudy
        Results by beam and signal.

    Raises
    ------
    SolverError
        If the band, a frequency, the number of modes or a beam is invalid.
    """
    data = ShapingData() if data is None else data
    _check(data)
    beams = _beams(data)
    low, high = data.band_hz
    grid = np.linspace(low, high, SCANNED)
    signals = [(beam, signal) for beam in beams for signal in beam.signals]
    scans = {(beam.name, signal): scan(partial(beam.matrix, signal=signal), grid) for beam, signal in signals}
    last = data.frequencies_hz[-1]
    wavelengths = np.linspace(*data.wavelengths_m)
    low_pass, filter_error = _filter(data)
    return ShapingStudy(
        data=data,
        beams=beams,
        scans=scans,
        confinements=tuple(
            one
            for beam, signal in signals
            for f in sorted({*data.frequencies_hz, *operating_frequencies(scans[beam.name, signal], 1).tolist()})
            for one in _confine(beam, signal, f, data.limit_v)
        ),
        travelling=tuple(
            _travel(beam, signal, f, wavelengths) for beam, signal in signals for f in data.frequencies_hz
        ),
        trials={(beam.name, signal): _error_trials(beam, signal, last, 0.066, data.errors) for beam, signal in signals},
        pairs={beam.name: _best_pair(beam, _zone(beam.beam), 1.0, high) for beam in beams},
        resonators={
            beam.name: _resonators_and_patches(beam, _zone(beam.beam), BESIDE, data.oscillator_kg, last)
            for beam in beams
        },
        choices=_choices(data, last),
        filter=low_pass,
        filter_error=filter_error,
    )


def _bare_modes_hz(beam: PatchedBeam, count: int) -> FloatArray:
    """Natural frequencies of the beam without its patches, Hz, shape (count,)."""
    _, _, bending, mass = section(beam, False)
    kappas = roots(*beam.ends, count)
    return frequency_hz(np.array(kappas), beam.length_m, bending, mass)


def _choices(data: ShapingData, frequency_hz: float) -> tuple[dict[str, Any], ...]:
    """Effect of pitches of 1/6, 1/6.5 and 1/7 of the length and Q of 20, 50 and 200 on the long beam: conditioning of T by
    signal, and the largest TWR of waves requested in displacement.
    """
    length, wavelengths, out = data.beam.length_m, np.linspace(*data.wavelengths_m), []
    for pitch, quality_factor in product((length / share for share in (6.0, 6.5, 7.0)), (20.0, 50.0, 200.0)):
        centres = evenly(length, len(data.beam.centres_m), pitch)
        beam = replace(data.beam, centres_m=centres, quality_factor=quality_factor)
        model = patched("variant", beam, data.modes, data.calibrate_near_hz)
        twr, _ = _sweep(model, "displacement", frequency_hz, wavelengths)
        found = {signal: conditioning(model.matrix(frequency_hz, signal)) for signal in model.signals}
        best = {"peak_twr": twr.max(), "peak_wavelength_m": wavelengths[twr.argmax()]}
        told = {signal: {"condition": t.condition, "independence": t.independence} for signal, t in found.items()}
        out.append({"pitch_m": pitch, "quality_factor": quality_factor} | best | told)
    return tuple(out)


def document(study: ShapingStudy) -> dict[str, Any]:
    """Return everything the study holds as a document.

    Parameters
    ----------
    study : ShapingStudy
        The study.

    Returns
    -------
    dict
        Values in SI; complex numbers as {abs, phase_rad}.
    """
    data = study.data
    return {
        "assumptions": ASSUMPTIONS,
        "errors_assumed": data.errors,
        "limit_v": data.limit_v,
        "beams": [_beam(one) for one in study.beams],
        "conditioning": [
            {"beam": name, "signal": signal, "best_hz": operating_frequencies(scan), **vars(scan)}
            | {"independence": 1.0 - scan.coupling}
            for (name, signal), scan in study.scans.items()
        ],
        "choices": study.choices,
        "confinement": study.confinements,
        "travelling": study.travelling,
        "errors": [
            {"beam": name, "signal": signal, **{key: quantiles(values) for key, values in trials.items()}}
            for (name, signal), trials in study.trials.items()
        ],
        "filter": {
            **vars(study.filter),
            "corner_hz": study.filter.corner_hz,
            "pwm_ripple": abs(study.filter.response(data.pwm_hz)),
            "compensation": [{"frequency_hz": f, **_polar(study.filter.compensation(f))} for f in data.frequencies_hz],
            "compensation_error_of_moving_patches": study.filter_error,
        },
        "mode_pairs": [
            {
                "beam": name,
                "modes": [number + 1 for number in pair.modes],
                "frequency_hz": pair.frequency_hz,
                "twr": pair.twr,
                "twr_of_the_two_modes_alone": pair.alone,
                "wavenumber_rad_m": pair.wavenumber,
                "voltages_relative": _polar(pair.drive.voltages / np.abs(pair.drive.voltages).max()),
            }
            for name, pair in study.pairs.items()
        ],
        "passive_and_active": [{"beam": name, **levels} for name, levels in study.resonators.items()],
    }


def _check(data: ShapingData) -> None:
    low, high = data.band_hz
    if not 0.0 < low < high:
        raise SolverError(f"band = {low:g} ... {high:g} Hz: must ascend and be above 0")
    if not data.frequencies_hz or any(not (np.isfinite(f) and f > 0.0) for f in data.frequencies_hz):
        raise SolverError(f"frequencies = {list(data.frequencies_hz)} Hz: at least one, each a finite number above 0")
    if data.modes < 8:
        raise SolverError(f"modes = {data.modes}: must be 8 or more for frequencies up to a few kHz")


def _beams(data: ShapingData) -> tuple[ShapedBeam, ...]:
    beams = []
    for beam in (data.beam, data.short):
        name = f"{1e3 * beam.length_m:g} mm"
        beams.append(patched(f"{name}, patches", beam, data.modes, data.calibrate_near_hz))
        beams.append(pointed(f"{name}, points", beam, data.modes))
    return tuple(beams)


def _zone(beam: PatchedBeam) -> tuple[float, float]:
    return beam.length_m / 3.0, 2.0 * beam.length_m / 3.0


def _filter(data: ShapingData) -> tuple[LowPass, float]:
    """The filter of an actuator, and the largest error of a compensation that takes the patch as a plain capacitor."""
    beam = data.beam
    low_pass = filter_for(beam.capacitance_f(beam.actuator_width_m), data.band_hz[1], data.pwm_hz)
    charges = charge_table(beam, data.modes)
    missed = [
        low_pass.compensation(f) * low_pass.loaded_response(f, sensor_matrix(charges, f)) - np.eye(len(beam.centres_m))
        for f in data.frequencies_hz
    ]
    return low_pass, float(max(np.linalg.norm(one, 2) for one in missed))


def _beam(model: ShapedBeam) -> dict[str, Any]:
    beam, table, calibration = model.beam, model.table, model.calibration
    shape = np.abs(table.field[:8, :LINE])
    peaks = (shape[:, 1:-1] > shape[:, :-2]) & (shape[:, 1:-1] >= shape[:, 2:])
    return {
        "name": model.name,
        **{key: getattr(beam, key) for key in ("length_m", "width_m", "thickness_m", "centres_m", "quality_factor")},
        "material": beam.material.name,
        "piezo": beam.piezo.name,
        "modes_hz": table.frequencies_hz[:8],
        "antinodes": peaks.sum(axis=1),
        "bare_modes_hz": _bare_modes_hz(beam, 8),
        "calibration": None
        if calibration is None
        else {
            "mode_hz": table.frequencies_hz[model.calibrated_on],
            "m_per_v": _polar(calibration),
            "common_phase_rad": common_phase(calibration),
        },
    }
