"""Beams with six actuators and six sensors, for the six-channel build.

`Structure` is any plate or beam given by its modes. `Beam` is a clamped Euler-Bernoulli beam with point forces and
point sensors of displacement: w_n = (k_n/L)^2 sqrt(E h^2 / (12 rho)), cos k cosh k = 1. Amplitudes are fractions of
full scale; a gain on the drives sets the largest |T| at one frequency.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware.mode_table import CHANNELS, ModeTable, Pattern, Shape, hold, to_bytes

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


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
        stiffness = math.sqrt(self.young_pa * self.thickness_m**2 / (12.0 * self.density_kg_m3))
        return np.asarray((_clamped_roots(self.modes) / self.length_m) ** 2 * stiffness)

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


def measured_table(beam: Beam) -> bytes:
    """Make a table with the beam's matrix as measured by the board; patterns: all sensors equal, only the first."""
    matrix = beam.matrix(beam.frequency_hz) * hold(beam.frequency_hz, beam.sample_rate_hz)
    patterns = Pattern("all", (1.0,) * CHANNELS), Pattern("first", (1.0, *(0.0,) * (CHANNELS - 1)))
    shape = Shape(beam.frequency_hz, beam.slowest_s, patterns, tuple(map(tuple, matrix.tolist())))
    return to_bytes(ModeTable(beam.sample_rate_hz, bytes(16), shapes=(shape,)))


def _clamped_roots(count: int) -> Floats:
    """Return the first roots of cos k cosh k = 1, by Newton's method on cos k - 1/cosh k from (n + 1/2) pi."""
    k = (np.arange(1, count + 1) + 0.5) * math.pi
    for _ in range(8):
        k = k - (np.cos(k) - 1.0 / np.cosh(k)) / (-np.sin(k) + np.tanh(k) / np.cosh(k))
    return np.asarray(k)


class BeamSimulation:
    """Time-domain simulation of a Beam or Structure, exact for drives held between samples."""

    ROWS = 64  # of noise, drawn at once

    def __init__(self, beam: Beam | Structure, seed: int = 1) -> None:
        self.beam = beam.structure if isinstance(beam, Beam) else beam
        pole = self.beam.poles
        step = 1.0 / self.beam.sample_rate_hz
        self.decay = np.exp(pole * step)
        self.push = ((self.decay - 1.0) / pole)[:, None] * self.beam.actuators
        self.pull = self.beam.sensors.T / pole.imag
        self.state = np.zeros(len(pole), complex)
        self.at_once = np.zeros(CHANNELS)
        self.random = np.random.default_rng(seed)
        self.noise: list[Floats] = []

    def sense(self) -> Floats:
        """Return the signals of the six sensors at this sample, as fractions of full scale."""
        levels = self.pull @ self.state.imag + self.at_once
        if not self.beam.noise:
            return levels
        if not self.noise:
            self.noise = list(self.random.normal(0.0, self.beam.noise, (self.ROWS, CHANNELS)))
        return levels + self.noise.pop()

    def drive(self, levels: Floats) -> None:
        """Hold six drives from now to the next sample."""
        self.state = self.decay * self.state + self.push @ levels
        if self.beam.residual is not None:
            self.at_once = self.beam.residual @ levels


def adc_codes(levels: Floats) -> list[int]:
    """Convert fractions of full scale to 12-bit codes, clipped at the ends."""
    codes = [int(code) for code in (levels * 2048.0 + 2048.5).tolist()]
    if min(codes) < 0 or max(codes) > 4095:
        codes = [min(max(code, 0), 4095) for code in codes]
    return codes
