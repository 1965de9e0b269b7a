"""Margins of the amplitude loop, window by window, with the modes as fitted.

The gains are those that the board computes, core/single/an_pi.c: Kp, Ki, and a prediction of the envelope from the middle of
a window to the time when its answer takes effect. With the response H of the plate from one window's drive to the same
window's measurement,

    L(z) = z^-1 H(z) (state + Ki / (z - 1)) / (1 + feed / z).
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from firmware.client.chirp import SAMPLE_S, WINDOW_S, Complexes, Floats, Mode
from firmware.mode_table import PERIOD, WINDOW

RESPONSE_S = 0.53e-3  # AN_RESPONSE_S
NEIGHBOUR_LOOP = 0.5  # AN_NEIGHBOUR_LOOP
LOOP_GAIN_MIN = 0.1  # AN_LOOP_GAIN_MIN
AHEAD_S = (0.5 * WINDOW + PERIOD - WINDOW) * SAMPLE_S
PHASE_LEAST_DEG, GAIN_LEAST_DB = 60.0, 12.0
GRID = 4001


@dataclass(frozen=True)
class Loop:
    """Proportional gain (drive over sensor) with its bound, as a response of neighbours, and the margins that it leaves.

    stable is False if the closed loop would not decay.
    """

    neighbour: float
    proportional: float
    phase_deg: float
    gain_db: float
    stable: bool

    @property
    def holds(self) -> bool:
        """True if both margins are at least the stated ones."""
        return self.stable and self.phase_deg >= PHASE_LEAST_DEG and self.gain_db >= GAIN_LEAST_DB


class Gains(NamedTuple):
    """Gains of an_pi_law, for a drive on the resonance."""

    proportional: float
    integral: float
    state: float
    feed: float


def gains(mode: Mode, neighbour: float) -> Gains:
    """Return the gains that the board plans for a mode and the largest response of its neighbours."""
    taken, spent = 1.0 / abs(mode.gain), -math.expm1(-WINDOW_S / mode.tau_s)
    aimed = -math.expm1(-WINDOW_S / RESPONSE_S) * taken / spent
    bounded = min(aimed, NEIGHBOUR_LOOP / neighbour) if neighbour > 0.0 else aimed
    proportional = max(bounded, LOOP_GAIN_MIN * taken)
    decay = math.exp(-AHEAD_S / mode.tau_s)
    return Gains(proportional, proportional * spent, proportional * decay, proportional * (1.0 - decay) / taken)


def loop(modes: tuple[Mode, ...], background: complex, neighbour: float, late_s: float) -> Loop:
    """Compute the margins of the loop about the first of some modes.

    Parameters
    ----------
    modes : tuple of Mode
        Gains without the delay; the first one is held.
    background : complex
        Response of all other modes, without the delay.
    neighbour : float
        Largest response of other modes, which bounds the proportional gain.
    late_s : float
        Delay of the envelope, in s.

    Returns
    -------
    Loop
    """
    centre = modes[0].away_hz  # the carrier follows the first mode
    modes = tuple(replace(mode, away_hz=mode.away_hz - centre) for mode in modes)
    law = gains(modes[0], neighbour)
    lines_hz = _grid(modes)
    z = np.exp(2j * math.pi * lines_hz * WINDOW_S)
    control = (law.state + law.integral / (z - 1.0)) / (1.0 + law.feed / z)
    opened = _plant(modes, background, lines_hz, late_s) / z * control
    return Loop(neighbour, law.proportional, *_margins(opened))


def widest(modes: tuple[Mode, ...], background: complex, neighbour: float, late_s: float) -> Loop:
    """Return the fastest loop with the stated margins, or the slowest one if none has them."""
    least, most = neighbour, NEIGHBOUR_LOOP * abs(modes[0].gain) / LOOP_GAIN_MIN
    found = loop(modes, background, least, late_s)
    if found.holds:
        return found
    for _ in range(20):
        middle = math.sqrt(max(least, 1e-3 * most) * most)
        least, most = (least, middle) if loop(modes, background, middle, late_s).holds else (middle, most)
    return loop(modes, background, most, late_s)


def _grid(modes: tuple[Mode, ...]) -> Floats:
    """Frequencies over one turn of z, from just above the carrier to just below it again, dense near each mode."""
    half = 0.5 / WINDOW_S
    dense = np.concatenate([mode.away_hz + mode.half_hz * np.sinh(np.linspace(-9.0, 9.0, GRID)) for mode in modes])
    near = np.geomspace(1e-3, half, GRID)
    turned = np.concatenate([dense, near, -near]) % (2.0 * half)
    return np.asarray(np.unique(turned[(turned > 1e-3) & (turned < 2.0 * half - 1e-3)]))


def _plant(modes: tuple[Mode, ...], background: complex, lines_hz: Floats, late_s: float) -> Complexes:
    """Response of modes and background, turned so that the gain of the first mode is real."""
    turned = cmath.rect(1.0, -cmath.phase(modes[0].gain))
    own = [mode.gain * mode.response(lines_hz, WINDOW_S, late_s) for mode in modes]
    return np.asarray(turned * (np.sum(own, axis=0) + background))


def _margins(opened: Complexes) -> tuple[float, float, bool]:
    """Return phase margin in degrees, gain margin in dB, and whether 1 + L encircles the origin as a stable loop does.

    The integrator adds half a turn at z = 1.
    """
    size, phase = np.abs(opened), np.unwrap(np.angle(opened))
    crossed = np.flatnonzero(np.diff(size > 1.0))
    phase_deg = 180.0 - np.abs(np.angle(opened[crossed], deg=True)).max() if crossed.size else 180.0
    turns = np.floor((phase + math.pi) / (2.0 * math.pi))
    at = np.flatnonzero(np.diff(turns))
    at = at[size[at] > 1e-9]
    gain_db = float(np.abs(20.0 * np.log10(size[at])).min()) if at.size else math.inf
    around = np.unwrap(np.angle(1.0 + opened))
    return float(phase_deg), gain_db, bool(abs(around[-1] - around[0] - math.pi) < 1.0)
