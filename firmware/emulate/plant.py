"""Simulated plate of the single-mode build and beams of the six-channel build, between the converters.

Each resonance obeys x'' + (w0/Q) x' + w0^2 x = u, with the output y = gain (w0/Q) dx/dt (velocity) or y = gain (w0^2/Q)
x (displacement), so that |y/u| = |gain| at w0. The drive is held between samples and delayed by a dead time of any
length; the solution is exact.

`Structure` is any plate or beam given by its modes. `Beam` is a clamped Euler-Bernoulli beam with point forces and point
sensors of displacement: w_n = (k_n/L)^2 sqrt(E h^2 / (12 rho)), cos k cosh k = 1. Amplitudes are fractions of full scale; a
gain on the drives sets the largest |T| at one frequency.
"""

from __future__ import annotations

import cmath
import math
import random
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware.mode_table import CHANNELS, ModeTable, Pattern, Shape, from_bytes, hold, to_bytes

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True)
class Resonance:
    """Resonance: frequency in Hz, time constant of the amplitude in s, and dimensionless response at resonance."""

    frequency_hz: float
    tau_s: float
    gain: float


@dataclass(frozen=True)
class Plate:
    """Plate as seen by the emulated board.

    Attributes
    ----------
    resonances : tuple of Resonance
    displacement : bool
        Whether the sensor follows displacement rather than velocity.
    delay_s : float
        Dead time between DAC and ADC, in addition to the hold, in s.
    noise, offset : float
        RMS noise and offset of the sensor, as fractions of full scale.
    feedthrough : float
        Direct coupling from drive to sensor.
    sample_rate_hz : float
    """

    resonances: tuple[Resonance, ...]
    displacement: bool = True
    delay_s: float = 0.0
    noise: float = 0.0
    offset: float = 0.0
    feedthrough: float = 0.0
    sample_rate_hz: float = 250e3


@dataclass(frozen=True)
class Assumed:
    """Assumptions about values that a table may lack: gains of the target mode and of the others, without unit.

    scale multiplies every frequency, because a real plate differs from the computed one.
    """

    target_gain: float = 0.8
    other_gain: float = 0.04
    scale: float = 1.002


class PlateSimulation:
    """Time-domain simulation of a Plate: per sample, one call of sense and then one of drive."""

    def __init__(self, plate: Plate, seed: int = 1) -> None:
        self.plate = plate
        self.period_s = 1.0 / plate.sample_rate_hz
        self.poles = [_pole(resonance) for resonance in plate.resonances]
        self.residues = [_residue(resonance, plate.displacement) for resonance in plate.resonances]
        self.states = [0j] * len(self.poles)
        self.decays = [cmath.exp(pole * self.period_s) for pole in self.poles]
        # The dead time is whole samples plus a part, during which the older of two drives still acts in each sample.
        whole, part = divmod(plate.delay_s / self.period_s, 1.0)
        late_s = part * self.period_s
        self.push_new = [_hold_response(pole, self.period_s - late_s) for pole in self.poles]
        self.push_old = [
            _hold_response(pole, self.period_s) - new for pole, new in zip(self.poles, self.push_new, strict=True)
        ]
        self.line = [0.0] * (int(whole) + 2)
        self.random = random.Random(seed)

    def sense(self) -> float:
        """Return the sensor signal at this sample, as a fraction of full scale."""
        level = sum((residue * state).real for residue, state in zip(self.residues, self.states, strict=True))
        noise = self.random.gauss(0.0, self.plate.noise) if self.plate.noise else 0.0
        return level + self.plate.feedthrough * self.line[1] + self.plate.offset + noise

    def drive(self, level: float) -> None:
        """Hold a drive from now to the next sample."""
        self.line.append(level)
        del self.line[0]
        old, new = self.line[0], self.line[1]
        for index, state in enumerate(self.states):
            self.states[index] = self.decays[index] * state + self.push_new[index] * new + self.push_old[index] * old


