"""Identification of six channels: the matrix T as the board measured it, its coherence, and the margins of the loop.

The board adds a share g of each sensor's error to its integral per period E, and drives V = T'^-1 (W + I) with the measured
T'. For a mode at a distance D from the carrier, whose envelope decays with tau, that loop is

    L(z) = g / (z - 1) * (1 - p) z / (z - p),    p = exp((j D - 1 / tau) E).

The margins below are those of the worst D. The true T is T' (1 + X) with a norm of X up to
the error e of the measurement, which turns an eigenvalue by at most asin(e) and multiplies it by at most 1 + e.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firmware.client.client import BoardError, Client
from firmware.client.identify import Units
from firmware.mode_table import CHANNELS
from firmware.protocol import SixStatus

AVERAGED = 8  # windows: PROBE_AVERAGE
PHASE_LEAST_DEG, GAIN_LEAST_DB = 60.0, 6.0
COHERENCE_LEAST = 0.9
DISTANCES = np.concatenate([[0.0], np.geomspace(1e-2, 1e4, 121)])  # of a mode from the carrier, over 1 / tau


@dataclass(frozen=True)
class Matrix:
    """Measured matrix and what it rests on.

    Attributes
    ----------
    responses, coherence : ndarray, shape (6, 6)
        T, sensor by actuator, and squared coherences.
    status : SixStatus
        Status after the measurement: condition, misfit (error of the superposition that T predicts), level.
    seconds, least_s : float
        Duration of the measurement on the board, and the least possible one.
    phase_deg, gain_db : float
        Margins of the loop.
    """

    responses: NDArray[np.complex128]
    coherence: NDArray[np.float64]
    status: SixStatus
    seconds: float
    least_s: float
    phase_deg: float
    gain_db: float

    @property
    def noise(self) -> float:
        """Standard deviation of the error that noise in T makes in V, relative to V."""
        return noise_of(self.responses, self.coherence)

    @property
    def coherent(self) -> float:
        """Share of the sensors' energy that follows the drives: coherence of all responses together."""
        power = np.abs(self.responses) ** 2
        return float(power.sum() / (power / np.maximum(self.coherence, 1e-12)).sum())


def noise_of(responses: NDArray[np.complex128], coherence: NDArray[np.float64]) -> float:
    """Root of the mean of |T^-1 dT|^2 (Frobenius), with the variances dT^2 of means over AVERAGED windows; the board's own."""
    spread2 = np.abs(responses) ** 2 * (1.0 / np.maximum(coherence, 1e-12) - 1.0) / (AVERAGED - 1)
    weights = (np.abs(np.linalg.pinv(responses)) ** 2).sum(axis=0)
    return math.sqrt(float(weights @ spread2.sum(axis=1)))


def margins(integral: float, passed: float, error: float) -> tuple[float, float]:
    """Return phase margin in degrees and gain margin in dB for the worst mode and an error of T.

    Parameters
    ----------
    integral : float
        Share g of an error that the integral takes per window.
    passed : float
        Time between two windows, in time constants of a mode.
    error : float
        Largest norm of the relative error of T.

    Returns
    -------
    tuple of float
        Negative infinity where the error alone may reverse the loop.
    """
    if not error < 1.0:
        return -math.inf, -math.inf
    distances = DISTANCES[DISTANCES * passed <= math.pi]
    near = (distances[:, None] + np.linspace(-4.0, 4.0, 81)).ravel() * passed
    angle = np.concatenate([np.geomspace(1e-3 * passed, math.pi, 1500), near[(near > 0.0) & (near < math.pi)]])
    angle = np.unique(np.concatenate([-angle, angle]))
    z = np.exp(1j * angle)
    same_side = angle[1:] * angle[:-1] > 0.0  # the pole at z = 1 lies between the sides
    phase_deg, gain_db = 180.0, math.inf
    for distance in distances:
        p = np.exp((1j * distance - 1.0) * passed)
        opened = integral / (z - 1.0) * z * (1.0 - p) / (z - p)
        size, phase = np.abs(opened), np.angle(opened)
        crossed = np.flatnonzero(np.diff(size > 1.0))
        phase_deg = min(phase_deg, 180.0 - float(np.degrees(np.abs(phase[crossed])).max(initial=0.0)))
        reversed_ = np.flatnonzero((np.abs(np.diff(phase)) > math.pi) & same_side)
        gain_db = min(gain_db, -20.0 * math.log10(float(size[reversed_].max(initial=1e-9))))
    return phase_deg - math.degrees(math.asin(error)), gain_db - 20.0 * math.log10(1.0 + error)


