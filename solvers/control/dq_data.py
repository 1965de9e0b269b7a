"""What the study of one mode's loop is asked: the mode, its neighbours, the wish and the imperfections."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite

from solvers.control.baseband import SETTLED, ModePlant
from solvers.control.dq_loop import Rates
from solvers.control.identification import Sensor
from solvers.errors import SolverError

THESIS_95_S = 2e-3


@dataclass(frozen=True)
class DqData:
    """What is controlled and how. The thesis states no identified values; ours follow its prototype: 31 kHz.

    wanted, neighbours: velocity response of each mode, signal over drive in full scales; for sensor "displacement" their
    gains are turned by -j. within_s: asked 95 % response. share: of G Vmax, the step asked for. delay_s: dead time beyond
    the hold; delay_guess_s: what is known of delay and hold before identification; noise: rms of a sample.
    """

    wanted: ModePlant = field(default_factory=lambda: ModePlant.from_quality(31_000.0, 300.0, 0.8))
    neighbours: tuple[ModePlant, ...] = ()
    within_s: float = THESIS_95_S
    share: float = 0.18
    drive_limit: float = 1.0
    amplitude_limit: float = 0.8
    delay_s: float = 7e-6
    delay_guess_s: float = 6e-6
    noise: float = 1e-3
    feedthrough: float = 0.002
    sensor: Sensor = "displacement"
    detunings_hz: tuple[float, ...] = (-300.0, 0.0, 300.0)
    rates: Rates = field(default_factory=Rates)

    @property
    def latency_s(self) -> float:
        """From a change of the reference to its drive at worst: a period's wait, the gap, a sample, the delay."""
        samples = self.rates.period + self.rates.gap + 1
        return samples / self.rates.sample_rate_hz + self.delay_s

    @property
    def response_s(self) -> float:
        """tau_d that leaves 95 % within the asked time. SolverError when the loop's own latency takes it all."""
        if not isfinite(self.within_s) or self.within_s <= self.latency_s:
            raise SolverError(
                f"95 % within {self.within_s:g} s: must be finite and above the loop's own latency, {self.latency_s:.3g} s"
            )
        return (self.within_s - self.latency_s) / SETTLED