@dataclass(frozen=True)
class Structure:
    """Modal model of six drives and six sensors: T = sensors' diag(1 / (w_m^2 - w^2 + i w w_m/Q)) actuators + residual.

    Attributes
    ----------
    angular : ndarray, shape (m,)
        Angular frequencies w_m in rad/s.
    quality_factor : float
        Q, the same for all modes.
    actuators, sensors : ndarray, shape (m, 6)
        Mode shapes at actuators and sensors, scaled so that T is full scale over full scale.
    residual : ndarray, shape (6, 6), optional
        Instantaneous response.
    noise : float
        RMS noise of the sensors, as a fraction of full scale.
    sample_rate_hz : float
    """

    angular: Floats
    quality_factor: float
    actuators: Floats
    sensors: Floats
    residual: Floats | None = None
    noise: float = 0.0
    sample_rate_hz: float = 40e3

    @property
    def slowest_s(self) -> float:
        """Longest time constant of an amplitude, tau = 2 Q / w_1, in s."""
        return float(2.0 * self.quality_factor / self.angular.min())

    def matrix(self, frequency_hz: float) -> Complexes:
        """Transfer matrix T, sensors over drives, (6, 6), at a frequency in Hz."""
        omega = 2.0 * math.pi * frequency_hz
        modal = 1.0 / (self.angular**2 - omega**2 + 1j * omega * self.angular / self.quality_factor)
        residual = 0.0 if self.residual is None else self.residual
        return np.asarray(np.einsum("ms,m,ma->sa", self.sensors, modal, self.actuators) + residual)

    def sampled_matrix(self, frequency_hz: float) -> Complexes:
        """Transfer matrix T, (6, 6), as measured with drives held between samples and sensors read before each change.

        The modes are discretised exactly, including images about the sample rate; the residual responds one sample
        late.
        """
        pole = self.poles
        step, turn = 1.0 / self.sample_rate_hz, np.exp(2j * math.pi * frequency_hz / self.sample_rate_hz)
        decay = np.exp(pole * step)
        push = (decay - 1.0) / pole
        modal = (push / (turn - decay) - push.conj() / (turn - decay.conj())) / (2j * pole.imag)
        residual = 0.0 if self.residual is None else self.residual / turn
        return np.asarray(np.einsum("ms,m,ma->sa", self.sensors, modal, self.actuators) + residual)

    @property
    def poles(self) -> Complexes:
        """Upper pole of each mode, in rad/s."""
        rate = self.angular / (2.0 * self.quality_factor)
        return np.asarray(-rate + 1j * np.sqrt(self.angular**2 - rate**2))


