"""The thesis' statements on shaping beside what the study computes, with a line on each."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from solvers.control.comparison import NEAR, Entry
from solvers.shaping.acoustic_contrast import REGIONS, region_target
from solvers.shaping.inversion import drive_voltages
from solvers.shaping.modal_table import sensor_matrix
from solvers.shaping.transfer_matrix import conditioning
from solvers.shaping.travelling_wave import forward_energy_share, net_flux_share
from solvers.shaping_study.steps import TARGETS

if TYPE_CHECKING:
    from solvers.shaping_study.model import ShapedBeam, Signal
    from solvers.shaping_study.study import ShapingStudy

CONFINED = (3.0, 4.0)  # times, the text's range
PRINTED = {2400.0: 0.46, 2200.0: 0.0092}  # its coupling figures
TWR, WAVELENGTH_M = 0.58, 0.066


def entries(study: ShapingStudy) -> list[Entry]:
    """Confinement, coupling, travelling wave, energy, modes, phase of a measuring step, forces, and what is beyond the text."""
    real, long_points, _, simulated = study.beams
    lines = [
        _confinement(study, beam, "displacement", region) for beam in (simulated, long_points) for region in REGIONS
    ]
    lines += [_confinement(study, real, signal, region) for signal in real.signals for region in REGIONS]
    both = [(model, signal) for model in (real, long_points) for signal in model.signals]
    lines += [_coupling(model, f, signal) for f in study.data.frequencies_hz for model, signal in both]
    lines += [_wave(study, model, signal) for model, signal in both]
    lines += [_free(study, model) for model in (real, long_points)]
    lines += [_chosen(study), _energy(), _modes(real), _step(), _forces(study, simulated)]
    return [*lines, _own_strain(study, real), _follows(study, real), *_beyond(study)]


def _confinement(study: ShapingStudy, model: ShapedBeam, signal: Signal, region: str) -> Entry:
    last = study.data.frequencies_hz[-1]
    contrast = {name: study.confinement(model.name, signal, last, region, name) for name in TARGETS}
    best = max(contrast.values(), key=lambda one: one.peak_ratio)
    ratios = ", ".join(f"{one.peak_ratio:.2f} {name}" for name, one in contrast.items())
    ours = f"{ratios}; any voltages: {best.best_contrast_db:.1f} dB rms"
    low, high = CONFINED
    ratio = best.peak_ratio
    near = low * (1.0 - NEAR) <= ratio <= high * (1.0 + NEAR)
    differs = f"differs: {ratio:.2f} is {'above' if ratio > high else 'below'} the range"
    verdict = f"agrees within {100.0 * NEAR:.0f} % of the range" if near else differs
    return Entry(f"confined {region}, {model.name}, {signal}, {last / 1e3:g} kHz", "3-4 times", ours, verdict)


def _coupling(model: ShapedBeam, frequency_hz: float, signal: Signal) -> Entry:
    coupling = conditioning(model.matrix(frequency_hz, signal))
    ours = (
        f"coupling {coupling.coupling:.3f}, independence {coupling.independence:.3f}, "
        f"condition number {coupling.condition:.1f}"
    )
    printed = PRINTED.get(frequency_hz)
    name = f"coupling at {frequency_hz / 1e3:g} kHz, {model.name}, {signal}"
    if printed is None:
        return Entry(name, "not given", ours, "no figure to compare")
    near = abs(coupling.independence / printed - 1.0) <= NEAR
    peak = float(model.table.frequencies_hz[model.table.nearest(frequency_hz)])
    ours += f"; on the mode at {peak:.0f} Hz independence {conditioning(model.matrix(peak, signal)).independence:.4f}"
    word = "agrees" if near else "differs"
    verdict = f"{word}: read as an independence, ours is {coupling.independence / printed:.2g} times it"
    return Entry(name, f"{printed:g}", ours, verdict)


def _wave(study: ShapingStudy, model: ShapedBeam, signal: Signal) -> Entry:
    wave = study.wave(model.name, signal, study.data.frequencies_hz[-1])
    length, ratio = float(wave.wavelengths_m[wave.peak]), float(wave.twr[wave.peak])
    ours = (
        f"{ratio:.2f} at {100.0 * length:.1f} cm (two-wave fit {float(wave.fitted_twr[wave.peak]):.2f}); "
        f"free wave on the bare beam {100.0 * wave.free_wavelength_m:.1f} cm"
    )
    near = abs(length / WAVELENGTH_M - 1.0) <= NEAR and abs(ratio / TWR - 1.0) <= NEAR
    differs = f"differs: TWR {ratio - TWR:+.2f}, wavelength {100.0 * (length - WAVELENGTH_M):+.1f} cm"
    verdict = f"agrees within {100.0 * NEAR:.0f} %" if near else differs
    return Entry(f"best TWR over wavelength, {model.name}, {signal}", "0.58 at 6.6 cm", ours, verdict)


def _free(study: ShapingStudy, model: ShapedBeam) -> Entry:
    wave = study.wave(model.name, "displacement", study.data.frequencies_hz[-1])
    ours = (
        f"{wave.best_twr:.3f}; two-wave fit {wave.best_fit:.3f}, near fields {100.0 * wave.best_residual:.0f} % of rms"
    )
    near = wave.best_twr >= 1.0 - NEAR
    verdict = "agrees" if near else "agrees for the two waves alone" if wave.best_fit >= 1.0 - NEAR else "differs"
    return Entry(f"TWR with phases and amplitudes free, {model.name}", "could approach 1", ours, verdict)


def _chosen(study: ShapingStudy) -> Entry:
    twr = [one.peak_twr for one in study.choices]
    free = [one.conditioning["displacement"].independence for one in study.choices]
    ours = f"TWR {min(twr):.2f}-{max(twr):.2f}, independence {min(free):.2f}-{max(free):.2f}"
    within = "within" if min(twr) <= TWR <= max(twr) else "outside"
    name = "the same over pitches L/6 ... L/7 and quality 20 ... 200, displacement"
    return Entry(name, "pitch and loss not given", ours, f"the text's TWR lies {within} what the open choices span")


def _energy() -> Entry:
    forward, net = 100.0 * forward_energy_share(TWR), 100.0 * net_flux_share(TWR)
    ours = f"forward wave {forward:.0f} % of the two, net flux {net:.0f} % of the forward wave's"
    return Entry(
        "energy of the travelling part at TWR 0.58", "about 60 %", ours, "differs: the ratio is one of amplitudes"
    )


def _modes(real: ShapedBeam) -> Entry:
    modes = real.table.frequencies_hz
    near = abs(modes[5] / 2200.0 - 1.0) <= NEAR
    ours = f"four antinodes {modes[3]:.0f} Hz, six antinodes {modes[5]:.0f} Hz with patches"
    verdict = "agrees" if near else "differs: six antinodes at 2.2 kHz do not fit this beam"
    return Entry("mode with six antinodes", "2.2 kHz", ours, verdict)


def _step() -> Entry:
    low, high = (360.0 * 3e-3 / length for length in (0.074, 0.059))
    ours = f"{low:.0f}-{high:.0f} degrees for 7.4 to 5.9 cm"
    return Entry("phase of a 3 mm measuring step", "20-30 degrees", ours, "differs: the step is smaller than stated")


def _forces(study: ShapingStudy, model: ShapedBeam) -> Entry:
    last = study.data.frequencies_hz[-1]
    simulated_levels = {
        region: study.confinement(model.name, "displacement", last, region, "in phase").beyond_to_inside
        for region in REGIONS
    }
    ours = "largest force beyond over inside: " + ", ".join(
        f"{ratio:.2f} {region}" for region, ratio in simulated_levels.items()
    )
    harder = [region for region, ratio in simulated_levels.items() if ratio > 1.0]
    verdict = f"agrees with the simulation for: {', '.join(harder) or 'no region'}"
    name = f"actuators beyond the region push harder, {model.name}"
    return Entry(name, "yes in simulation, no on the bench", ours, verdict)


def _own_strain(study: ShapingStudy, model: ShapedBeam) -> Entry:
    last, table = study.data.frequencies_hz[-1], model.table
    residual = np.zeros((1, 1)) if table.sensor_residual is None else table.sensor_residual
    share = 100.0 * np.abs(np.diag(residual)) / np.abs(np.diag(sensor_matrix(table, last)))
    modes = table.frequencies_hz.size
    ours = (
        f"{share.min():.0f}-{share.max():.0f} % of T_kk at {last / 1e3:g} kHz comes from no mode of the first {modes}"
    )
    verdict = (
        "differs from a deflection sensor: strain under the driven patch makes T easy to invert and says little of w"
    )
    return Entry("what a sensor hears of the patch beside it", "not treated", ours, verdict)


def _follows(study: ShapingStudy, model: ShapedBeam) -> Entry:
    last = study.data.frequencies_hz[-1]
    matrix, laser = model.matrix(last, "calibrated"), model.matrix(last, "displacement")
    missed = []
    for region in REGIONS:
        target = region_target(region, len(matrix))
        moved = laser @ drive_voltages(matrix, target).voltages
        missed.append(100.0 * float(np.linalg.norm(moved - target) / np.linalg.norm(target)))
    ours = f"{min(missed):.0f}-{max(missed):.0f} % of the target is missed while every sensor reads it exactly"
    verdict = "agrees" if max(missed) <= 100.0 * NEAR else "differs: a calibration holds for the wave it was made on"
    return Entry("displacement under sensors calibrated on a standing wave", "follows the reference", ours, verdict)


def _beyond(study: ShapingStudy) -> list[Entry]:
    regions_beyond = []
    for model in study.beams[:2]:
        pair, both = study.pairs[model.name], study.resonators[model.name].as_json()
        modes = f"modes {pair.modes[0] + 1} and {pair.modes[1] + 1} at {pair.frequency_hz:.0f} Hz"
        ours = f"TWR {pair.twr:.2f} in the middle third with {modes}"
        regions_beyond.append(
            Entry(f"two modes a quarter period apart, {model.name}", "not treated", ours, "beyond the text")
        )
        levels = ", ".join(f"{key.removesuffix('_db')} {value:.1f} dB" for key, value in both.items())
        regions_beyond.append(
            Entry(f"resonators and patches together, {model.name}", "not treated", levels, "beyond the text")
        )
    return regions_beyond
