"""The steps of the shaping study on one beam: confinement, travelling waves, errors, mode pairs, resonators beside patches."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import log, pi
from typing import Any

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.shaping.contrast import (
    REGIONS,
    attach_oscillators,
    best_contrast,
    confinement,
    contrast,
    region_points,
    region_target,
)
from solvers.shaping.inversion import Errors, drive_voltages, monte_carlo
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
from solvers.thesis.shaped_beam import LINE, ShapedBeam, Signal, part_of

TARGETS = {"in phase": False, "alternating": True}
NEAR_FIELD = 0.1  # what is left of the ends' near field, e^{-kx}, where the travelling wave is evaluated
MICROMETRE = 1e-6


@dataclass(frozen=True)
class Confinement:
    """A region asked for at its two sensors and zero at the others: ratios of the whole field, and what it takes.

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


def confine(model: ShapedBeam, signal: Signal, frequency_hz: float, limit_v: float) -> list[Confinement]:
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


def polar(values: ComplexArray | complex) -> dict[str, Any]:
    """Size and phase of complex numbers."""
    return {"abs": np.abs(values), "phase_rad": np.angle(values)}


def sweep(
    model: ShapedBeam, signal: Signal, frequency_hz: float, wavelengths_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """TWR by amplitudes and by the two-wave fit, (n,) each, for waves of n lengths asked for at the sensors."""
    k = 2.0 * pi / model.free_wavelength_m(frequency_hz)
    inside = inner_window(model.line_m, *travel_window(model, frequency_hz))
    x, field, matrix = model.line_m[inside], model.field(frequency_hz)[inside], model.matrix(frequency_hz, signal)
    waves = [
        field @ drive_voltages(matrix, wave_target(model.places_m, float(length))).voltages for length in wavelengths_m
    ]
    fits = [two_wave_fit(x, wave, k).twr for wave in waves]
    return np.array([travelling_wave_ratio(wave) for wave in waves]), np.array(fits)


def travel(model: ShapedBeam, signal: Signal, frequency_hz: float, wavelengths_m: FloatArray) -> Travelling:
    """Travelling waves at one frequency, evaluated where the ends' near field has fallen to a tenth."""
    k = 2.0 * pi / model.free_wavelength_m(frequency_hz)
    window = travel_window(model, frequency_hz)
    inside = inner_window(model.line_m, *window)
    x, field = model.line_m[inside], model.field(frequency_hz)[inside]
    twr, fitted = sweep(model, signal, frequency_hz, wavelengths_m)
    voltages, best = best_travelling_drive(field, x, k)
    fit, at = two_wave_fit(x, field @ voltages, k), int(np.argmax(twr))
    ratio = float(twr[at])
    shares = {"forward_energy_share": forward_energy_share(ratio), "net_flux_over_forward": net_flux_share(ratio)}
    peak = {"wavelength_m": float(wavelengths_m[at]), "twr": ratio} | shares
    free = {"twr": best, "fitted_twr": fit.twr, "near_field_share": fit.residual}
    driven = {"voltages_relative": polar(voltages / np.abs(voltages).max())}
    lengths = 2.0 * pi / k, wavelengths_m
    return Travelling(model.name, signal, frequency_hz, window, *lengths, twr, 1.0 - twr, fitted, peak, free | driven)


def error_trials(
    model: ShapedBeam, signal: Signal, frequency_hz: float, wavelength_m: float, errors: Errors
) -> dict[str, FloatArray]:
    """What measurement errors do to the left region and to a wave of one length, trial by trial (n,): the region's peak ratio,
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
    """Where the ends' near field has fallen to a tenth, at most up to 0.4 and from 0.6 of the length, m."""
    margin = min(-log(NEAR_FIELD) / (2.0 * pi) * model.free_wavelength_m(frequency_hz), 0.4 * model.beam.length_m)
    return margin, model.beam.length_m - margin


def best_pair(model: ShapedBeam, zone_m: tuple[float, float], others: float, highest_hz: float) -> ModePair:
    """Neighbouring modes whose quarter-period sum travels best inside a zone when contrast, both below a frequency."""
    table = part_of(model.table, slice(LINE))
    inside = inner_window(table.points_m, *zone_m)
    last = int(np.searchsorted(table.frequencies_hz, highest_hz))
    pairs = [travelling_pair(table, (n, n + 1), inside, others=others) for n in range(max(last - 1, 1))]
    return max(pairs, key=lambda pair: pair.twr)


def resonators_and_patches(
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