@dataclass(frozen=True)
class Beam:
    """Clamped beam in SI units.

    quality_factor applies to all modes; largest is the largest |T| at frequency_hz; noise is rms, as a fraction of full
    scale.
    """

    length_m: float = 0.150
    thickness_m: float = 1e-3
    young_pa: float = 210e9
    density_kg_m3: float = 7850.0
    quality_factor: float = 50.0
    modes: int = 12
    frequency_hz: float = 2400.0
    largest: float = 0.5
    noise: float = 0.0
    sample_rate_hz: float = 40e3

    @property
    def places_m(self) -> Floats:
        """Positions of the six actuators and sensors, equally spaced along the beam, in m."""
        return np.asarray(self.length_m * np.arange(1, CHANNELS + 1) / (CHANNELS + 1))

    @property
    def angular(self) -> Floats:
        """Angular frequencies of the modes, in rad/s."""
        return np.asarray((_clamped_roots(self.modes) / self.length_m) ** 2 * self.stiffness)

    @property
    def stiffness(self) -> float:
        """sqrt(EI/(rho A)), angular frequency over the square of the wavenumber, in m2/s."""
        return math.sqrt(self.young_pa * self.thickness_m**2 / (12.0 * self.density_kg_m3))

    @property
    def slowest_s(self) -> float:
        """Longest time constant of an amplitude, in s."""
        return self.structure.slowest_s

    def shapes(self, at_m: Floats) -> Floats:
        """Mode shapes (modes, places), with an rms of 1 along the beam.

        Even shapes are cosh(k s)/cosh(k/2) - cos(k s)/cos(k/2), odd ones the same with sinh and sin, with s measured
        from the middle. This form avoids the difference of large numbers at high modes. The mean square equals
        (w''/k^2)^2/4 at a clamp, which is 1.
        """
        roots = _clamped_roots(self.modes)[:, None]
        s = at_m[None, :] / self.length_m - 0.5
        grown, mirrored = np.exp(roots * (np.abs(s) - 0.5)), np.exp(-2.0 * roots * np.abs(s))
        even = grown * (1.0 + mirrored) / (1.0 + np.exp(-roots)) - np.cos(roots * s) / np.cos(roots / 2.0)
        steep = np.sign(s) * grown * (1.0 - mirrored) / (1.0 - np.exp(-roots))
        odd = np.sin(roots * s) / np.sin(roots / 2.0) - steep
        return np.where(np.arange(self.modes)[:, None] % 2 == 0, even, odd)

    @property
    def gain(self) -> float:
        """Modal force per drive, chosen so that max |T(frequency_hz)| = largest."""
        return self.largest / float(np.abs(self._by_modes(1.0, self.places_m).matrix(self.frequency_hz)).max())

    @property
    def structure(self) -> Structure:
        """Modal model of the beam."""
        return self._by_modes(self.gain, self.places_m)

    def matrix(self, frequency_hz: float, at_m: Floats | None = None) -> Complexes:
        """Displacement over drives, (places, 6), at a frequency; by default at the sensors."""
        return self._by_modes(self.gain, self.places_m if at_m is None else at_m).matrix(frequency_hz)

    def _by_modes(self, gain: float, at_m: Floats) -> Structure:
        actuators = gain * self.shapes(self.places_m)
        return Structure(
            self.angular, self.quality_factor, actuators, self.shapes(at_m), None, self.noise, self.sample_rate_hz
        )


class BeamSimulation:
    """Time-domain simulation of a Beam or Structure, exact for drives held between samples."""

    ROWS = 64  # of noise, drawn at once

    def __init__(self, beam: Beam | Structure, seed: int = 1) -> None:
        self.become(beam.structure if isinstance(beam, Beam) else beam)
        self.state = np.zeros(len(self.decay), complex)
        self.softening = np.zeros(len(self.decay))  # decrease of a mode's phase per sample, rad, over its amplitude
        self.at_once = np.zeros(CHANNELS)
        self.random = np.random.default_rng(seed)
        self.noise: list[Floats] = []

    def become(self, beam: Structure) -> None:
        """Replace the modal model; the motion continues."""
        self.beam, pole = beam, beam.poles
        self.decay = np.exp(pole / beam.sample_rate_hz)
        self.push = ((self.decay - 1.0) / pole)[:, None] * beam.actuators
        self.pull = beam.sensors.T / pole.imag

    @property
    def motion(self) -> Floats:
        """Motion at the six sensors, without crosstalk and noise, as fractions of full scale."""
        return np.asarray(self.pull @ self.state.imag)

    def sense(self) -> Floats:
        """Return the signals of the six sensors at this sample, as fractions of full scale."""
        levels = self.motion + self.at_once
        if not self.beam.noise:
            return levels
        if not self.noise:
            self.noise = list(self.random.normal(0.0, self.beam.noise, (self.ROWS, CHANNELS)))
        return levels + self.noise.pop()

    def drive(self, levels: Floats) -> None:
        """Hold six drives from now to the next sample."""
        self.state = self.decay * self.state + self.push @ levels
        if self.softening.any():
            self.state *= np.exp(-1j * self.softening * np.abs(self.state))
        if self.beam.residual is not None:
            self.at_once = self.beam.residual @ levels


