"""Sensors calibrated on a standing wave: each sensor's voltage against the displacement under it, over several amplitudes.

w = c V with a complex c per sensor: |c| in m/V, and the phase that the measuring chain adds. c belongs to the wave it was
measured on: a patch answers strain, whose ratio to displacement changes with wavelength and beside a driven patch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.errors import SolverError

NODE = 0.05  # of the largest amplitude: a sensor below it stands too near a node to be calibrated on this wave


@dataclass(frozen=True)
class Measured:
    """n amplitudes of one standing wave at s sensors: displacement (n, s) in m, voltage (n, s) in V, complex."""

    displacement: ComplexArray
    voltage: ComplexArray


@dataclass(frozen=True)
class Calibration:
    """Per sensor (s,): factor c in m/V; standard_error of c, m/V; nonlinearity, |residual|/|w| (rms).

    common_phase is what all sensors share (the chain's delay), rad; own_phase (s,) is what is left, rad.
    """

    factor: ComplexArray
    standard_error: FloatArray
    nonlinearity: FloatArray
    common_phase: float
    own_phase: FloatArray


def calibrate(measured: Measured) -> Calibration:
    """c = sum conj(V) w/sum |V|^2 over the amplitudes. common_phase + own_phase = arg c; needs no sign of the wave.

    SolverError below two amplitudes, for shapes that differ, and for a sensor that stands on a node of the wave.
    """
    w, v = measured.displacement, measured.voltage
    if w.ndim != 2 or w.shape != v.shape or not w.size:
        raise SolverError(
            f"calibration: displacement {w.shape} and voltage {v.shape} must be (amplitudes, sensors) alike"
        )
    if len(w) < 2:
        raise SolverError("calibration: one amplitude cannot show that a sensor is linear; measure two or more")
    _refuse_nodes(w, "moves")
    _refuse_nodes(v, "answers")
    power = np.sum(np.abs(v) ** 2, axis=0)
    factor = np.sum(v.conj() * w, axis=0) / power
    residual = np.sqrt(np.sum(np.abs(w - factor * v) ** 2, axis=0))
    common = np.sum(factor / np.abs(factor))
    return Calibration(
        factor=factor,
        standard_error=residual / np.sqrt(power * (len(w) - 1)),
        nonlinearity=residual / np.sqrt(np.sum(np.abs(w) ** 2, axis=0)),
        common_phase=float(np.angle(common)),
        own_phase=np.angle(factor * np.exp(-1j * np.angle(common))),
    )


def _refuse_nodes(values: ComplexArray, verb: str) -> None:
    size = np.sqrt(np.mean(np.abs(values) ** 2, axis=0))
    low = np.flatnonzero(size <= NODE * size.max())
    if low.size:
        raise SolverError(
            f"calibration: sensor {low[0] + 1} sits on a node of this wave (it {verb} {size[low[0]]:.3g} against "
            f"{size.max():.3g} elsewhere); use another mode or move it"
        )
