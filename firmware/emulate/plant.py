"""The plate between the DAC's pin and the ADC's: resonances, a dead time, noise, and the converters' codes.

Each resonance has y = gain (w0/Q) dx/dt (velocity) or gain (w0^2/Q) x (displacement), x'' + (w0/Q) x' + w0^2 x = u, so that
|y/u| = |gain| at w0. Between two samples the drive is held, delayed by a dead time of any length: solved exactly.
"""

from __future__ import annotations

import cmath
import math
import random
from dataclasses import dataclass, replace
from typing import Any

from firmware.mode_table import ModeTable, from_bytes, hold


@dataclass(frozen=True)
class Resonance:
    """frequency_hz in Hz, tau_s the decay time of the amplitude in s, gain the response at resonance, without unit."""

    frequency_hz: float
    tau_s: float
    gain: float


@dataclass(frozen=True)
class Plate:
    """What the emulated board drives: resonances, whether the sensor follows displacement, and the imperfections.

    delay_s, the dead time between DAC and ADC beyond the hold, in s; noise, rms of the sensor's noise in full scales; offset,
    the sensor's rest level in full scales; feedthrough, what reaches the sensor past the plate.
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
    """What a table may leave open: gains of the target mode and of the others, and how far the real plate is off.

    Gains without unit; scale multiplies every frequency, for no plate is quite the one that was computed.
    """

    target_gain: float = 0.8
    other_gain: float = 0.04
    scale: float = 1.002


def plate_from_table(data: bytes, assumed: Assumed | None = None, **imperfections: Any) -> Plate:
    """The plate a table describes; what it leaves open is assumed."""
    table = from_bytes(data)
    plate = Plate(
        tuple(_resonance(table, index, assumed or Assumed()) for index in range(len(table.modes))),
        displacement=table.senses_displacement,
        delay_s=max(table.modes[table.target].delay_s - 0.5 / table.sample_rate_hz, 0.0),
        sample_rate_hz=table.sample_rate_hz,
    )
    return replace(plate, **imperfections)


def _resonance(table: ModeTable, index: int, assumed: Assumed) -> Resonance:
    mode, gain = table.modes[index], assumed.target_gain if index == table.target else assumed.other_gain
    if mode.gain is not None:
        turned = mode.gain * (1j if table.senses_displacement else 1.0)  # real
        gain = math.copysign(abs(turned), turned.real) / abs(hold(mode.frequency_hz, table.sample_rate_hz))
    return Resonance(mode.frequency_hz * assumed.scale, mode.tau_s, gain)


class PlateSimulation:
    """A Plate in time: one call a sample, the sensor's level now, then the drive that will be held until the next."""

    def __init__(self, plate: Plate, seed: int = 1) -> None:
        self.plate = plate
        self.period_s = 1.0 / plate.sample_rate_hz
        self.poles = [_pole(resonance) for resonance in plate.resonances]
        self.residues = [_residue(resonance, plate.displacement) for resonance in plate.resonances]
        self.states = [0j] * len(self.poles)
        self.decays = [cmath.exp(pole * self.period_s) for pole in self.poles]
        whole, part = divmod(plate.delay_s / self.period_s, 1.0)
        late_s = part * self.period_s
        self.push_new = [_hold_response(pole, self.period_s - late_s) for pole in self.poles]
        self.push_old = [
            _hold_response(pole, self.period_s) - new for pole, new in zip(self.poles, self.push_new, strict=True)
        ]
        self.line = [0.0] * (int(whole) + 2)
        self.random = random.Random(seed)

    def sense(self) -> float:
        """The sensor's level at this sample, in full scales."""
        level = sum((residue * state).real for residue, state in zip(self.residues, self.states, strict=True))
        noise = self.random.gauss(0.0, self.plate.noise) if self.plate.noise else 0.0
        return level + self.plate.feedthrough * self.line[1] + self.plate.offset + noise

    def drive(self, level: float) -> None:
        """Holds a drive from now to the next sample."""
        self.line.append(level)
        del self.line[0]
        old, new = self.line[0], self.line[1]
        for index, state in enumerate(self.states):
            self.states[index] = self.decays[index] * state + self.push_new[index] * new + self.push_old[index] * old


def _pole(resonance: Resonance) -> complex:
    rate = 1.0 / resonance.tau_s
    omega = 2.0 * math.pi * resonance.frequency_hz
    return complex(-rate, math.sqrt(omega**2 - rate**2))


def _residue(resonance: Resonance, displacement: bool) -> complex:
    """Twice the residue of the upper pole: y = Re(residue z), z' = p z + u."""
    pole = _pole(resonance)
    omega = 2.0 * math.pi * resonance.frequency_hz
    width = 2.0 / resonance.tau_s
    numerator = omega * width if displacement else width * pole
    return 2.0 * resonance.gain * numerator / (pole - pole.conjugate())


def _hold_response(pole: complex, seconds: float) -> complex:
    """Response of z' = p z + u after u = 1 was held for so long."""
    return (cmath.exp(pole * seconds) - 1.0) / pole


def adc_code(level: float) -> int:
    """The 12-bit code of a level in full scales, clipped at the ends."""
    return min(max(math.floor(level * 2048.0 + 2048.5), 0), 4095)


def dac_level(code: int) -> float:
    """The level of a 12-bit code in full scales."""
    return (code - 2048) / 2047.0