def plate_from_table(data: bytes, assumed: Assumed | None = None, **imperfections: Any) -> Plate:
    """Make the plate described by a table.

    Parameters
    ----------
    data : bytes
        Mode table.
    assumed : Assumed, optional
        Values for those missing in the table.
    **imperfections
        Fields of Plate to replace, such as noise.

    Returns
    -------
    Plate
    """
    table = from_bytes(data)
    plate = Plate(
        tuple(_resonance(table, index, assumed or Assumed()) for index in range(len(table.modes))),
        displacement=table.senses_displacement,
        delay_s=max(table.modes[table.target].delay_s - 0.5 / table.sample_rate_hz, 0.0),
        sample_rate_hz=table.sample_rate_hz,
    )
    return replace(plate, **imperfections)


def adc_code(level: float) -> int:
    """Convert a fraction of full scale to a 12-bit code, clipped at the ends."""
    return min(max(math.floor(level * 2048.0 + 2048.5), 0), 4095)


def dac_level(code: int) -> float:
    """Convert a 12-bit code to a fraction of full scale."""
    return (code - 2048) / 2047.0


def measured_table(beam: Beam, *own: Pattern) -> bytes:
    """Make a table with the beam's matrix as measured by the board; patterns, or: all sensors equal, only the first."""
    matrix = beam.matrix(beam.frequency_hz) * hold(beam.frequency_hz, beam.sample_rate_hz)
    patterns = own or (Pattern("all", (1.0,) * CHANNELS), Pattern("first", (1.0, *(0.0,) * (CHANNELS - 1))))
    shape = Shape(beam.frequency_hz, beam.slowest_s, patterns, tuple(map(tuple, matrix.tolist())))
    return to_bytes(ModeTable(beam.sample_rate_hz, bytes(16), shapes=(shape,)))


def adc_codes(levels: Floats) -> list[int]:
    """Convert fractions of full scale to 12-bit codes, clipped at the ends."""
    codes = [int(code) for code in (levels * 2048.0 + 2048.5).tolist()]
    if min(codes) < 0 or max(codes) > 4095:
        codes = [min(max(code, 0), 4095) for code in codes]
    return codes


def _resonance(table: ModeTable, index: int, assumed: Assumed) -> Resonance:
    mode, gain = table.modes[index], assumed.target_gain if index == table.target else assumed.other_gain
    if mode.gain is not None:
        turned = mode.gain * (1j if table.senses_displacement else 1.0)  # real
        gain = math.copysign(abs(turned), turned.real) / abs(hold(mode.frequency_hz, table.sample_rate_hz))
    return Resonance(mode.frequency_hz * assumed.scale, mode.tau_s, gain)


def _pole(resonance: Resonance) -> complex:
    rate = 1.0 / resonance.tau_s
    omega = 2.0 * math.pi * resonance.frequency_hz
    return complex(-rate, math.sqrt(omega**2 - rate**2))


def _residue(resonance: Resonance, displacement: bool) -> complex:
    """Return twice the residue of the upper pole p: y = Re(residue z), z' = p z + u."""
    pole = _pole(resonance)
    omega = 2.0 * math.pi * resonance.frequency_hz
    width = 2.0 / resonance.tau_s
    numerator = omega * width if displacement else width * pole
    return 2.0 * resonance.gain * numerator / (pole - pole.conjugate())


def _hold_response(pole: complex, seconds: float) -> complex:
    """Response of z' = p z + u to u = 1 held for a time, from z = 0."""
    return (cmath.exp(pole * seconds) - 1.0) / pole


def _clamped_roots(count: int) -> Floats:
    """Return the first roots of cos k cosh k = 1, by Newton's method on cos k - 1/cosh k from (n + 1/2) pi."""
    k = (np.arange(1, count + 1) + 0.5) * math.pi
    for _ in range(8):
        k = k - (np.cos(k) - 1.0 / np.cosh(k)) / (-np.sin(k) + np.tanh(k) / np.cosh(k))
    return np.asarray(k)