def read(client: Client) -> Matrix:
    """Read the matrix that the board has just measured.

    Raises
    ------
    BoardError
        If the board has measured none.
    """
    status = client.status()
    if not isinstance(status, SixStatus):
        raise BoardError("identify: this board runs the single-mode image")
    columns = [client.column(actuator) for actuator in range(CHANNELS)]
    responses = np.array([column.responses for column in columns]).T
    coherence = np.array([column.coherence for column in columns]).T
    error = math.hypot(status.misfit, noise_of(responses, coherence))
    phase_deg, gain_db = margins(columns[0].integral, columns[0].passed, error)
    return Matrix(responses, coherence, status, columns[0].seconds, columns[0].least_s, phase_deg, gain_db)


def describe(found: Matrix) -> str:
    """Describe a measured matrix for a reader."""
    status, units, largest = found.status, Units(found.status.metres), float(np.abs(found.responses).max())
    return "\n".join(
        [
            f"matrix at {status.frequency_hz:.2f} Hz: condition {status.condition:.3g}, responses up to "
            f"{units.gain(largest, '.3g')}, coherence {found.coherent:.4f}, noise {100.0 * found.noise:.2g} %",
            f"all actuators together: misfit {100.0 * status.misfit:.2g} %, at up to {units.motion(status.motion)}",
            f"loop: phase margin {found.phase_deg:.0f} deg (at least {PHASE_LEAST_DEG:g}), gain margin {found.gain_db:.1f} dB "
            f"(at least {GAIN_LEAST_DB:g})",
            f"loaded after {found.seconds:.1f} s of the board's time (least possible {found.least_s:.1f} s)",
        ]
    )


KEPT = "nothing is held: `identify`, `pattern` and the button B1 measure again"


def judge(found: Matrix) -> None:
    """Raise BoardError unless the matrix is fit to hold a pattern with, by the board's judgement, too."""
    if found.coherent < COHERENCE_LEAST:
        raise BoardError(
            f"identify: coherence {found.coherent:.2f}, at least {COHERENCE_LEAST:g} needed: keep hands off the plate; raise "
            f"the gain of the conditioners or the drive limit; {KEPT}"
        )
    if found.phase_deg < PHASE_LEAST_DEG or found.gain_db < GAIN_LEAST_DB or not found.status.identified:
        raise BoardError(
            f"identify: the errors of the matrix leave {found.phase_deg:.0f} deg and {found.gain_db:.1f} dB of margin, "
            f"{PHASE_LEAST_DEG:g} deg and {GAIN_LEAST_DB:g} dB needed (condition {found.status.condition:.3g}): choose a "
            f"frequency farther from a resonance, or move a sensor; {KEPT}"
        )


def draw(file: Path, found: Matrix) -> None:
    """Draw magnitude, phase and coherence of all responses to a picture (PNG, SVG or PDF, by its name)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 3.8), layout="constrained")
    numbers = [str(number) for number in range(1, CHANNELS + 1)]
    panels = (
        (np.abs(found.responses), "sensor over drive", "viridis", None),
        (np.angle(found.responses, deg=True), "phase, degrees", "twilight", (-180.0, 180.0)),
        (found.coherence, "coherence", "magma", (0.0, 1.0)),
    )
    for axes, (values, name, colours, limits) in zip(figure.subplots(1, 3), panels, strict=True):
        shown = axes.imshow(values, cmap=colours, **({} if limits is None else {"vmin": limits[0], "vmax": limits[1]}))
        axes.set(title=name, xlabel="actuator", ylabel="sensor")
        axes.set_xticks(range(CHANNELS), numbers)
        axes.set_yticks(range(CHANNELS), numbers)
        figure.colorbar(shown, ax=axes, shrink=0.8)
    status = found.status
    figure.suptitle(
        f"{status.frequency_hz:.1f} Hz, condition {status.condition:.3g}, misfit {100.0 * status.misfit:.2g} %"
    )
    figure.savefig(file)
