"""The six-channel application on this machine, joined to a simulated beam."""

from __future__ import annotations

import numpy as np

from firmware.emulate.beam import CHANNELS, Beam, BeamSimulation, Structure, adc_codes
from firmware.host.hosted import Hosted


class HostedSix(Hosted):
    """an_six and a beam in lock step: run(seconds) advances both."""

    def __init__(self, table: bytes, beam: Beam | Structure, seed: int = 1, faults: int = 0) -> None:
        super().__init__("an_six", "an_six_build", beam.sample_rate_hz)
        self.table = self.ffi.from_buffer("uint8_t[]", table)
        self.fast = self.ffi.addressof(self.app, "fast")
        self.beam = BeamSimulation(beam, seed)
        self.middle, self.swing = self.lib.AN_SIX_DUTY_MIDDLE, self.lib.AN_SIX_DUTY_SWING
        self.samples = self.ffi.new("uint16_t []", CHANNELS)
        self.duties = self.ffi.new("uint16_t []", [self.middle] * CHANNELS)
        self.history: list[list[int]] | None = None
        self.lib.an_six_boot(self.app, self.table, len(table), beam.sample_rate_hz, faults)

    def tick(self) -> None:
        """One sample period: sensors and drives together, then the interrupts, then the main loop, woken by any of them."""
        sensed = self.sense()
        self.beam.drive((np.array(list(self.duties)) - self.middle) / self.swing)
        self.samples[0:CHANNELS] = adc_codes(sensed)
        self.lib.an_six_tick(self.fast, self.samples, self.duties)
        if self.history is not None:
            self.history.append(list(self.duties))
        if self.fast.tick == 0:
            self.lib.an_six_window_end(self.app)
        self.fast.faults |= self.lib.an_six_check(self.app)
        self.poll()

    def sense(self) -> np.ndarray:
        """What reaches the converters; a test may put broken sensors here."""
        return self.beam.sense()

    @property
    def measured(self) -> np.ndarray:
        """The six phasors of the last window."""
        return np.array([complex(z.re, z.im) for z in self.app.slow.measured])

    @property
    def drives(self) -> np.ndarray:
        """The six drives commanded last."""
        return np.array([complex(z.re, z.im) for z in self.app.slow.drive])
