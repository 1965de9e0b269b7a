"""The shaping study as a plain document."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.elements import ComplexArray
from solvers.shaping.monte_carlo import quantiles
from solvers.shaping.transfer_matrix import operating_frequencies
from solvers.shaping.travelling_wave import forward_energy_share, net_flux_share
from solvers.shaping_study.model import LINE, ShapedBeam
from solvers.shaping_study.study import ASSUMPTIONS, ShapingStudy, bare_modes_hz

if TYPE_CHECKING:
    from solvers.shaping_study.steps import Travelling
    from solvers.shaping_study.study import Choice


def document(study: ShapingStudy) -> dict[str, Any]:
    """Everything the study holds, in SI; complex numbers as {abs, phase_rad}."""
    data = study.data
    return {
        "schema": 1,
        "assumptions": list(ASSUMPTIONS),
        "errors_assumed": asdict(data.errors),
        "limit_v": data.limit_v,
        "beams": [_beam(one) for one in study.beams],
        "conditioning": [
            {
                "beam": name,
                "signal": signal,
                "best_hz": operating_frequencies(scan).tolist(),
                "frequencies_hz": scan.frequencies_hz.tolist(),
                "condition": scan.condition.tolist(),
                "coupling": scan.coupling.tolist(),
                "independence": (1.0 - scan.coupling).tolist(),
            }
            for (name, signal), scan in study.scans.items()
        ],
        "choices": [_choice(one) for one in study.choices],
        "confinement": [asdict(one) for one in study.confinements],
        "travelling": [_travelling(one) for one in study.travelling],
        "errors": [
            {"beam": name, "signal": signal, **{key: quantiles(values) for key, values in vars(trials).items()}}
            for (name, signal), trials in study.trials.items()
        ],
        "filter": _filter(study),
        "mode_pairs": _pairs(study),
        "passive_and_active": [{"beam": name, **one.to_dict()} for name, one in study.resonators.items()],
    }


def _filter(study: ShapingStudy) -> dict[str, Any]:
    data = study.data
    return {
        "inductance_h": study.filter.inductance_h,
        "resistance_ohm": study.filter.resistance_ohm,
        "capacitance_f": study.filter.capacitance_f,
        "corner_hz": study.filter.corner_hz,
        "pwm_ripple": abs(study.filter.response(data.pwm_hz)),
        "compensation": [
            {"frequency_hz": f, **_complex(np.array(study.filter.compensation(f)))} for f in data.frequencies_hz
        ],
        "compensation_error_of_moving_patches": study.filter_error,
    }


def _pairs(study: ShapingStudy) -> list[dict[str, Any]]:
    return [
        {
            "beam": name,
            "modes": [pair.modes[0] + 1, pair.modes[1] + 1],
            "frequency_hz": pair.frequency_hz,
            "twr": pair.twr,
            "twr_of_the_two_modes_alone": pair.alone,
            "wavenumber_rad_m": pair.wavenumber,
            "voltages_relative": _complex(pair.drive.voltages / np.abs(pair.drive.voltages).max()),
        }
        for name, pair in study.pairs.items()
    ]


def _beam(model: ShapedBeam) -> dict[str, Any]:
    beam, table = model.beam, model.table
    shape = table.field[:8, :LINE]
    peaks = (np.abs(shape[:, 1:-1]) > np.abs(shape[:, :-2])) & (np.abs(shape[:, 1:-1]) >= np.abs(shape[:, 2:]))
    calibration = model.calibration
    return {
        "name": model.name,
        "length_m": beam.length_m,
        "width_m": beam.width_m,
        "thickness_m": beam.thickness_m,
        "material": beam.material.name,
        "piezo": beam.piezo.name,
        "centres_m": list(beam.centres_m),
        "quality_factor": beam.quality_factor,
        "modes_hz": table.frequencies_hz[:8].tolist(),
        "antinodes": peaks.sum(axis=1).tolist(),
        "bare_modes_hz": bare_modes_hz(beam, 8).tolist(),
        "calibration": None
        if calibration is None or model.calibrated_on is None
        else {
            "mode_hz": float(table.frequencies_hz[model.calibrated_on]),
            "m_per_v": _complex(calibration.factor),
            "common_phase_rad": calibration.common_phase,
        },
    }


def _choice(one: Choice) -> dict[str, Any]:
    return {
        "pitch_m": one.pitch_m,
        "quality_factor": one.quality_factor,
        "peak_twr": one.peak_twr,
        "peak_wavelength_m": one.peak_wavelength_m,
        **{
            signal: {"condition": coupling.condition, "independence": coupling.independence}
            for signal, coupling in one.conditioning.items()
        },
    }


def _travelling(one: Travelling) -> dict[str, Any]:
    ratio = float(one.twr[one.peak])
    return {
        "beam": one.beam,
        "signal": one.signal,
        "frequency_hz": one.frequency_hz,
        "window_m": list(one.window_m),
        "free_wavelength_m": one.free_wavelength_m,
        "wavelengths_m": one.wavelengths_m.tolist(),
        "twr": one.twr.tolist(),
        "swr": (1.0 - one.twr).tolist(),
        "fitted_twr": one.fitted_twr.tolist(),
        "peak": {
            "wavelength_m": float(one.wavelengths_m[one.peak]),
            "twr": ratio,
            "forward_energy_share": forward_energy_share(ratio),
            "net_flux_over_forward": net_flux_share(ratio),
        },
        "free": {
            "twr": one.best_twr,
            "fitted_twr": one.best_fit,
            "near_field_share": one.best_residual,
            "voltages_relative": _complex(one.best_voltages),
        },
    }


def _complex(values: ComplexArray) -> dict[str, Any]:
    return {"abs": np.abs(values).tolist(), "phase_rad": np.angle(values).tolist()}
