"""The figures of the shaping study that the thesis' statements are compared with, by their keys."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from pipeline.active.thesis import Figures, statements
from pipeline.quantity import figure
from pipeline.units import CM, KHZ
from solvers.shaping.contrast import REGIONS, region_target
from solvers.shaping.inversion import drive_voltages
from solvers.shaping.modal_table import conditioning, sensor_matrix
from solvers.shaping.travelling_wave import forward_energy_share, net_flux_share
from solvers.thesis.shaping_steps import TARGETS

if TYPE_CHECKING:
    from solvers.thesis.shaped_beam import ShapedBeam, Signal
    from solvers.thesis.shaping_study import ShapingStudy

TWR, STEP_M, WAVELENGTHS_M = 0.58, 3e-3, (0.074, 0.059)  # the text's travelling-wave ratio, measuring step, wavelengths


def shaping(study: ShapingStudy) -> Iterator[tuple[str, Figures]]:
    """Confinement, coupling, travelling wave, energy, modes, phase of a measuring step, forces, and what is beyond the text."""
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
        pair, levels = study.pairs[model.name], study.resonators[model.name].to_dict()
        modes = {"first": pair.modes[0] + 1, "second": pair.modes[1] + 1, "hz": pair.frequency_hz}
        yield "pair", {"beam": model.name, "twr": pair.twr} | modes
        listed = ", ".join(f"{key.removesuffix('_db')} {figure(value)} dB" for key, value in levels.items())
        yield "resonators", {"beam": model.name, "levels": listed}


def _confined(study: ShapingStudy, model: ShapedBeam, signal: Signal, region: str) -> Figures:
    last = study.data.frequencies_hz[-1]
    contrast = {name: study.confinement(model.name, signal, last, region, name) for name in TARGETS}
    best = max(contrast.values(), key=lambda one: one.peak_ratio)
    return {
        "region": region,
        "beam": model.name,
        "signal": signal,
        "khz": last / KHZ,
        "ratios": ", ".join(f"{figure(one.peak_ratio)} {name}" for name, one in contrast.items()),
        "ratio": best.peak_ratio,
        "best_db": best.best_contrast_db,
    }


def _coupling(model: ShapedBeam, frequency_hz: float, signal: Signal) -> tuple[str, Figures]:
    """At the two frequencies of the text also on the mode beside them."""
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
    wave = study.wave(model.name, signal, study.data.frequencies_hz[-1])
    return {
        "beam": model.name,
        "signal": signal,
        "twr": float(wave.twr[wave.peak]),
        "wavelength_cm": float(wave.wavelengths_m[wave.peak]) / CM,
        "fit": float(wave.fitted_twr[wave.peak]),
        "free_cm": wave.free_wavelength_m / CM,
    }


def _free(study: ShapingStudy, model: ShapedBeam) -> Figures:
    wave = study.wave(model.name, "displacement", study.data.frequencies_hz[-1])
    share = 100.0 * wave.best_residual
    return {"beam": model.name, "twr": wave.best_twr, "fit": wave.best_fit, "near_fields": share}


def _choices(study: ShapingStudy) -> Figures:
    twr = [one.peak_twr for one in study.choices]
    free = [one.conditioning["displacement"].independence for one in study.choices]
    return {"least": min(twr), "most": max(twr), "least_independence": min(free), "most_independence": max(free)}


def _forces(study: ShapingStudy, model: ShapedBeam) -> Figures:
    last = study.data.frequencies_hz[-1]
    ratios = {
        region: study.confinement(model.name, "displacement", last, region, "in phase").beyond_to_inside
        for region in REGIONS
    }
    return {
        "beam": model.name,
        "ratios": ", ".join(f"{figure(ratio)} {region}" for region, ratio in ratios.items()),
        "harder": ", ".join(region for region, ratio in ratios.items() if ratio > 1.0) or "no region",
    }


def _own_strain(study: ShapingStudy, model: ShapedBeam) -> Figures:
    last, table = study.data.frequencies_hz[-1], model.table
    residual = np.zeros((1, 1)) if table.sensor_residual is None else table.sensor_residual
    share = 100.0 * np.abs(np.diag(residual)) / np.abs(np.diag(sensor_matrix(table, last)))
    return {"least": share.min(), "most": share.max(), "khz": last / KHZ, "modes": table.frequencies_hz.size}


def _follows(study: ShapingStudy, model: ShapedBeam) -> Figures:
    last = study.data.frequencies_hz[-1]
    matrix, laser = model.matrix(last, "calibrated"), model.matrix(last, "displacement")
    missed = []
    for region in REGIONS:
        target = region_target(region, len(matrix))
        moved = laser @ drive_voltages(matrix, target).voltages
        missed.append(100.0 * float(np.linalg.norm(moved - target) / np.linalg.norm(target)))
    return {"least": min(missed), "most": max(missed)}
