"""One beam under shaping: its table over a line of points and over the sensors' places, and the matrices to be inverted."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from geometry.elements import ComplexArray, FloatArray
from solvers.errors import SolverError
from solvers.shaping.modal_table import ModalTable, field_matrix, sensor_matrix
from solvers.shaping.sensor_calibration import Calibration, Measured, calibrate
from solvers.shaping.travelling_wave import free_wavelength_m
from solvers.shaping_study.ideal_beam import point_beam_table
from solvers.shaping_study.patched_beam import PatchedBeam, beam_table, section

Signal = Literal["calibrated", "displacement"]
LINE = 301  # points along the beam


@dataclass(frozen=True)
class ShapedBeam:
    """A beam by name; table: points are 301 along the beam and then the sensors' places; calibration: its sensors', or None.

    Signals: `calibrated`, the sensors' voltages times their factor, what a controller sees; `displacement`, what a laser
    would see under them.
    """

    name: str
    beam: PatchedBeam
    table: ModalTable
    calibration: Calibration | None
    calibrated_on: int | None

    @property
    def line_m(self) -> FloatArray:
        """The points along the beam, m, shape (301,)."""
        return np.asarray(self.table.points_m[:LINE, 0])

    @property
    def places_m(self) -> FloatArray:
        """Centres of the sensors, m, shape (s,)."""
        return np.asarray(self.table.points_m[LINE:, 0])

    @property
    def signals(self) -> tuple[Signal, ...]:
        """The signals this beam has."""
        return ("calibrated", "displacement") if self.calibration else ("displacement",)

    def matrix(self, frequency_hz: float, signal: Signal) -> ComplexArray:
        """T in m/V for a signal, shape (s, a); SolverError as receptance, or for a calibration there is none of."""
        if signal == "displacement":
            return field_matrix(self.table, frequency_hz)[LINE:]
        if self.calibration is None:
            raise SolverError(f"{self.name}: its sensors are not calibrated")
        return np.asarray(self.calibration.factor[:, None] * sensor_matrix(self.table, frequency_hz))

    def field(self, frequency_hz: float) -> ComplexArray:
        """Displacement along the beam per volt, m/V, shape (301, a)."""
        return field_matrix(self.table, frequency_hz)[:LINE]

    def free_wavelength_m(self, frequency_hz: float) -> float:
        """Of a free wave on the bare beam, m."""
        _, _, bending, mass = section(self.beam, False)
        return free_wavelength_m(frequency_hz, bending, mass)


def patched(name: str, beam: PatchedBeam, modes: int, calibrate_near_hz: float) -> ShapedBeam:
    """The beam with its real patches, its sensors calibrated on the mode nearest a frequency on which none is at a node."""
    table = beam_table(beam, modes, _points(beam))
    places = beam_table(beam, modes, np.array(beam.centres_m))
    for mode in np.argsort(np.abs(table.frequencies_hz - calibrate_near_hz), kind="stable"):
        try:
            calibration = calibrate(standing_wave(places, int(mode)))
        except SolverError:
            continue  # a sensor on a node of this mode: the next one
        return ShapedBeam(name, beam, table, calibration, int(mode))
    raise SolverError(f"{name}: on every mode some sensor sits on a node, none can be calibrated")


def pointed(name: str, beam: PatchedBeam, modes: int) -> ShapedBeam:
    """The bare beam with point forces and deflection sensors at the same places."""
    return ShapedBeam(name, beam, point_beam_table(beam, modes, points_m=_points(beam)), None, None)


def standing_wave(places: ModalTable, mode: int) -> Measured:
    """What laser and sensors show at a mode's frequency, 1 to 10 V on the actuator that drives it most."""
    actuator, frequency = int(np.argmax(np.abs(places.actuators[mode]))), float(places.frequencies_hz[mode])
    drives = np.linspace(1.0, 10.0, 10)[:, None]
    shown = (matrix(places, frequency)[:, actuator] for matrix in (field_matrix, sensor_matrix))
    return Measured(*(drives * column for column in shown))


def _points(beam: PatchedBeam) -> FloatArray:
    return np.concatenate([np.linspace(0.0, beam.length_m, LINE), beam.centres_m])
